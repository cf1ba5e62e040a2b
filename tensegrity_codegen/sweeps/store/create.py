"""Make the folder of a new sweep: all of its metadata and coordinates, or nothing."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.extras import SWEEP, import_extra
from tensegrity_codegen.files import explain_unwritable
from tensegrity_codegen.sweeps.cases.points import Points
from tensegrity_codegen.sweeps.store.contents import StoreContents, StoredArray
from tensegrity_codegen.work_folder import work_folder

__all__ = ["create_store"]


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
        with work_folder(target.parent, sweep=True) as work:
            new = work / "new.zarr"
            _write_metadata(new, contents)
            if target.is_dir():
                target.rmdir()  # an empty folder; any other raises
            elif os.path.lexists(target):
                raise FileExistsError(17, "there is something of this name")
            new.rename(target)
    except OSError as error:
        raise explain_unwritable(path, error.strerror or type(error).__name__, "folder") from error


def _write_metadata(folder: Path, contents: StoreContents) -> None:
    zarr = import_extra("zarr", SWEEP)
    group = zarr.create_group(str(folder), zarr_format=3, attributes=contents.list_attributes())
    for item in contents.list_arrays():
        array = _create_array(group, item)
        if item.values is not None and item.values.size:
            array[...] = item.values.astype(object) if item.dtype == "string" else item.values
    if contents.cases.points is not None:
        arrays = [_create_array(group, item) for item in contents.list_points()]
        _write_points(contents.cases.points, arrays)
    with warnings.catch_warnings():  # Zarr's reader finds all arrays in one file; other readers ignore it
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(str(folder), zarr_format=3)


def _create_array(group: Any, item: StoredArray) -> Any:
    return group.create_array(
        item.name,
        shape=item.shape,
        chunks=item.chunks,
        dtype=str if item.dtype == "string" else np.dtype(item.dtype),
        dimension_names=item.dims,
        fill_value=item.fill,
        attributes=item.attributes,
        compressors=_find_compressor(item.dtype),
    )


def _find_compressor(dtype: str) -> Any:
    """Return the fastest of the codecs of Zarr's core specification: LZ4 after the bytes are shuffled."""
    codecs = import_extra("zarr.codecs", SWEEP)
    if dtype == "string":
        return codecs.ZstdCodec(level=1)
    size = np.dtype(dtype).itemsize
    return codecs.BloscCodec(
        typesize=size, cname="lz4", clevel=5, shuffle="shuffle" if size > 1 else "noshuffle"
    )


def _write_points(points: Points, arrays: list[Any]) -> None:
    part = arrays[0].chunks[0]
    for first in range(0, points.count, part):
        last = min(first + part, points.count)
        for array, column in zip(arrays, points.values(first, last).T, strict=True):
            array[first:last] = column
