"""Content-hash cache of compiled libraries, safe for several processes at once.

    <root>/requests/<key>.json     the library that a request led to, last time, and a note of how
    <root>/libraries/<key>/        sources, manifest.json, library, compile.log, and entry.json: the size and
                                   sha256 of each of these files, written last
    <root>/locks/<key>.lock        held while that key is made, checked for damage or removed
    <root>/temporary/              entries being written; those of killed processes go with the next one
    <root>/templates/              Python bytecode of the templates of generated C (codegen/print/render.py)

<root> is the folder named by the environment variable TENSEGRITY_CODEGEN_CACHE, else the user's cache folder.
All of it belongs to this user, may be written by nobody else and holds no links: otherwise it is refused
(system/cache_root.py), since a library that is loaded runs with all rights of this user.
An entry is written beside its place and renamed into it, never changed afterwards, so that a library which
another process has loaded stays as it is. A damaged entry counts as absent and is removed. Above the limit
(2 GiB by default) the least recently used entries go.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tensegrity_codegen.system.cache_root import (
    CACHE_VARIABLE,
    check_entry,
    check_parents,
    check_private,
    find_cache_root,
    make_private,
    warn_of_fallback,
    write_private,
)
from tensegrity_codegen.system.errors import LibraryError, OutputError, describe_reason
from tensegrity_codegen.system.temporary_files import remove_abandoned, work_folder
from tensegrity_codegen.tables.targets import library_suffixes

ENTRY_FILE = "entry.json"
ENTRY_VERSION = 2  # 2: loaded once before it was stored; `scene` says what it was made from
REQUEST_VERSION = 1
FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
LIBRARY_ENDINGS = library_suffixes()
MANIFEST_FILE = "manifest.json"


@dataclass(frozen=True)
class CacheEntry:
    """A checked entry: its key, its folder, the names of its files, the hash of what it was made from."""

    key: str
    folder: Path
    files: tuple[str, ...]
    scene: str = ""

    @property
    def library(self) -> Path | None:
        """The path of the shared library, None if the entry holds none."""
        return next((self.folder / name for name in self.files if name.endswith(LIBRARY_ENDINGS)), None)

    @property
    def manifest(self) -> Path | None:
        """The path of manifest.json, None if the entry holds none."""
        return self.folder / MANIFEST_FILE if MANIFEST_FILE in self.files else None


def write_entry(folder: Path, files: Mapping[str, bytes], scene: str = "") -> None:
    """Write files (name -> content) and then entry.json into the new folder, for this user alone."""
    for name in files:
        if not FILE_NAME.fullmatch(name) or name == ENTRY_FILE:
            raise ValueError(f"not a file name for a cache entry: {name!r}")
    folder.mkdir(mode=0o700)
    for name, content in files.items():
        write_private(folder / name, content)
    described = {name: {"size": len(data), "sha256": _sha256(data)} for name, data in sorted(files.items())}
    text = json.dumps({"version": ENTRY_VERSION, "scene": scene, "files": described}, indent=1)
    write_private(folder / ENTRY_FILE, text.encode("utf-8"))


def read_entry(folder: Path, key: str) -> CacheEntry | None:
    """Return the entry in that folder, or None if it is absent or differs from its entry.json.

    An entry without a library or without manifest.json counts as absent.
    Every size is compared; the sha256 of the library and of manifest.json, which get executed and believed.
    """
    try:
        data = json.loads((folder / ENTRY_FILE).read_bytes())
        if data["version"] != ENTRY_VERSION:
            return None
        is_complete = all(_matches(folder / name, expected) for name, expected in data["files"].items())
        entry = CacheEntry(key, folder, tuple(data["files"]), str(data["scene"]))
        return entry if is_complete and entry.library is not None and entry.manifest is not None else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError, AttributeError):
        return None


def read_contents(entry: CacheEntry) -> dict[str, bytes]:
    """Return the files of an entry, each compared with its sha256."""
    contents, name = {}, ENTRY_FILE
    try:
        expected = json.loads((entry.folder / ENTRY_FILE).read_bytes())["files"]
        for name in entry.files:
            contents[name] = (entry.folder / name).read_bytes()
            if _sha256(contents[name]) != expected[name]["sha256"]:
                raise ValueError("another sha256")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise LibraryError(
            "a file in the cache of compiled libraries is not what was written there",
            where=str(entry.folder),
            given=f"{name}: {describe_reason(error)}",
            allowed=f"files with the sha256 in {ENTRY_FILE}",
            hint="remove this folder, or clear the cache with the verb cache, and build again",
        ) from error
    return contents


def read_request(path: Path) -> tuple[str, dict[str, Any]] | None:
    """Return the library key and the note in such a file, None if it is absent or damaged."""
    try:
        data = json.loads(path.read_bytes())
        is_valid = data["version"] == REQUEST_VERSION and isinstance(data["note"], dict)
        return (str(data["library"]), data["note"]) if is_valid else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _matches(path: Path, expected: dict[str, Any]) -> bool:
    if not FILE_NAME.fullmatch(path.name) or path.stat().st_size != expected["size"]:
        return False
    hashed = path.name.endswith(LIBRARY_ENDINGS) or path.name == MANIFEST_FILE
    return not hashed or _sha256(path.read_bytes()) == expected["sha256"]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


SIZE_LIMIT = 2 * 2**30  # byte
COUNT_AFTER = 0.01  # of the limit: bytes that one process adds before it counts all entries again
COUNTED: dict[Path, tuple[int, int]] = {}  # root -> bytes when they were counted, bytes added since
LOCK_TIMEOUT = 900.0  # s; longer than the time limit of any compilation
KEY = re.compile(r"[0-9a-f]{16,128}")


class Cache:
    """The cache below `root` (default: find_cache_root()), kept below `limit` [byte].

    Keys are hexadecimal digests; any other text raises ValueError. Whatever cannot be written raises
    OutputError, which names the environment variable that moves the cache; what another user may have
    written raises UnsafeCacheError. A CacheFolderWarning says that the user's cache folder cannot be used.
    """

    def __init__(self, root: Path | None = None, *, limit: int = SIZE_LIMIT) -> None:
        self.root = find_cache_root() if root is None else root.absolute()
        if root is None:
            warn_of_fallback(self.root)
        self.limit = limit

    def find(self, key: str) -> CacheEntry | None:
        """Return the library entry of that key, or None; a damaged one is removed and counts as absent."""
        folder = self._library(key)
        check_entry(folder, self.root)
        entry = read_entry(folder, key)
        if entry is None and os.path.lexists(folder):
            with suppress(OutputError), self.lock(key):
                entry = read_entry(folder, key)
                if entry is None:
                    self._remove(folder)
        if entry is not None:
            with suppress(OSError):  # a cache that is only read is fine
                os.utime(folder)
        return entry

    def drop(self, key: str) -> None:
        """Remove the entry of that key, if there is one; raises OutputError."""
        folder = self._library(key)
        if os.path.lexists(folder):
            with self.lock(key):
                self._remove(folder)

    def store(
        self,
        key: str,
        files: Mapping[str, bytes],
        *,
        scene: str = "",
        check: Callable[[Path], None] | None = None,
    ) -> CacheEntry:
        """Store files (name -> content) under `key` and return the entry: ours, or the one already there.

        scene: hash of what the library is made from, kept in the entry; check: called with the folder of the
        files before they take their place; what it raises goes through, and nothing is stored.
        """
        folder = self._library(key)
        with self.lock(key):
            entry = self.find(key)
            if entry is None:
                with self._explain(folder), self._temporary() as temporary:
                    write_entry(temporary / key, files, scene)
                    if check is not None:
                        check(temporary / key)
                    make_private(folder.parent, self.root)
                    (temporary / key).rename(folder)
                entry = read_entry(folder, key)
            if entry is None:
                raise self._unusable(folder, "the written files differ when they are read back")
        self._prune(keep=folder, added=sum(map(len, files.values())))
        return entry

    def lookup_request(self, key: str) -> str | None:
        """Return the library key stored for a request, or None."""
        request = read_request(self._request(key))
        return request[0] if request and KEY.fullmatch(request[0]) else None

    def lookup_note(self, key: str) -> dict[str, Any]:
        """Return the note beside the library key of a request; empty if there is none."""
        request = read_request(self._request(key))
        return request[1] if request else {}

    def store_request(
        self, key: str, library_key: str, note: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        """Note that the request `key` leads to the library `library_key`; raises OutputError."""
        path = self._request(key)
        self._library(library_key)  # checks the key
        with self._explain(path), self._temporary() as temporary:
            data = {"version": REQUEST_VERSION, "library": library_key, "note": dict(note)}
            write_private(temporary / path.name, json.dumps(data).encode("utf-8"))
            make_private(path.parent, self.root)
            (temporary / path.name).replace(path)

    @contextmanager
    def lock(self, key: str, *, timeout: float = LOCK_TIMEOUT) -> Iterator[None]:
        """Hold the lock of one key against other processes and threads; may be nested in one thread.

        timeout: how long to wait for it [s].
        """
        path = self.root / "locks" / f"{_checked(key)}.lock"
        with self._explain(path):
            make_private(path.parent, self.root)
            check_private(path, self.root)
            from filelock import FileLock, Timeout  # libraries from the cache do without

            lock = FileLock(str(path), mode=0o600, is_singleton=True)
            try:
                lock.acquire(timeout=timeout)
            except Timeout as error:
                raise self._unusable(path, "another process holds the lock") from error
        try:
            yield
        finally:
            lock.release()

    def clear(self) -> int:
        """Remove every entry and request, and leftovers of killed processes; return the bytes freed."""
        freed = self.size()
        for folder in self._entries():
            with self.lock(folder.name):
                self._remove(folder)
        with self._explain(self.root):
            for request in self._requests():
                request.unlink(missing_ok=True)
        remove_abandoned(self._open("temporary"))
        return freed - self.size()

    def count(self) -> int:
        """Return the number of entries."""
        return len(self._entries())

    def size(self) -> int:
        """Return the bytes of all entries and requests."""
        requests = sum(_file_size(path) for path in self._requests())
        return requests + sum(_folder_size(folder) for folder in self._entries())

    def _library(self, key: str) -> Path:
        return self._open("libraries") / _checked(key)

    def _request(self, key: str) -> Path:
        path = self._open("requests") / f"{_checked(key)}.json"
        check_private(path, self.root)
        return path

    def _open(self, name: str) -> Path:
        """Return a folder of the cache, checked with all that leads to it."""
        check_parents(self.root)
        check_private(self.root, self.root)
        check_private(self.root / name, self.root)
        return self.root / name

    def _entries(self) -> list[Path]:
        """Return the entry folders, least recently used first."""
        folders = [path for path in self._open("libraries").glob("*") if KEY.fullmatch(path.name)]
        return sorted(folders, key=_last_use)

    def _requests(self) -> list[Path]:
        return sorted(self._open("requests").glob("*.json"))

    @contextmanager
    def _temporary(self) -> Iterator[Path]:
        """Give a new folder on the same file system as the entries, removed at the end."""
        parent = self._open("temporary")
        make_private(parent, self.root)
        with work_folder(parent, sweep=True) as folder:
            yield folder

    def _remove(self, path: Path) -> None:
        """Move an entry out of the way in one step, then delete it."""
        with self._explain(path), self._temporary() as temporary, suppress(FileNotFoundError):
            path.rename(temporary / path.name)

    def _prune(self, keep: Path, added: int) -> None:
        """Remove the least recently used entries, and requests that lead nowhere, while above the limit.

        added: bytes of the new entry. All entries are counted once a process, and again when this process
        has added a hundredth of the limit: counting reads every folder of the cache.
        """
        counted, since = COUNTED.get(self.root, (self.limit, self.limit))
        COUNTED[self.root] = (counted, since + added)
        if since + added <= COUNT_AFTER * self.limit and counted + since + added <= self.limit:
            return
        size = self.size()
        COUNTED[self.root] = (size, 0)
        if size <= self.limit:
            return
        for folder in self._entries():
            if size > self.limit and folder != keep:
                # No waiting: two processes that prune while they hold locks of their own would wait for ever.
                with suppress(OutputError), self.lock(folder.name, timeout=0.0):
                    freed = _folder_size(folder)
                    self._remove(folder)
                    size -= freed
        for path in self._requests():
            library_key = self.lookup_request(path.stem) if KEY.fullmatch(path.stem) else None
            if library_key is None or not self._library(library_key).exists():
                with suppress(OSError):
                    path.unlink(missing_ok=True)

    @contextmanager
    def _explain(self, path: Path) -> Iterator[None]:
        try:
            yield
        except (OSError, NotImplementedError) as error:
            raise self._unusable(path, describe_reason(error)) from error

    def _unusable(self, path: Path, reason: str) -> OutputError:
        return OutputError(
            "the cache of compiled libraries cannot be used",
            where=str(path),
            given=reason,
            allowed="a folder that can be written, with free space",
            hint=f"name another folder in the environment variable {CACHE_VARIABLE}, or make room",
        )


def _checked(key: str) -> str:
    if not KEY.fullmatch(key):
        raise ValueError(f"a cache key is 16 to 128 hexadecimal digits, not {key!r}")
    return key


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _file_size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _folder_size(folder: Path) -> int:
    return sum(_file_size(path) for path in folder.glob("*"))
