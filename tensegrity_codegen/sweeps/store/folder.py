"""The folder of a store before it is opened: whether it is a sweep, which one, and whether it is in use."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from tensegrity_codegen.errors import OutputError, suggest
from tensegrity_codegen.files import check_ending, explain_unwritable
from tensegrity_codegen.output_folder import check_folder

__all__ = [
    "ATTRIBUTE",
    "FORMAT",
    "StoredSweep",
    "check_store_folder",
    "check_store_name",
    "find_finished",
    "locked_store",
    "read_stored_sweep",
]

ATTRIBUTE = "tensegrity_codegen_sweep"
FORMAT = 1
METADATA = "zarr.json"
RECORDS = Path("task_record", "c")  # folder of the chunks of the records, one a task
ENDING = ".zarr"


@dataclass(frozen=True)
class StoredSweep:
    """What the folder of a sweep says of it.

    Attributes
    ----------
    path : Path
        The folder.
    identity : dict
        What its results follow from.
    task_size : int
        Largest number of cases of a task.
    attributes : dict
        All attributes of the data set.
    """

    path: Path
    identity: Mapping[str, Any]
    task_size: int
    attributes: Mapping[str, Any]


def check_store_folder(path: str | Path) -> StoredSweep | None:
    """Return the sweep in a folder, None where there is nothing yet.

    Raises
    ------
    OutputError
        The folder cannot be made or written, or holds something else.
    """
    check_store_name(path)
    target = check_folder(path)
    if not os.path.lexists(target) or (target.is_dir() and not any(target.iterdir())):
        return None
    return read_stored_sweep(target, is_output=True)


def check_store_name(path: Any) -> None:
    """Raise OutputError for what cannot be the name of a folder of results."""
    problem, given = "", str(path) if isinstance(path, Path) else path
    if not isinstance(path, str | Path):
        problem = "not the name of a folder"
    elif Path(path).name in ("", ".."):
        problem = "the name of the folder is empty, or leads to the current folder or one above"
    elif "\0" in str(path):
        problem = "the name of the folder has a zero character"
    if problem:
        raise OutputError(problem, where="out", given=given, allowed=f"a name that ends in {ENDING}")
    check_ending(path, ENDING)


def read_stored_sweep(path: str | Path, *, is_output: bool = False) -> StoredSweep:
    """Return what the folder of a sweep says of it; raises OutputError for any other folder.

    is_output: whether a sweep is to be written there; else it is only read, and near names are shown.
    """
    folder = Path(path)
    try:
        data = json.loads((folder / METADATA).read_bytes())
        attributes = data["attributes"]
        own = attributes[ATTRIBUTE]
        found = own["format"]
        stored = StoredSweep(folder, own["identity"], int(own["task_size"]), attributes)
    except (OSError, ValueError, KeyError, TypeError) as error:
        new = ", or a new name for another one" if is_output else ""
        raise OutputError(
            "this is not a sweep" if folder.exists() else "there is no such folder",
            where=str(path),
            allowed=f"a Zarr folder that `sweep` wrote{new}",
            hint="choose another name, or remove what is there" if is_output else _suggest_near(folder),
        ) from error
    if found != FORMAT:
        raise OutputError(
            "the sweep was written in another format of its folder",
            where=str(path),
            given=found,
            allowed=str(FORMAT),
            hint="use the version of tensegrity_codegen that wrote it, or choose another name",
        )
    return stored


def _suggest_near(folder: Path) -> str:
    """Return a hint that lists the sweeps beside a folder that is none."""
    place = folder if folder.is_dir() else folder.parent
    with suppress(OSError):
        found = [path.name for path in place.iterdir() if path.suffix == ENDING and path != folder]
        return f"in {place.absolute()}: {suggest(folder.name, found)}" if found else ""
    return ""


def find_finished(path: str | Path) -> frozenset[int]:
    """Return the numbers of the tasks that have a record in a folder."""
    try:
        with os.scandir(Path(path) / RECORDS) as items:
            return frozenset(int(item.name) for item in items if item.name.isdigit())
    except OSError:
        return frozenset()


@contextmanager
def locked_store(path: str | Path) -> Iterator[None]:
    """Keep other sweeps out of a folder; raises OutputError while one is at work there."""
    folder = Path(path).absolute()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise explain_unwritable(path, error.strerror or type(error).__name__, "folder") from error
    place = folder.with_name(f".{folder.name}.lock")
    lock = FileLock(str(place), timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        if not place.exists():
            raise explain_unwritable(path, "no file can be made there", "folder") from error
        raise OutputError(
            "another sweep is writing to this folder",
            where=str(path),
            hint="wait for its end, or choose another name",
        ) from error
    except (OSError, NotImplementedError):  # the file system has no locks
        yield
        return
    try:
        yield
    finally:
        place.unlink(missing_ok=True)
        lock.release()
