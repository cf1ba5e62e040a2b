"""A store that is being written: each task once, its chunks whole, then its record."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import OutputError
from tensegrity_codegen.extras import SWEEP, import_extra
from tensegrity_codegen.long_work.forked import deferred_signals
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.contents import MESSAGE, RECORD, STATUS
from tensegrity_codegen.sweeps.store.folder import ATTRIBUTE, find_finished, read_stored_sweep
from tensegrity_codegen.sweeps.tasks.operation import TaskResult

__all__ = ["SweepStore"]

PARTIAL = ".partial"  # ending of the temporary files of Zarr's store
CHUNKS = "c"  # folder of an array's chunks


class SweepStore:
    """The folder of a sweep, open for writing by this process alone.

    A task is written in this order: each of its chunks under a temporary name that is then replaced by its
    own, all of them flushed to the disk, then the record. A task without a record counts as not computed;
    it is computed and written again, whatever there is of it.

    Parameters
    ----------
    path : str or Path
        The folder, which exists.

    Raises
    ------
    MissingExtraError
        Zarr is not installed.
    OutputError
        The folder is not a sweep.
    """

    def __init__(self, path: str | Path) -> None:
        zarr = import_extra("zarr", SWEEP)
        stored = read_stored_sweep(path)
        self.path = Path(path)
        self._group = zarr.open_group(str(self.path), mode="r+", zarr_format=3, use_consolidated=False)
        self._arrays: dict[str, Any] = {}
        status = self._array(STATUS)
        self.layout = CaseLayout(tuple(status.shape), tuple(status.chunks))
        self.keys: Mapping[str, str] = stored.attributes[ATTRIBUTE]["keys"]
        _remove_partial(self.path)

    def find_finished(self) -> frozenset[int]:
        """Return the numbers of the tasks that have a record."""
        return find_finished(self.path)

    def read_record(self, task: int) -> dict[str, Any]:
        """Return the record of a finished task."""
        record: dict[str, Any] = json.loads(str(self._array(RECORD)[task]))
        return record

    def count_statuses(self) -> dict[int, int]:
        """Return how many cases have each code of status among those that are finished."""
        counts: dict[int, int] = {}
        array = self._array(STATUS)
        for task in self.find_finished():
            codes, numbers = np.unique(array[self.layout.box_of(task)], return_counts=True)
            for code, number in zip(codes.tolist(), numbers.tolist(), strict=True):
                counts[code] = counts.get(code, 0) + number
        return counts

    def write(self, task: int, result: TaskResult, record: Mapping[str, Any]) -> None:
        """Write the results of a task, then its record; signals wait until that is done.

        Raises
        ------
        OutputError
            The disk is full, or the folder cannot be written any more; nothing of the task is left, and
            what was written before stays readable.
        """
        first, last = self.layout.cases_of(task)
        facts = json.dumps({"first": first, "last": last, **record})
        values = {
            **result.arrays,
            STATUS: result.status,
            MESSAGE: np.array(result.messages, dtype=object),
        }
        with deferred_signals():
            try:
                for name, array in values.items():
                    self._write_box(name, task, array)
                _flush([self._chunk_file(name, task) for name in values])
                self._array(RECORD)[task : task + 1] = np.array([facts], dtype=object)
                _flush([self._chunk_file(RECORD, task)])
            except OSError as error:
                self._remove(task, (RECORD, *values))
                raise _explain(self.path, error) from error

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            self._arrays[name] = self._group[name]
        return self._arrays[name]

    def _write_box(self, name: str, task: int, values: NDArray[Any]) -> None:
        array, box = self._array(name), self.layout.box_of(task)
        if name == MESSAGE and not any(values):  # as most often: an absent chunk is full of empty texts
            self._chunk_file(name, task).unlink(missing_ok=True)
            return
        shape = tuple(part.stop - part.start for part in box)
        array[box] = values.reshape(*shape, *array.shape[len(shape) :])

    def _chunk_file(self, name: str, task: int) -> Path:
        place = (task,) if name == RECORD else self.layout.place_of(task)
        rest = self._array(name).ndim - len(place)
        return self.path.joinpath(name, CHUNKS, *map(str, place), *["0"] * rest)

    def _remove(self, task: int, names: tuple[str, ...]) -> None:
        for name in names:
            with suppress(OSError):
                self._chunk_file(name, task).unlink(missing_ok=True)
        _remove_partial(self.path)


def _flush(files: list[Path]) -> None:
    """Wait until files, and that they are in their folders, are on the disk.

    Chunks in which all is the fill value have no file.
    """
    folders = set()
    for path in files:
        with suppress(FileNotFoundError):
            _flush_one(path)
            folders.add(path.parent)
    if os.name == "posix":
        for folder in folders:
            _flush_one(folder)


def _flush_one(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _remove_partial(folder: Path) -> None:
    """Remove the temporary files that a killed process left."""
    for path in _find_partial(folder):
        with suppress(OSError):
            path.unlink()


def _find_partial(folder: Path) -> Iterator[Path]:
    for place, _, names in os.walk(folder):
        yield from (Path(place, name) for name in names if name.endswith(PARTIAL))


def _explain(path: Path, error: OSError) -> OutputError:
    try:
        free = f"{shutil.disk_usage(path).free / 1e6:.0f} MB free"
    except OSError:
        free = ""
    reason = error.strerror or type(error).__name__
    return OutputError(
        f"the results cannot be written: {reason}",
        where=str(path),
        given=free or None,
        allowed="a folder with enough free space that may be written to",
        hint="make room and run the same command again: it goes on where it stopped, "
        "and what is finished stays readable",
    )
