"""Writing folders of files: all of them or none, and nothing of the user's without a word."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from tensegrity_codegen.errors import OutputError
from tensegrity_codegen.files import check_not_input, explain_unwritable
from tensegrity_codegen.marks import LIST_FILE, format_list, is_own, read_list
from tensegrity_codegen.work_folder import work_folder

__all__ = ["check_folder", "write_folder"]

NEW, OLD = "new", "old"
MOST_NAMED = 5


def check_folder(
    folder: str | Path,
    names: Iterable[str] = (),
    *,
    inputs: Iterable[Path] = (),
    overwrite: bool = False,
) -> Path:
    """Return the folder, which need not exist, if files of these names may be written into it.

    Parameters
    ----------
    folder : where the files are to be written.
    names : their names.
    inputs : files that are read; none of them is ever replaced.
    overwrite : whether files may be replaced that this package did not write, or that were changed since.

    Raises
    ------
    OutputError
        If the folder cannot be made or written, or holds files that may not be replaced.
    """
    target = Path(folder)
    place = target
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise explain_unwritable(folder, f"{place} is not a folder", "folder")
    if not os.access(place, os.W_OK | os.X_OK):
        raise explain_unwritable(folder, f"the folder {place} may not be written to", "folder")
    known, foreign = read_list(target), []
    for name in sorted(names):
        path = target / name
        if not os.path.lexists(path):
            continue
        check_not_input(path, inputs)
        if path.is_dir():
            raise explain_unwritable(path, "this is a folder, not a file")
        if not overwrite and not is_own(path, known):
            foreign.append(name)
    if foreign:
        more = f" and {len(foreign) - MOST_NAMED} more" if len(foreign) > MOST_NAMED else ""
        raise OutputError(
            "the folder holds files that were not written by tensegrity_codegen, or were changed since",
            where=str(folder),
            given=", ".join(foreign[:MOST_NAMED]) + more,
            allowed="a folder without files of these names, or with these as tensegrity_codegen wrote them",
            hint="choose another folder, or pass `overwrite=True` to replace these files",
        )
    return target


def write_folder(
    folder: str | Path,
    files: Mapping[str, bytes],
    *,
    inputs: Iterable[Path] = (),
    overwrite: bool = True,
    listed: bool = False,
) -> Path:
    """Write files (name -> content) into a folder, made if need be: all of them, or none.

    They are written beside their places first, so that a full disk leaves the folder as it was. Other files
    in the folder stay.

    Parameters
    ----------
    folder, inputs, overwrite : as for check_folder.
    listed : whether to write a list of the files and their sha256 too, by which they are known later.

    Raises
    ------
    OutputError
        As check_folder, and if the disk is full.
    """
    names = [*files, LIST_FILE] if listed else list(files)
    target = check_folder(folder, names, inputs=inputs, overwrite=overwrite)
    hashes = {name: {hashlib.sha256(content).hexdigest()} for name, content in files.items()}
    contents = dict(files) | ({LIST_FILE: format_list(hashes)} if listed else {})
    try:
        if target.is_dir():
            _exchange(target, contents, hashes if listed else {})
        else:
            _make(target, contents)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise explain_unwritable(folder, reason, "folder") from error
    return target


def _make(target: Path, contents: Mapping[str, bytes]) -> None:
    """Write a new folder beside its place and move it there."""
    with _parents(target), work_folder(target.parent, sweep=True) as work:
        _write_all(work / NEW, contents)
        (work / NEW).rename(target)


def _exchange(target: Path, contents: Mapping[str, bytes], hashes: Mapping[str, set[str]]) -> None:
    """Write all files into a folder inside `target`, then move each to its place; undo that on any error.

    The list with the old and the new hashes goes first: whatever ends this half-way, the files are known.
    """
    with work_folder(target, sweep=True) as work:
        _write_all(work / NEW, contents)
        if hashes:
            known = read_list(target)
            both = {name: hashes[name] | known.get(name, set()) for name in hashes}
            (work / NEW / LIST_FILE).rename(work / LIST_FILE)
            (work / NEW / LIST_FILE).write_bytes(format_list(both))
        _keep(work / OLD, target, contents)
        moved: list[str] = []
        try:
            for name in sorted(contents, key=lambda name: name != LIST_FILE):
                moved.append(name)
                (work / NEW / name).replace(target / name)
            if hashes:
                (work / LIST_FILE).replace(target / LIST_FILE)
        except BaseException:
            _undo(work, target, moved)
            raise


def _keep(folder: Path, target: Path, names: Iterable[str]) -> None:
    """Keep the files that are to be replaced, as hard links where the file system has them."""
    folder.mkdir()
    for name in names:
        if os.path.lexists(target / name):
            try:
                os.link(target / name, folder / name, follow_symlinks=False)
            except (OSError, NotImplementedError):
                shutil.copy2(target / name, folder / name, follow_symlinks=False)


def _undo(work: Path, target: Path, moved: list[str]) -> None:
    for name in reversed(moved):
        with suppress(OSError):
            if os.path.lexists(work / OLD / name):
                (work / OLD / name).replace(target / name)
            elif not os.path.lexists(work / NEW / name):
                (target / name).unlink()


def _write_all(folder: Path, contents: Mapping[str, bytes]) -> None:
    folder.mkdir()
    for name, content in contents.items():
        (folder / name).write_bytes(content)


@contextmanager
def _parents(target: Path) -> Iterator[None]:
    """Make the parent folders; on an error those made here are removed."""
    made, place = [], target.absolute().parent
    while not place.exists():
        made.append(place)
        place = place.parent
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise
