"""Temporary files and folders that are open now, told to the process that waits for this one.

When this process has to be killed, that process removes them (see supervised.py). Without such a process
nothing is told, and what is left is removed by the next run.
"""

import os
from contextlib import suppress
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
