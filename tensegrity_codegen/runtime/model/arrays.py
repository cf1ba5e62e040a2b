"""Arguments of callers as arrays of a library's precision, and arrays in .npz files, read without trust."""

import math
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.system.checks import check_instance, check_path, is_number
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    SceneSyntaxError,
    describe_reason,
)
from tensegrity_codegen.system.files import check_ending, replaced
from tensegrity_codegen.tables.precision import Precision

MAX_LISTED = 10_000_000  # numbers of a range
# Bytes of the arrays of a result file that are compressed: zlib takes about 1 s for 20 MB of them.
MAX_COMPRESSED = 64 * 2**20
MAX_UNPACKED = 8 * MAX_COMPRESSED  # bytes of compressed arrays that are read
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


def check_shape(array: NDArray[Any], shape: tuple[int, ...], where: str) -> None:
    """Raise InvalidValueError for an array of another shape."""
    if array.shape != shape:
        raise InvalidValueError("wrong shape", where=where, given=array.shape, allowed=f"shape {shape}")


def check_finite(array: NDArray[Any], where: str, problem: str = "not finite") -> None:
    """Raise NonFiniteError for an array with a NaN or an infinity."""
    if not np.all(np.isfinite(array)):
        raise NonFiniteError(problem, where=where, allowed="finite numbers")


def check_tolerance(value: Any, where: str, hint: str = "") -> None:
    """Raise InvalidValueError unless a tolerance is a number above 0 and below 1."""
    if not (is_number(value) and 0 < value < 1):
        raise InvalidValueError(
            "the tolerance is out of range", where=where, given=value, allowed="above 0, below 1", hint=hint
        )


def check_length(value: Any) -> None:
    """Raise ValueError for a range of numbers that would fill the memory as an array."""
    if isinstance(value, range) and len(value) > MAX_LISTED:
        raise ValueError("too many numbers")


def to_doubles(value: ArrayLike, where: str, allowed: str) -> NDArray[np.float64]:
    """Return real numbers as an array; raises InvalidValueError, with `allowed`, for others."""
    try:
        check_length(value)
        numbers = np.asarray(value)
        if numbers.dtype.kind == "c":
            raise TypeError("complex numbers")
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        hint = str(error) if isinstance(error, RuntimeError) else ""  # PyTorch says: tensor.detach().numpy()
        raise InvalidValueError(
            "not an array of numbers", where=where, given=value, allowed=allowed, hint=hint
        ) from error


def to_each(
    value: ArrayLike,
    count: int,
    where: str,
    is_allowed: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    allowed: str,
) -> NDArray[np.float64]:
    """Return a number, or one for each of `count` things, as a new array (count,), if it is allowed."""
    numbers = to_doubles(value, where, allowed)
    if numbers.shape not in ((), (count,)) or not np.all(is_allowed(numbers)):
        raise InvalidValueError("out of range", where=where, given=value, allowed=allowed)
    return np.broadcast_to(numbers, (count,)).copy()


def to_sized(value: ArrayLike, shape: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Return `value` as a contiguous array of doubles with as many numbers as `shape` has."""
    array = np.ascontiguousarray(to_doubles(value, where, f"shape {shape}"))
    if array.size != math.prod(shape):
        raise InvalidValueError("wrong shape", where=where, given=array.shape, allowed=f"shape {shape}")
    return array


def to_array(value: ArrayLike, precision: Precision, name: str, allowed: str) -> NDArray[Any]:
    """Return `value` as an array of that precision; InvalidValueError if numbers would be rounded."""
    dtype = getattr(value, "dtype", None)
    if dtype is not None and dtype.kind == "f" and dtype.itemsize > precision.dtype.itemsize:
        raise InvalidValueError(
            f"the array has numbers that {precision.name} precision would round",
            where=name,
            given=str(dtype),
            allowed=str(precision.dtype),
            hint=f"round it yourself with astype({str(precision.dtype)!r}), or build in a higher precision",
        )
    try:
        check_length(value)
        if np.asarray(value).dtype.kind == "c":
            raise TypeError("complex numbers")
        with np.errstate(over="ignore"):  # the library says that what became infinite is not finite
            if np.iscomplexobj(value):
                raise TypeError("complex numbers")
            return np.asarray(value, dtype=precision.dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(
            "not an array of numbers", where=name, given=value, allowed=allowed
        ) from error


def to_batch(
    value: ArrayLike, shape: tuple[int, ...], precision: Precision, name: str
) -> tuple[NDArray[Any], bool]:
    """Return an argument of a batch as a contiguous array, and whether it has the batch axis."""
    rows = f"({', '.join(['n_batch', *map(str, shape)])})"
    allowed = f"shape {rows}, or {shape} shared by all elements"
    array = np.ascontiguousarray(to_array(value, precision, name, allowed))
    if array.shape == shape:
        return array, False
    if array.ndim == 1 + len(shape) and array.shape[1:] == shape:
        return array, True
    raise InvalidValueError("wrong shape", where=name, given=array.shape, allowed=allowed)


def agree_on_rows(lengths: Mapping[str, int], where: str, hint: str) -> int:
    """Return the number of rows of all arrays of a batch; hint: the function for a single element."""
    if not lengths:
        raise InvalidValueError(
            "no argument has a batch axis",
            where=where,
            allowed="a leading axis on one of the arrays at least",
            hint=hint,
        )
    if len(set(lengths.values())) > 1 or 0 in lengths.values():
        raise InvalidValueError(
            "different batch lengths",
            where=where,
            given=", ".join(f"{name} {length}" for name, length in lengths.items()),
            allowed="one length > 0, or no leading axis where all elements share a value",
        )
    return next(iter(lengths.values()))


def write_arrays(path: str | Path, arrays: Mapping[str, NDArray[Any]], *, overwrite: bool) -> None:
    """Write arrays to an .npz file, whole or not at all, compressed up to MAX_COMPRESSED bytes."""
    check_ending(path, ".npz")
    named_arrays: dict[str, Any] = dict(arrays)
    size = sum(np.asarray(array).nbytes for array in named_arrays.values())
    save = np.savez_compressed if size <= MAX_COMPRESSED else np.savez
    with replaced(path, overwrite=overwrite) as temporary, temporary.open("wb") as file:
        save(file, **named_arrays)


def read_arrays(path: Path, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file by name, all or those of `names`; raises one of UNREADABLE."""
    with _opened_archive(path) as archive:
        chosen = [name for name in archive.files if names is None or name in names]
        packed = [entry for entry in archive.zip.infolist() if entry.compress_type != ZIP_STORED]
        size = sum(entry.file_size for entry in packed if entry.filename.removesuffix(".npy") in chosen)
        if size > MAX_UNPACKED:
            raise ValueError(f"compressed arrays of {size >> 20} MB; up to {MAX_UNPACKED >> 20} MB are read")
        return {name: archive[name] for name in chosen}


def read_saved(path: str | Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file that a method `save` wrote; SceneSyntaxError for any other file."""
    check_path(path, "path")
    try:
        return read_arrays(Path(path))
    except UNREADABLE as error:
        given, allowed = describe_reason(error), "an .npz file that `save` wrote"
        raise SceneSyntaxError("cannot be read", where=str(path), given=given, allowed=allowed) from error


def fit_saved(
    saved: Mapping[str, Any], held: Mapping[str, NDArray[Any]], what: str
) -> dict[str, NDArray[Any]]:
    """Return saved arrays by the names of those held, of their shapes and types; InvalidValueError if others.

    what: "not a snapshot of these copies", for the message.
    """
    check_instance(saved, Mapping, "snapshot", "arrays by name")
    kinds = {"f": "fiu", "i": "iu", "u": "iu", "b": "b"}
    fitting = {}
    for name in dict.fromkeys((*held, *saved)):
        array, own = np.asarray(saved.get(name)), held.get(name)
        fits = own is not None and array.shape == own.shape and array.dtype.kind in kinds[own.dtype.kind]
        if own is None or not fits:
            given = f"{array.dtype} {array.shape}" if name in saved else "nothing"
            allowed = ", ".join(held) if own is None else f"{own.dtype} {own.shape}"
            raise InvalidValueError(what, where=f"snapshot: {name}", given=given, allowed=allowed)
        fitting[name] = array.astype(own.dtype)
    return fitting


def check_saved(array: NDArray[Any], name: str, low: float, high: float) -> None:
    """Raise InvalidValueError for a saved array with numbers that are not from `low` to `high`."""
    if not ((array >= low) & (array <= high)).all():
        given = f"{array.min()} to {array.max()}"
        allowed = f"numbers from {low:g} to {high:g}"
        raise InvalidValueError("out of range", where=f"snapshot: {name}", given=given, allowed=allowed)


def read_names(path: Path) -> tuple[str, ...]:
    """Return the names of the arrays of an .npz file; raises one of UNREADABLE for other files."""
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
