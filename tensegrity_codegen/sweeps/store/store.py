"""The store of a sweep: its folder, with all metadata and coordinates, appears at once or not at all.

Then each task is written once, its chunks whole and with checksums, then its record.
"""

import json
import os
import shutil
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.record import TaskResult
from tensegrity_codegen.sweeps.store.contents import StoreContents, StoredArray
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
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
        for place, _, names in os.walk(self.path):
            for name in names:
                if name.endswith(PARTIAL):
                    with suppress(OSError):
                        Path(place, name).unlink()

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
        """Return how many finished cases have a number above `most`, 0 where it is not kept."""
        if name not in self._group:
            return 0
        boxes = (self._array(name)[self.layout.box_of(task)] for task in self.find_finished())
        return sum(int((values > most).sum()) for values in boxes)

    def is_empty(self, name: str) -> bool:
        """Return whether a result is NaN in every finished case."""
        boxes = (self._array(name)[self.layout.box_of(task)] for task in self.find_finished())
        return all(bool(np.isnan(values).all()) for values in boxes)

    def write(self, task: int, result: TaskResult, record: Mapping[str, Any]) -> None:
        """Write the results of a task, then its record; signals wait until that is done.

        Raises OutputError: the disk is full, or the folder cannot be written any more; nothing of the task is
        left, and what was written before stays readable.
        """
        first, last = self.layout.cases_of(task)
        facts = json.dumps({"first": first, "last": last, **record})
        values = {
            **result.arrays,
            MESSAGE: np.array(result.messages, dtype=object),
            STATUS: result.status,
        }
        with deferred_signals():
            self._remove(task)  # what is damaged, or was written without its record
            try:
                box = self.layout.box_of(task)
                shape = tuple(part.stop - part.start for part in box)
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
    """Make the folder of a sweep without results.

    Raises MissingExtraError: zarr is not installed; OutputError: the folder exists already and is not empty,
    or cannot be made.
    """
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
    for item in [*contents.list_arrays(), *contents.list_key_arrays()]:
        _create_array(group, item)
    _write_coordinates(group, contents)
    with warnings.catch_warnings():  # Zarr's reader finds all arrays in one file; other readers ignore it
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(str(folder), zarr_format=3)
    metadata = json.loads((folder / METADATA).read_bytes())
    metadata["attributes"][ATTRIBUTE]["checksum"] = compute_checksum(metadata)
    (folder / METADATA).write_text(json.dumps(metadata, indent=2), encoding="utf-8")


def restore_coordinates(stored: StoredSweep, contents: StoreContents) -> None:
    """Write the values of keys and labels of a sweep again where files of them are damaged.

    Raises OutputError: they cannot be written.
    """
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
        for item in contents.list_arrays():
            if item.values is not None and item.values.size:
                group[item.name][...] = item.values.astype(object) if item.dtype == "string" else item.values
        if contents.cases.points is not None:
            sampled = contents.cases.points
            key_arrays = [group[item.name] for item in contents.list_key_arrays()]
            chunk_size = key_arrays[0].chunks[0]
            for first in range(0, sampled.count, chunk_size):
                last = min(first + chunk_size, sampled.count)
                for key_array, key_values in zip(key_arrays, sampled.values(first, last).T, strict=True):
                    key_array[first:last] = key_values


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
