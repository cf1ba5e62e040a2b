"""Temporary files and folders that are open now, told to the process that waits for this one.

When this process has to be killed, that process removes them (see supervised.py). Without such a process
nothing is told, and what is left is removed by the next run.
"""

import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from filelock import FileLock

LONGEST = 4096  # bytes of one announcement; a pipe takes that many in one piece

_pipe: list[int] = []


def report_to(descriptor: int) -> None:
    """Let announcements of this process go to a pipe."""
    _pipe[:] = [descriptor]


def announce(path: Path) -> None:
    """Say that a temporary file or folder is about to be made."""
    _write(b"+", path)


def withdraw(path: Path) -> None:
    """Say that a temporary file or folder is gone."""
    _write(b"-", path)


def announce_advice(text: str) -> None:
    """Say what the user is told if this process has to be killed, such as how to go on; "" for nothing."""
    _write(b"?", text)


def announce_end() -> None:
    """Say that the user knows of the interruption: nothing is said if this process has to be killed."""
    _write(b"!", "")


def read_announcements(data: bytes, known: set[str], advice: list[str | None] | None = None) -> bytes:
    """Bring `known` and `advice` up to date; return the rest of `data` that is not whole yet.

    known: the paths that are open; advice: nothing, or the text for the user if the process is killed, or
    None where the user knows already.
    """
    *whole, rest = data.split(b"\0")
    for item in whole:
        path = os.fsdecode(item[1:])
        if item[:1] in (b"?", b"!"):
            if advice is not None:
                advice[:] = [None] if item[:1] == b"!" else [path] if path else []
        elif item[:1] == b"+":
            known.add(path)
        else:
            known.discard(path)
    return rest


def remove_leftovers(known: set[str]) -> None:
    """Remove the files and folders of a process that was killed."""
    import shutil

    for name in known:
        path = Path(name)
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink(missing_ok=True)
        with suppress(OSError):
            path.with_name(path.name + ".lock").unlink(missing_ok=True)


def _write(sign: bytes, text: Path | str) -> None:
    data = sign + os.fsencode(text) + b"\0"
    if _pipe and len(data) <= LONGEST:
        with suppress(OSError):
            os.write(_pipe[0], data)


# Temporary folders that do not outlive the work that they are for, even if it is killed.
#
# Beside each lies a lock, made before the folder and held as long as its process lives. Whoever makes the
# next one with `sweep` removes the folders whose lock is free: the system releases the locks of a killed
# process.


PREFIX = "tensegrity_codegen-"
LOCK = ".lock"  # ending of the lock of a folder
STALE_AFTER = 24 * 3600.0  # s; for folders that have no lock
ATTEMPTS = 20
LOCK_ERRORS = (OSError, NotImplementedError)  # the file system has no locks


@contextmanager
def work_folder(parent: Path | None = None, *, sweep: bool = False) -> Iterator[Path]:
    """Give a new folder for this user alone, removed at the end.

    Parameters
    ----------
    parent : folder to make it in; the system's folder of temporary files if not given.
    sweep : remove what killed processes left in `parent` before.

    Raises
    ------
    OSError
        If no folder can be made.
    """
    place = Path(tempfile.gettempdir()).resolve() if parent is None else parent
    if sweep:
        sweep_folders(place)
    folder, lock = _make_locked(place)
    try:
        yield folder
    finally:
        _remove(folder)
        if lock is not None:
            lock.release()
            _remove(folder)  # Windows keeps the lock while it is held
        withdraw(folder)


def sweep_folders(parent: Path) -> None:
    """Remove the folders in `parent` that killed processes of this user left; those in use stay."""
    with suppress(OSError), os.scandir(parent) as items:
        for item in items:
            if item.name.startswith(PREFIX) and _is_own(item):
                if item.name.endswith(LOCK):
                    _remove_abandoned(Path(item.path.removesuffix(LOCK)))
                elif item.is_dir(follow_symlinks=False) and not _lock_of(Path(item.path)).exists():
                    _remove_old(Path(item.path))


def _make_locked(parent: Path) -> "tuple[Path, FileLock | None]":
    """Make a folder and take its lock first; None where the file system has no locks."""
    from filelock import FileLock, Timeout  # half of the time that importing this module would take

    if not parent.is_dir():  # FileLock would make it
        raise FileNotFoundError(2, "No such folder", str(parent))
    for _ in range(ATTEMPTS):
        folder = parent / f"{PREFIX}{secrets.token_hex(6)}"
        announce(folder)
        lock = FileLock(str(_lock_of(folder)), timeout=0, mode=0o600)
        try:
            lock.acquire()
        except Timeout:
            continue
        except LOCK_ERRORS:
            folder.mkdir(mode=0o700)
            return folder, None
        if _lock_of(folder).exists():
            folder.mkdir(mode=0o700)
            return folder, lock
        lock.release()  # it was swept before it was taken
    raise OSError(11, "temporary folders are removed as soon as they are made", str(parent))


def _lock_of(folder: Path) -> Path:
    return folder.with_name(folder.name + LOCK)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):
        _lock_of(folder).unlink(missing_ok=True)


def _is_own(item: os.DirEntry[str]) -> bool:
    if item.is_symlink():
        return False
    return not hasattr(os, "geteuid") or item.stat(follow_symlinks=False).st_uid == os.geteuid()


def _remove_abandoned(folder: Path) -> None:
    """Remove a folder whose lock is free, and the lock."""
    from filelock import FileLock, Timeout

    lock = FileLock(str(_lock_of(folder)), timeout=0, mode=0o600)
    try:
        lock.acquire()
    except Timeout:
        return
    except LOCK_ERRORS:
        _remove_old(folder)
        return
    try:
        _remove(folder)
    finally:
        lock.release()


def _remove_old(folder: Path) -> None:
    if _age(folder) > STALE_AFTER:
        _remove(folder)


def _age(folder: Path) -> float:
    try:
        return time.time() - folder.stat().st_mtime
    except OSError:
        return 0.0
