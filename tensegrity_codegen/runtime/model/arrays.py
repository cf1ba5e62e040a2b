"""Arguments of callers as arrays of a library's precision."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.precision import Precision

MOST_LISTED = 10_000_000  # numbers of a range


def check_shape(array: NDArray[Any], shape: tuple[int, ...], where: str) -> None:
    """Raise InvalidValueError for an array of another shape."""
    if array.shape != shape:
        raise InvalidValueError("wrong shape", where=where, given=array.shape, allowed=f"shape {shape}")


def check_finite(array: NDArray[Any], where: str, problem: str = "not finite") -> None:
    """Raise NonFiniteError for an array with a NaN or an infinity."""
    if not np.all(np.isfinite(array)):
        raise NonFiniteError(problem, where=where, allowed="finite numbers")


def check_length(value: Any) -> None:
    """Raise ValueError for a range of numbers that would fill the memory as an array."""
    if isinstance(value, range) and len(value) > MOST_LISTED:
        raise ValueError("too many numbers")


def to_doubles(value: ArrayLike, where: str, allowed: str) -> NDArray[np.float64]:
    """Return real numbers as an array; raises InvalidValueError, naming what is allowed, for others."""
    try:
        check_length(value)
        numbers = np.asarray(value)
        if numbers.dtype.kind == "c":
            raise TypeError("complex numbers")
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(
            "not an array of numbers", where=where, given=value, allowed=allowed
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
    """Return `value` as an array of that precision; InvalidValueError where numbers would be rounded."""
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
    """Return the number of rows of all arrays of a batch; hint: what to call for a single element."""
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
