"""Writing folders of files: all of them or none, and replacing files only on request.

A folder of a library or controller has a list of its files, SHA256SUMS: those that are as the list says are
replaced without being asked for.
"""

import hashlib
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from tensegrity_codegen.system.checks import check_path, check_switch
from tensegrity_codegen.system.errors import OutputError, name_list
from tensegrity_codegen.system.files import check_not_input, explain_unwritable
from tensegrity_codegen.system.temporary_files import work_folder

LIST_FILE = "SHA256SUMS"
NEW, OLD = "new", "old"
MAX_NAMED = 5


def check_folder(
    folder: str | Path,
    names: Iterable[str] = (),
    *,
    inputs: Iterable[Path] = (),
    overwrite: bool = False,
    listed: bool = False,
) -> Path:
    """Return the folder, which need not exist, if files of these names may be written into it."""
    check_path(folder, "folder")
    check_switch(overwrite, "overwrite")
    target = Path(folder)
    output = target
    while not os.path.lexists(output) and output != output.parent:
        output = output.parent
    if not output.is_dir():
        raise explain_unwritable(folder, f"{output} is not a folder", "folder")
    if not os.access(output, os.W_OK | os.X_OK):
        raise explain_unwritable(folder, f"the folder {output} may not be written to", "folder")
    listing, existing = (_read_list(target) if listed else {}), []
    for name in sorted(names):
        path = target / name
        if not os.path.lexists(path):
            continue
        check_not_input(path, inputs)
        if path.is_dir():
            raise explain_unwritable(path, "this is a folder, not a file")
        if not overwrite and not _is_listed(path, listing):
            existing.append(name)
    if existing:
        unchanged = f", or with these as {LIST_FILE} lists them" if listed else ""
        problem, location = "the folder holds files of these names already", str(folder)
        allowed = f"a folder without files of these names{unchanged}"
        hint = "choose another folder, or pass `overwrite=True` to replace these files"
        value = name_list(existing, MAX_NAMED)
        raise OutputError(problem, where=location, given=value, allowed=allowed, hint=hint)
    return target


def write_folder(
    folder: str | Path,
    files: Mapping[str, bytes],
    *,
    inputs: Iterable[Path] = (),
    overwrite: bool = False,
    listed: bool = False,
) -> Path:
    """Write files (name -> content) into a folder, made if need be: all of them, or none.

    They are written beside their places first, so that a full disk leaves the folder as it was. Other files
    in the folder stay.

    listed: files keep their places in it. Raises OutputError: as check_folder, and if the disk is full.
    """
    names = [*files, LIST_FILE] if listed else list(files)
    target = check_folder(folder, names, inputs=inputs, overwrite=overwrite, listed=listed)
    hashes = {name: {hashlib.sha256(content).hexdigest()} for name, content in files.items()}
    hashes = {name: old for name, old in _read_list(target).items() if (target / name).exists()} | hashes
    contents = dict(files) | ({LIST_FILE: _format_list(hashes)} if listed else {})
    try:
        if target.is_dir():
            _exchange(target, contents, hashes if listed else {})
        else:
            # Write a new folder beside its place and move it there
            with _parents(target), work_folder(target.parent, sweep=True) as work:
                _write_all(work / NEW, contents)
                (work / NEW).rename(target)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise explain_unwritable(folder, reason, "folder") from error
    return target


def _exchange(target: Path, contents: Mapping[str, bytes], hashes: Mapping[str, set[str]]) -> None:
    """Write all files into a folder inside `target`, then move each to its place; undo that on any error.

    The list with the old and the new hashes goes first: whatever ends this half-way, the files are known.
    """
    with work_folder(target, sweep=True) as work:
        _write_all(work / NEW, contents)
        if hashes:
            old_hashes = _read_list(target)
            merged = {name: hashes[name] | old_hashes.get(name, set()) for name in hashes}
            (work / NEW / LIST_FILE).rename(work / LIST_FILE)
            (work / NEW / LIST_FILE).write_bytes(_format_list(merged))
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
    made, path = [], target.absolute().parent
    while not path.exists():
        made.append(path)
        path = path.parent
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise


def _is_listed(path: Path, known: Mapping[str, set[str]]) -> bool:
    """Return whether a file is as the list of its folder says; the list itself, where all of it is one."""
    if path.is_symlink() or not path.is_file():
        return False
    if path.name == LIST_FILE:
        return bool(known)
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() in known.get(path.name, ())
    except OSError:
        return False


def _read_list(folder: Path) -> dict[str, set[str]]:
    """Return file name -> sha256 values that the list in a folder gives; empty if there is none."""
    try:
        lines = (folder / LIST_FILE).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return {}
    hashes: dict[str, set[str]] = {}
    for line in lines:
        digest, _, name = line.partition("  ")
        if not name or len(digest) != 64:  # a list of another kind
            return {}
        hashes.setdefault(name, set()).add(digest)
    return hashes


def _format_list(known: Mapping[str, set[str]]) -> bytes:
    """Return the text of a list, in the form of `sha256sum`."""
    lines = [f"{digest}  {name}\n" for name in sorted(known) for digest in sorted(known[name])]
    return "".join(lines).encode("utf-8")
