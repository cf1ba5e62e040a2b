"""One entry of the cache on disk: files, and entry.json that says what each of them must be."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_codegen.system.cache_root import write_private
from tensegrity_codegen.system.errors import LibraryError, describe_reason
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
    """Write files (name -> content) and then entry.json into the new folder, for this user alone.

    scene: hash of what the library is made from.

    Raises OSError, and ValueError for a file name that is no plain name.
    """
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
    """Return the entry in that folder, or None if it is absent or not what its entry.json says.

    An entry without a library or without manifest.json counts as absent.
    Every size is compared; the sha256 of the library and of manifest.json, which get executed and believed.
    """
    try:
        data = json.loads((folder / ENTRY_FILE).read_bytes())
        if data["version"] != ENTRY_VERSION:
            return None
        whole = all(_matches(folder / name, expected) for name, expected in data["files"].items())
        entry = CacheEntry(key, folder, tuple(data["files"]), str(data["scene"]))
        return entry if whole and entry.library is not None and entry.manifest is not None else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError, AttributeError):
        return None


def read_contents(entry: CacheEntry) -> dict[str, bytes]:
    """Return the files of an entry, each compared with its sha256.

    Raises LibraryError where one is absent or not what it was when it was written.
    """
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


def write_request(path: Path, library_key: str, note: Mapping[str, Any]) -> None:
    """Write the file that leads from a request to a library, and what else is known; raises OSError."""
    data = {"version": REQUEST_VERSION, "library": library_key, "note": dict(note)}
    write_private(path, json.dumps(data).encode("utf-8"))


def read_request(path: Path) -> tuple[str, dict[str, Any]] | None:
    """Return the library key and the note in such a file, None if it is absent or damaged."""
    try:
        data = json.loads(path.read_bytes())
        known = data["version"] == REQUEST_VERSION and isinstance(data["note"], dict)
        return (str(data["library"]), data["note"]) if known else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _matches(path: Path, expected: dict[str, Any]) -> bool:
    if not FILE_NAME.fullmatch(path.name) or path.stat().st_size != expected["size"]:
        return False
    hashed = path.name.endswith(LIBRARY_ENDINGS) or path.name == MANIFEST_FILE
    return not hashed or _sha256(path.read_bytes()) == expected["sha256"]


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
