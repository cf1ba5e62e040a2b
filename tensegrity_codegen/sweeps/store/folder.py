"""The folder of a store before it is opened: which sweep it is, whether it is whole, whether it is in use."""

import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.chunks import check_array, is_whole
from tensegrity_codegen.system.errors import OutputError, suggest
from tensegrity_codegen.system.extras import SWEEP, import_extra
from tensegrity_codegen.system.files import check_ending, explain_unwritable
from tensegrity_codegen.system.output_folder import check_folder

ATTRIBUTE = "tensegrity_codegen_sweep"
FORMAT = 2
METADATA = "zarr.json"
STATUS, MESSAGE, RECORD = "status", "message", "task_record"
ENDING = ".zarr"
MOST_NAMED = 4


@dataclass(frozen=True)
class StoredSweep:
    """What the folder of a sweep says of it.

    path: the folder; identity: what its results follow from; task_size: largest number of cases of a task;
    attributes: all attributes of the data set; arrays: metadata of each array.
    """

    path: Path
    identity: Mapping[str, Any]
    task_size: int
    attributes: Mapping[str, Any]
    arrays: Mapping[str, Mapping[str, Any]] = field(repr=False)

    @cached_property
    def layout(self) -> CaseLayout:
        """How the cases lie in the arrays."""
        return CaseLayout(tuple(self.arrays[STATUS]["shape"]), self._chunk(STATUS))

    @cached_property
    def results(self) -> tuple[str, ...]:
        """Names of the arrays with a chunk for each task, in the order of writing: the status is last."""
        own = self.attributes[ATTRIBUTE]
        dims, keys = own["case_dims"], own["keys"].values()
        found = [
            name
            for name, array in self.arrays.items()
            if name not in (STATUS, MESSAGE, *keys)
            and array["dimension_names"][: len(dims)] == dims
            and 0 not in array["shape"]
        ]
        return (*found, MESSAGE, STATUS)

    @cached_property
    def coordinate_files(self) -> tuple[Path, ...]:
        """Chunks of the values of keys and of labels, which are written with a new folder."""
        files = []
        for name in sorted(self.arrays.keys() - {*self.results, RECORD}):
            sizes = zip(self.arrays[name]["shape"], self._chunk(name), strict=True)
            places = itertools.product(*(range(-(-size // part)) for size, part in sizes))
            files += [self._chunk_file(name, place) for place in places]
        return tuple(files)

    def chunk_file(self, name: str, task: int) -> Path:
        """Return the file of a result of a task, of its status or record."""
        place = (task,) if name == RECORD else self.layout.place_of(task)
        return self._chunk_file(name, (*place, *[0] * (len(self.arrays[name]["shape"]) - len(place))))

    def is_whole(self, file: Path) -> bool:
        """Return whether a chunk is as it was written."""
        return is_whole(file, self.arrays[file.relative_to(self.path).parts[0]])

    def _chunk(self, name: str) -> tuple[int, ...]:
        return tuple(self.arrays[name]["chunk_grid"]["configuration"]["chunk_shape"])

    def _chunk_file(self, name: str, place: tuple[int, ...]) -> Path:
        return self.path.joinpath(name, "c", *map(str, place))


def check_store_folder(path: str | Path) -> StoredSweep | None:
    """Return the sweep in a folder, None where there is nothing yet.

    Raises OutputError: the folder cannot be made or written, or holds something else.
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
        found = attributes[ATTRIBUTE]["format"]
        arrays = data["consolidated_metadata"]["metadata"] if found == FORMAT else {}
        for array in arrays.values():
            check_array(array)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        new = ", or a new name for another one" if is_output else ""
        reason = f": {METADATA} is damaged or of another program" if (folder / METADATA).exists() else ""
        raise OutputError(
            f"this is not a sweep{reason}" if folder.exists() else "there is no such folder",
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
    own = attributes[ATTRIBUTE]
    if own.get("checksum") != compute_checksum(data):
        raise OutputError(
            "this file is damaged or was edited: its checksum is not that of its content",
            where=str(folder / METADATA),
            allowed="the file as `sweep` wrote it",
            hint="restore it from a copy, or remove the folder and run the sweep again",
        )
    return StoredSweep(folder, own["identity"], own["task_size"], attributes, arrays)


def compute_checksum(metadata: Mapping[str, Any]) -> str:
    """Return the sha256 of what is read from a file of metadata: the sweep and its arrays."""
    own = {key: value for key, value in metadata["attributes"][ATTRIBUTE].items() if key != "checksum"}
    content = [own, metadata.get("consolidated_metadata")]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _suggest_near(folder: Path) -> str:
    """Return a hint that lists the sweeps beside a folder that is none."""
    place = folder if folder.is_dir() else folder.parent
    with suppress(OSError):
        found = [path.name for path in place.iterdir() if path.suffix == ENDING and path != folder]
        return f"in {place.absolute()}: {suggest(folder.name, found)}" if found else ""
    return ""


def find_finished(path: str | Path) -> frozenset[int]:
    """Return the numbers of the tasks in a folder that have a record and of which no file is damaged."""
    if not (Path(path) / METADATA).exists():
        return frozenset()
    stored = read_stored_sweep(path)
    return frozenset(
        task
        for task in range(stored.layout.n_tasks)
        if all(stored.is_whole(stored.chunk_file(name, task)) for name in (RECORD, *stored.results))
    )


def find_damaged(stored: StoredSweep) -> list[Path]:
    """Return the files that are not as they were written, or are missing: of coordinates and results."""
    damaged = [file for file in stored.coordinate_files if not stored.is_whole(file)]
    for task in range(stored.layout.n_tasks):
        is_computed = any(os.path.lexists(stored.chunk_file(name, task)) for name in (STATUS, RECORD))
        files = [stored.chunk_file(name, task) for name in stored.results]
        damaged += [
            file for file in files if (is_computed or os.path.lexists(file)) and not stored.is_whole(file)
        ]
    return damaged


def check_not_damaged(stored: StoredSweep) -> None:
    """Raise OutputError, naming files, where a stored sweep is not as it was written."""
    damaged = [str(file.relative_to(stored.path)) for file in find_damaged(stored)]
    if damaged:
        more = [f"{len(damaged) - MOST_NAMED} more"] if len(damaged) > MOST_NAMED else []
        raise OutputError(
            "files of results are damaged or missing",
            where=str(stored.path),
            given=", ".join(damaged[:MOST_NAMED] + more),
            allowed="files as `sweep` wrote them",
            hint="run the same sweep again with this folder: it computes again what is damaged",
        )


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


def open_sweep(path: str | Path) -> Any:
    """Open the results of a sweep, finished or not; arrays are verified, and read when they are used.

    path: the folder that `sweep` wrote. Returns one variable a quantity, units and description in its
    attributes; dimensions are the axes of the grid or ``case``, then ``time``, ``node``, ``member``. Cases
    that are not computed yet have the status -1. Raises MissingExtraError: xarray or Zarr is not installed;
    OutputError: the folder is not a sweep, or files in it are damaged or missing.
    """
    stored = read_stored_sweep(path)
    check_not_damaged(stored)
    import_extra("zarr", SWEEP)
    xarray = import_extra("xarray", SWEEP)
    found = xarray.open_zarr(str(stored.path), chunks=None, consolidated=True, zarr_format=3)
    return found.drop_vars(RECORD)
