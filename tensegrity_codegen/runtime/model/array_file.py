"""Arrays in .npz files: written whole or not at all, read without trust."""

import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.files import check_ending, replaced

# Bytes of the arrays of a result file that are compressed: zlib takes about 1 s for 20 MB of them.
MOST_COMPRESSED = 64 * 2**20

MOST_UNPACKED = 8 * MOST_COMPRESSED  # bytes of compressed arrays that are read

# What NumPy and zipfile raise for damaged files: bad headers, lengths, checksums, methods, single arrays.
UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    AttributeError,
    TypeError,
    RuntimeError,
    MemoryError,
    BadZipFile,
    zlib.error,
)


def write_arrays(path: str | Path, arrays: Mapping[str, NDArray[Any]], *, overwrite: bool) -> None:
    """Write arrays to an .npz file, whole or not at all.

    Raises OutputError if it cannot be written, exists (without `overwrite`), or has another ending.

    Above MOST_COMPRESSED bytes they are not compressed, which would take longer than the simulation.
    """
    check_ending(path, ".npz")
    given: dict[str, Any] = dict(arrays)
    size = sum(np.asarray(array).nbytes for array in given.values())
    save = np.savez_compressed if size <= MOST_COMPRESSED else np.savez
    with replaced(path, overwrite=overwrite) as temporary, temporary.open("wb") as file:
        save(file, **given)


def read_arrays(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file by name: those of `names` that it has, and no other is read, or all.

    Raises one of UNREADABLE for what is no such file, and for arrays that would take far more memory than
    the file takes on the disk.
    """
    with _opened_archive(path) as archive:
        found = [name for name in archive.files if names is None or name in names]
        packed = [item for item in archive.zip.infolist() if item.compress_type != ZIP_STORED]
        size = sum(item.file_size for item in packed if item.filename.removesuffix(".npy") in found)
        if size > MOST_UNPACKED:
            raise ValueError(f"compressed arrays of {size >> 20} MB; up to {MOST_UNPACKED >> 20} MB are read")
        return {name: archive[name] for name in found}


def read_names(path: Path) -> tuple[str, ...]:
    """Return the names of the arrays of an .npz file; raises one of UNREADABLE for what is none."""
    with _opened_archive(path) as archive:
        return tuple(archive.files)


@contextmanager
def _opened_archive(path: Path) -> Iterator[Any]:
    # Opened here, since NumPy leaves a file open that turns out to be no archive.
    with path.open("rb") as file:
        if file.read(2) != b"PK":  # else NumPy speaks of pickled data
            raise BadZipFile("the file is not an .npz archive")
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            yield archive
