"""A new store of a sweep: its folder, with all metadata and coordinates, appears at once or not at all."""

import json
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.sweeps.store.contents import StoreContents, StoredArray
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
    METADATA,
    StoredSweep,
    compute_checksum,
    is_whole,
)
from tensegrity_codegen.sweeps.store.store import open_group, writing_empty_chunks
from tensegrity_codegen.system.extras import SWEEP, import_extra
from tensegrity_codegen.system.files import explain_unwritable
from tensegrity_codegen.system.temporary_files import work_folder


def create_store(path: str | Path, contents: StoreContents) -> None:
    """Make the folder of a sweep without results.

    Raises
    ------
    MissingExtraError
        Zarr is not installed.
    OutputError
        The folder exists already and is not empty, or cannot be made.
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

    Raises
    ------
    OutputError
        They cannot be written.
    """
    if all(map(is_whole, stored.coordinate_files)):
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
