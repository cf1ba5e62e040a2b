"""Temporary files and folders that do not outlive the work that they are for, even if it is killed.

Those that are open now are told to the process that waits for this one, which removes them when this process
has to be killed (see supervised.py). The names of all contain the process that made them: whoever makes the
next one removes those whose process has ended.
"""

import hashlib
import os
import platform
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

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
    """Set the message to the user if this process has to be killed, such as how to go on; "" for nothing."""
    _write(b"?", text)


def announce_end() -> None:
    """Say that the user knows of the interruption: nothing is said if this process has to be killed."""
    _write(b"!", "")


def read_announcements(data: bytes, known: set[str], advice: list[str | None] | None = None) -> bytes:
    """Bring `known` and `advice` up to date; return the rest of `data` that is not whole yet.

    known: the paths that are open; advice: nothing, or the text for the user if the process is killed, or
    None if the user knows already.
    """
    *complete, tail = data.split(b"\0")
    for announcement in complete:
        path = os.fsdecode(announcement[1:])
        if announcement[:1] in (b"?", b"!"):
            if advice is not None:
                advice[:] = [None] if announcement[:1] == b"!" else [path] if path else []
        elif announcement[:1] == b"+":
            known.add(path)
        else:
            known.discard(path)
    return tail


def remove_leftovers(known: set[str]) -> None:
    """Remove the files and folders of a process that was killed."""
    for name in known:
        path = Path(name)
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink(missing_ok=True)


def _write(sign: bytes, text: Path | str) -> None:
    data = sign + os.fsencode(text) + b"\0"
    if _pipe and len(data) <= LONGEST:
        with suppress(OSError):
            os.write(_pipe[0], data)


PREFIX = "tensegrity_codegen-"
STALE_AFTER = 24 * 3600.0  # s; where the system does not say whether a process runs


@contextmanager
def work_folder(parent: Path | None = None, *, sweep: bool = False) -> Iterator[Path]:
    """Give a new folder for this user alone, removed at the end."""
    path = Path(tempfile.gettempdir()).resolve() if parent is None else parent
    if sweep:
        remove_abandoned(path)
    folder = path / f"{PREFIX}{name_owner()}"
    announce(folder)
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        withdraw(folder)


def name_owner() -> str:
    """Return a part of a name that no other file has, and that tells which process made it."""
    return f"{_name_machine()}-{os.getpid()}-{secrets.token_hex(6)}"


def remove_abandoned(parent: Path, before: str = PREFIX, after: str = "") -> None:
    """Remove files of ended processes of this machine, named `before` OWNER `after`, from a folder."""
    pattern = rf"{re.escape(before)}{_name_machine()}-(\d+)-[0-9a-f]{{12}}{re.escape(after)}"
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            match = re.fullmatch(pattern, entry.name)
            if match and not _is_in_use(entry, int(match[1])):
                remove_leftovers({entry.path})


def _is_in_use(item: os.DirEntry[str], process: int) -> bool:
    """Return whether the process runs that made a file or folder."""
    if os.name != "posix":
        return time.time() - item.stat(follow_symlinks=False).st_mtime < STALE_AFTER
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    with suppress(OSError, IndexError):  # killed, and its parent has not asked for its end yet
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    return True


@cache
def _name_machine() -> str:
    """Return a name that tells apart the processes of machines and containers that share a folder."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return hashlib.sha256(f"{platform.node()} {space}".encode()).hexdigest()[:6]
