"""Which files this package has written: by a mark inside, or by the list that lies beside generated code.

A file without either may be a user's own, and is not replaced without a word.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

__all__ = ["LIST_FILE", "MARK", "format_list", "has_mark", "is_own", "read_list"]

MARK = "written by tensegrity_codegen"
LIST_FILE = "SHA256SUMS"
WINDOW = 2**16  # bytes at either end of a file in which the mark is looked for
# Tables have no place for a mark; these are the first columns of those written here.
TABLE_HEADS = (
    *(b"load_factor,smallest_eigenvalue,residual", b"scene,t_end,"),
    b"matrix,row,column,value",
    b"case,status,",  # of a sweep
)
# The first columns of a motion's table: time, and the position of a node along x.
MOTION_HEAD = re.compile(rb"(motion,)?time \[s\],[A-Za-z][\w.]*\.x \[m\],")


def has_mark(path: Path) -> bool:
    """Return whether a file says that this package wrote it; an empty file counts too."""
    try:
        with path.open("rb") as file:
            head = file.read(WINDOW)
            file.seek(max(path.stat().st_size - WINDOW, 0))
            tail = file.read(WINDOW)
    except OSError:
        return False
    is_table = head.startswith(TABLE_HEADS) or MOTION_HEAD.match(head) is not None
    return not head or is_table or any(MARK.encode() in part for part in (head, tail))


def is_own(path: Path, known: dict[str, set[str]]) -> bool:
    """Return whether a file was written by this package and is as it was then.

    known: what read_list found in its folder.
    """
    if path.is_symlink() or not path.is_file():
        return False
    if path.name == LIST_FILE:
        return bool(known)
    return has_mark(path) or (path.name in known and _hash(path) in known[path.name])


def read_list(folder: Path) -> dict[str, set[str]]:
    """Return file name -> sha256 values that the list in a folder gives; empty if there is none."""
    try:
        text = (folder / LIST_FILE).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return {}
    known: dict[str, set[str]] = {}
    for line in text.splitlines():
        digest, _, name = line.partition("  ")
        if name and len(digest) == 64:
            known.setdefault(name, set()).add(digest)
    return known


def format_list(known: dict[str, set[str]]) -> bytes:
    """Return the text of a list, in the form of `sha256sum`."""
    lines = [f"{digest}  {name}\n" for name in sorted(known) for digest in sorted(known[name])]
    return "".join(lines).encode("utf-8")


def _hash(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
