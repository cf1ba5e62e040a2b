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
    """Write arrays to an .npz file, whole or not at all, compressed up to MOST_COMPRESSED bytes."""
    check_ending(path, ".npz")
    named_arrays: dict[str, Any] = dict(arrays)
    size = sum(np.asarray(array).nbytes for array in named_arrays.values())
    save = np.savez_compressed if size <= MOST_COMPRESSED else np.savez
    with replaced(path, overwrite=overwrite) as temporary, temporary.open("wb") as file:
        save(file, **named_arrays)


def read_arrays(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file by name, all or those of `names`; raises one of UNREADABLE."""
    with _opened_archive(path) as archive:
        chosen = [name for name in archive.files if names is None or name in names]
        packed = [entry for entry in archive.zip.infolist() if entry.compress_type != ZIP_STORED]
        size = sum(entry.file_size for entry in packed if entry.filename.removesuffix(".npy") in chosen)
        if size > MOST_UNPACKED:
            raise ValueError(f"compressed arrays of {size >> 20} MB; up to {MOST_UNPACKED >> 20} MB are read")
        return {name: archive[name] for name in chosen}


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
