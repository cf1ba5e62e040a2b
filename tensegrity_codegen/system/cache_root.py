"""The folder of the cache, and folders and files that only this user can have written."""

import os
import stat
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path

from tensegrity_codegen.system.errors import UnsafeCacheError

CACHE_VARIABLE = "TENSEGRITY_CODEGEN_CACHE"


class CacheFolderWarning(UserWarning):
    """The cache is not at its usual path."""


def find_cache_root() -> Path:
    """Return the cache folder of this user, which need not exist yet.

    It is the folder that TENSEGRITY_CODEGEN_CACHE names, else the user's cache folder, else (a home that may
    not be written to) a folder of this user among the temporary files.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser().absolute()
    usual = user_cache_path("tensegrity_codegen").absolute()
    return usual if _may_be_written(usual) else _fallback()


def warn_of_fallback(root: Path) -> None:
    """Warn with CacheFolderWarning if `root` is the fallback among the temporary files."""
    if os.environ.get(CACHE_VARIABLE) or root != _fallback():
        return
    usual = user_cache_path("tensegrity_codegen")
    warnings.warn(
        f"the cache folder {usual} cannot be written; compiled libraries are kept in {root} for now; "
        f"set {CACHE_VARIABLE} to a folder that can be written",
        CacheFolderWarning,
        stacklevel=3,
    )


def _fallback() -> Path:
    owner = os.geteuid() if hasattr(os, "geteuid") else "user"
    return Path(tempfile.gettempdir()).absolute() / f"tensegrity_codegen_cache_{owner}"


def _may_be_written(folder: Path) -> bool:
    """Return whether a folder can be written, or made; nothing is made to find out."""
    path = folder
    while not os.path.lexists(path) and path != path.parent:
        path = path.parent
    return os.access(path, os.W_OK | os.X_OK)


# Folders and files that only this user can have written: made so, and checked before they are used.
#
# A library that is loaded runs with all rights of this user, so its folder has to be as private as a
# program's: owned by this user, writable by nobody else, no symbolic links. If the system knows no user
# ids (Windows) only links are refused; a user's folders are protected by their access lists there.


OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
HAS_OWNERS = hasattr(os, "geteuid")


def check_private(path: Path, root: Path) -> None:
    """Raise UnsafeCacheError unless `path`, of the cache `root`, is absent or of this user alone."""
    with suppress(FileNotFoundError, NotADirectoryError):
        problem = _find_problem(os.lstat(path))
        if problem:
            raise _refuse(path, root, problem)


def check_entry(folder: Path, root: Path) -> None:
    """Raise UnsafeCacheError unless a folder and everything in it are of this user alone."""
    check_private(folder, root)
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as entries:
        for entry in entries:
            problem = _find_problem(entry.stat(follow_symlinks=False))
            if problem:
                raise _refuse(Path(entry.path), root, problem)


def check_parents(root: Path) -> None:
    """Raise UnsafeCacheError if any user may rename or replace one of the folders that lead to `root`."""
    if not HAS_OWNERS:
        return
    for folder in Path(os.path.realpath(root.parent)).joinpath("x").parents:
        with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
            mode = folder.stat().st_mode
            if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
                raise _refuse(folder, root, f"every user may replace what is in this folder ({_octal(mode)})")


def make_private(folder: Path, root: Path) -> None:
    """Make a folder below or at `root`, with parents, for this user alone, or check the one that exists."""
    missing = []
    path = folder
    while not os.path.lexists(path) and path != path.parent:
        missing.append(path)
        path = path.parent
    for path in reversed(missing):
        with suppress(FileExistsError):  # another process was faster
            path.mkdir(mode=0o700)
    check_private(folder, root)
    if not folder.is_dir():
        raise NotADirectoryError(20, "a file is in the way of a folder", str(folder))


def make_cache_folder(name: str) -> Path | None:
    """Return a private folder of the cache, made if need be, unchecked inside; None if it cannot be."""
    root = find_cache_root()
    folder = root / name
    try:
        check_parents(root)
        make_private(root, root)
        make_private(folder, root)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, UnsafeCacheError):
        return None


def write_private(path: Path, content: bytes) -> None:
    """Write a new file for this user alone, whatever the umask; raises OSError."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
        file.write(content)


def _find_problem(found: os.stat_result) -> str:
    """Return why a file or folder is not safe, "" if it is."""
    if stat.S_ISLNK(found.st_mode):
        return "a symbolic link"
    if not (stat.S_ISDIR(found.st_mode) or stat.S_ISREG(found.st_mode)):
        return "neither a file nor a folder"
    if not HAS_OWNERS:
        return ""
    if found.st_uid != os.geteuid():
        return f"it belongs to user {found.st_uid}, and this is user {os.geteuid()}"
    if found.st_mode & OTHERS_MAY_WRITE:
        return f"other users may write to it ({_octal(found.st_mode)})"
    return ""


def _octal(mode: int) -> str:
    return f"mode {stat.S_IMODE(mode):04o}"


def _refuse(path: Path, root: Path, problem: str) -> UnsafeCacheError:
    return UnsafeCacheError(
        "the cache of compiled libraries is not used: another user may have put a library into it",
        where=str(path),
        given=problem,
        allowed="folders and files of this user, writable by no other user, no symbolic links",
        hint=f"set {CACHE_VARIABLE} to a folder of your own (chmod 700), "
        f"or remove {root} if it is yours, and run again",
    )
