"""The store of a sweep: its folder, with all metadata and coordinates, appears at once or not at all.

Then each task is written once, its chunks whole and with checksums, then its record.
"""

import json
import os
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.record import Output, TaskResult
from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED, STATUSES
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
    FORMAT,
    MESSAGE,
    METADATA,
    RECORD,
    STATUS,
    StoredSweep,
    compute_checksum,
    find_finished,
    read_stored_sweep,
)
from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.extras import SWEEP, import_extra
from tensegrity_codegen.system.files import explain_unwritable
from tensegrity_codegen.system.forked import deferred_signals
from tensegrity_codegen.system.temporary_files import work_folder

TASK = "task"
NOT_COMPUTED_CODE = -1  # status of a case whose task is not finished
OWN_NAMES = (STATUS, MESSAGE, RECORD, TASK, "case", "sample")
TEXT = "string"


@dataclass(frozen=True, eq=False)
class StoredArray:
    """One array of a store.

    shape, chunks: its size, and the size of its chunks, along each.
    """

    name: str  # its name
    dims: tuple[str, ...]  # names of its dimensions
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str  # ``"string"``, or a type of NumPy
    fill: Any  # the value of unwritten entries
    attributes: dict[str, Any]  # units and description
    values: NDArray[Any] | None = None  # its initial content; None for results


@dataclass(frozen=True, eq=False)
class StoreContents:
    """Cases and results of a sweep, as they are stored.

    identity: what the results follow from, JSON-ready: another sweep has another identity; facts: what
    else is known of it, JSON-ready: attributes of the data set.
    """

    cases: Cases
    layout: CaseLayout  # how they lie in the arrays
    outputs: tuple[Output, ...]  # results of a case
    identity: Mapping[str, Any]
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def case_dims(self) -> tuple[str, ...]:
        """Dimensions of the cases: the axes of the grid, then "sample"; "case" without a grid."""
        axes = tuple(self.name_key(axis.key) for axis in self.cases.axes)
        if self.cases.points is None:
            return axes
        return (*axes, "sample") if axes else ("case",)

    @property
    def output_dims(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of each result besides the cases; where two differ under one name, the name is added."""
        axes: dict[str, tuple[int, tuple[Any, ...]]] = {}
        named = {}
        for output in self.outputs:
            dims = []
            for dim, size in zip(output.dims, output.shape, strict=True):
                axis = (size, tuple(output.coordinates.get(dim, ())))
                dims.append(dim if axes.setdefault(dim, axis) == axis else f"{dim}_of_{output.name}")
            named[output.name] = tuple(dims)
        return named

    def name_key(self, key: str) -> str:
        """Return the name of the coordinate of a key: the key, unless a result has that name."""
        used_names = {*OWN_NAMES, *(name for output in self.outputs for name in (output.name, *output.dims))}
        return f"varied.{key}" if key in used_names else key

    def list_arrays(self) -> list[StoredArray]:
        """Return all arrays but the values of a sample or table."""
        sentence = {"long_name": "JSON of each finished task: its cases, time, attempts and machine"}
        return [
            *self._axes(),
            *self._labels(),
            *self._results(),
            StoredArray(RECORD, (TASK,), (self.layout.n_tasks,), (1,), TEXT, "", sentence),
        ]

    def list_key_arrays(self) -> list[StoredArray]:
        """Return the arrays of the values of a sample or table, one a key."""
        points = self.cases.points
        if points is None:
            return []
        chunk = (max(self.layout.chunk[-1], min(points.count, 2**16)),)
        return [
            StoredArray(
                name, self.case_dims[-1:], (points.count,), chunk, "float64", np.nan, self._describe_key(key)
            )
            for key, name in zip(points.keys, map(self.name_key, points.keys), strict=True)
        ]

    def list_attributes(self) -> dict[str, Any]:
        """Return the attributes of the data set."""
        names = [array.name for array in self.list_key_arrays()]
        coordinates = {"coordinates": " ".join(names)} if names else {}
        sweep = {
            "format": FORMAT,
            "identity": dict(self.identity),
            "task_size": self.layout.task_size,
            "case_dims": list(self.case_dims),
            "keys": {key: self.name_key(key) for key in self.cases.keys},
        }
        return {**self.facts, **coordinates, ATTRIBUTE: sweep}

    def _describe_key(self, key: str) -> dict[str, Any]:
        attributes: Mapping[str, dict[str, Any]] = self.facts.get("key_attributes", {})
        return dict(attributes.get(key, {"long_name": f"{key} of the scene"}))

    def _axes(self) -> Iterator[StoredArray]:
        for axis in self.cases.axes:
            name = self.name_key(axis.key)
            yield _whole(name, (name,), axis.values, self._describe_key(axis.key))

    def _labels(self) -> Iterator[StoredArray]:
        done = set()
        for output in self.outputs:
            for dim, name in zip(output.dims, self.output_dims[output.name], strict=True):
                labels = output.coordinates.get(dim)
                if labels is not None and name not in done:
                    done.add(name)
                    unit = {"units": "s"} if dim == "time" else {}
                    yield _whole(name, (name,), np.asarray(labels), unit)

    def _results(self) -> Iterator[StoredArray]:
        shape, chunk, dims = self.layout.shape, self.layout.chunk, self.case_dims
        statuses = [NOT_COMPUTED, *STATUSES]
        flags = {"flag_values": list(range(-1, len(STATUSES))), "flag_meanings": " ".join(statuses)}
        sentence = {"long_name": "how the case ended", **flags}
        yield StoredArray(STATUS, dims, shape, chunk, "int8", NOT_COMPUTED_CODE, sentence)
        sentence = {"long_name": "why the case ended so, where there is something to say"}
        yield StoredArray(MESSAGE, dims, shape, chunk, TEXT, "", sentence)
        for output in self.outputs:
            attributes = {"units": output.unit, "long_name": output.sentence}
            attributes |= {"expression": output.expression} if output.expression else {}
            is_float = np.dtype(output.dtype).kind == "f"
            yield StoredArray(
                output.name,
                (*dims, *self.output_dims[output.name]),
                (*shape, *output.shape),
                (*chunk, *(max(size, 1) for size in output.shape)),
                output.dtype,
                np.nan if is_float else -1,
                attributes,
            )


def _whole(name: str, dims: tuple[str, ...], values: NDArray[Any], attributes: dict[str, Any]) -> StoredArray:
    is_text = values.dtype.kind in "UO"
    dtype, fill = (TEXT, "") if is_text else (values.dtype.name, np.nan if values.dtype.kind == "f" else 0)
    chunks = tuple(max(size, 1) for size in values.shape)
    return StoredArray(name, dims, values.shape, chunks, dtype, fill, attributes, values)


PARTIAL = ".partial"  # ending of the temporary files of Zarr's store


class SweepStore:
    """The folder of a sweep, open for writing by this process alone.

    A task is written in this order: each of its chunks under a temporary name that is then replaced by its
    own, all of them flushed to the disk, then the record. A task without a record counts as not computed;
    it is computed and written again, whatever there is of it.

    path: the folder, which exists. Raises MissingExtraError: zarr is not installed; OutputError: the folder
    is not a sweep.
    """

    def __init__(self, path: str | Path) -> None:
        self._stored = read_stored_sweep(path)
        self.path, self.layout = self._stored.path, self._stored.layout
        self.keys: Mapping[str, str] = self._stored.attributes[ATTRIBUTE]["keys"]
        self._group = open_group(self._stored, "r+")
        self._arrays: dict[str, Any] = {}
        # Temporary files that a killed process left are removed.
        for folder, _, names in os.walk(self.path):
            for name in names:
                if name.endswith(PARTIAL):
                    with suppress(OSError):
                        Path(folder, name).unlink()

    def find_finished(self) -> frozenset[int]:
        """Return the numbers of the tasks that have a record and of which no file is damaged."""
        return find_finished(self.path)

    def has_record(self, task: int) -> bool:
        """Return whether a task was finished once, whatever became of its files."""
        return os.path.lexists(self._stored.chunk_file(RECORD, task))

    def read_record(self, task: int) -> dict[str, Any]:
        """Return the record of a finished task."""
        record: dict[str, Any] = json.loads(str(self._array(RECORD)[task]))
        return record

    def count_statuses(self, tasks: Iterable[int]) -> dict[int, int]:
        """Return how many cases of finished tasks have each code of status."""
        counts: dict[int, int] = {}
        array = self._array(STATUS)
        for task in tasks:
            codes, numbers = np.unique(array[self.layout.box_of(task)], return_counts=True)
            for code, number in zip(codes.tolist(), numbers.tolist(), strict=True):
                counts[code] = counts.get(code, 0) + number
        return counts

    def count_above(self, name: str, most: float = 1.0) -> int:
        """Return how many finished cases have a number above `most`, 0 without this result."""
        if name not in self._group:
            return 0
        boxes = (self._array(name)[self.layout.box_of(task)] for task in self.find_finished())
        return sum(int((values > most).sum()) for values in boxes)

    def is_empty(self, name: str) -> bool:
        """Return whether a result is NaN in every finished case."""
        boxes = (self._array(name)[self.layout.box_of(task)] for task in self.find_finished())
        return all(bool(np.isnan(values).all()) for values in boxes)

    def write(self, task: int, result: TaskResult, record: Mapping[str, Any]) -> None:
        """Write a task, then its record, signals held; raises OutputError and leaves nothing of the task."""
        start, stop = self.layout.cases_of(task)
        facts = json.dumps({"first": start, "last": stop, **record})
        values = {**result.arrays, MESSAGE: np.array(result.messages, dtype=object), STATUS: result.status}
        with deferred_signals():
            self._remove(task)  # damaged files, or files without a record
            try:
                box = self.layout.box_of(task)
                shape = tuple(span.stop - span.start for span in box)
                for name, array in values.items():
                    stored = self._array(name)
                    stored[box] = array.reshape(*shape, *stored.shape[len(shape) :])
                _flush([self._stored.chunk_file(name, task) for name in self._stored.results])
                self._array(RECORD)[task : task + 1] = np.array([facts], dtype=object)
                _flush([self._stored.chunk_file(RECORD, task)])
            except OSError as error:
                self._remove(task)
                raise _explain(self.path, error) from error

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            with writing_empty_chunks():
                self._arrays[name] = self._group[name]
        return self._arrays[name]

    def _remove(self, task: int) -> None:
        """Remove the files of a task, its record and its status first."""
        for name in (RECORD, *reversed(self._stored.results)):
            with suppress(OSError):
                self._stored.chunk_file(name, task).unlink(missing_ok=True)


def open_group(stored: StoredSweep, mode: str = "r") -> Any:
    """Return a stored sweep as a group of Zarr, with the metadata that `read_stored_sweep` verified."""
    zarr = import_extra("zarr", SWEEP)
    return zarr.open_group(str(stored.path), mode=mode, zarr_format=3, use_consolidated=True)


def writing_empty_chunks() -> Any:
    """Let arrays that are opened in the block write chunks of fill values too: one that is absent is lost."""
    return import_extra("zarr", SWEEP).config.set({"array.write_empty_chunks": True})


def _flush(files: list[Path]) -> None:
    """Wait until files, and that they are in their folders, are on the disk."""
    for path in files:
        _flush_one(path)
    if os.name == "posix":
        for folder in {path.parent for path in files}:
            _flush_one(folder)


def _flush_one(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _explain(path: Path, error: OSError) -> OutputError:
    try:
        free = f"{shutil.disk_usage(path).free / 1e6:.0f} MB free"
    except OSError:
        free = ""
    reason = error.strerror or type(error).__name__
    return OutputError(
        f"the results cannot be written: {reason}",
        where=str(error.filename2 or error.filename or path),
        given=free or None,
        allowed="a folder with enough free space that may be written to",
        hint="make room and run the same command again: it goes on where it stopped, "
        "and what is finished stays readable",
    )


def create_store(path: str | Path, contents: StoreContents) -> None:
    """Make the folder of a sweep without results."""
    target = Path(path).absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with work_folder(target.parent, sweep=True) as temporary:
            unfinished = temporary / "new.zarr"
            _write_metadata(unfinished, contents)
            if target.is_dir():
                target.rmdir()  # an empty folder; any other raises
            elif os.path.lexists(target):
                raise FileExistsError(17, "there is something of this name")
            unfinished.rename(target)
    except OSError as error:
        raise explain_unwritable(path, error.strerror or type(error).__name__, "folder") from error


def _write_metadata(folder: Path, contents: StoreContents) -> None:
    zarr = import_extra("zarr", SWEEP)
    group = zarr.create_group(str(folder), zarr_format=3, attributes=contents.list_attributes())
    for array in [*contents.list_arrays(), *contents.list_key_arrays()]:
        _create_array(group, array)
    _write_coordinates(group, contents)
    with warnings.catch_warnings():  # Zarr's reader finds all arrays in one file; other readers ignore it
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(str(folder), zarr_format=3)
    metadata = json.loads((folder / METADATA).read_bytes())
    metadata["attributes"][ATTRIBUTE]["checksum"] = compute_checksum(metadata)
    (folder / METADATA).write_text(json.dumps(metadata, indent=2), encoding="utf-8")


def restore_coordinates(stored: StoredSweep, contents: StoreContents) -> None:
    """Write the values of keys and labels of a sweep again if files of them are damaged."""
    if all(map(stored.is_whole, stored.coordinate_files)):
        return
    try:
        for file in stored.coordinate_files:
            file.unlink(missing_ok=True)
        _write_coordinates(open_group(stored, "r+"), contents)
    except OSError as error:
        raise explain_unwritable(error.filename or stored.path, error.strerror or "an error") from error


def _write_coordinates(group: Any, contents: StoreContents) -> None:
    """Write labels and grid values; of a sample or table the values of each key, chunk by chunk."""
    with writing_empty_chunks():
        for entry in contents.list_arrays():
            if entry.values is not None and entry.values.size:
                values = entry.values.astype(object) if entry.dtype == TEXT else entry.values
                group[entry.name][...] = values
        if contents.cases.points is not None:
            sampled = contents.cases.points
            key_arrays = [group[entry.name] for entry in contents.list_key_arrays()]
            chunk_size = key_arrays[0].chunks[0]
            for start in range(0, sampled.count, chunk_size):
                stop = min(start + chunk_size, sampled.count)
                for key_array, key_values in zip(key_arrays, sampled.values(start, stop).T, strict=True):
                    key_array[start:stop] = key_values


def _create_array(group: Any, item: StoredArray) -> Any:
    return group.create_array(
        item.name,
        shape=item.shape,
        chunks=item.chunks,
        dtype=str if item.dtype == "string" else np.dtype(item.dtype),
        dimension_names=item.dims,
        fill_value=item.fill,
        attributes=item.attributes,
        compressors=_find_codecs(item.dtype),
    )


def _find_codecs(dtype: str) -> Any:
    """Return the fastest compressor of Zarr's specification, LZ4 of shuffled bytes, and a checksum."""
    codecs = import_extra("zarr.codecs", SWEEP)
    if dtype == "string":
        return codecs.ZstdCodec(level=1), codecs.Crc32cCodec()
    size = np.dtype(dtype).itemsize
    shuffle = "shuffle" if size > 1 else "noshuffle"
    return codecs.BloscCodec(typesize=size, cname="lz4", clevel=5, shuffle=shuffle), codecs.Crc32cCodec()
