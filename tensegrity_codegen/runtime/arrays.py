"""What callers hand in, as arrays of a library's precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.precision import Precision

__all__ = ["to_array"]


def to_array(value: ArrayLike, precision: Precision, name: str, allowed: str) -> NDArray[Any]:
    """Return `value` as an array of that precision, itself if it is one already.

    Raises InvalidValueError, naming the argument and what is allowed, for what is no array of numbers and for
    an array whose numbers would be rounded.
    """
    given = getattr(value, "dtype", None)
    if given is not None and given.kind == "f" and given.itemsize > precision.dtype.itemsize:
        raise InvalidValueError(
            f"an array whose numbers {precision.name} precision would round",
            where=name,
            given=str(given),
            allowed=str(precision.dtype),
            hint=f"round it yourself with astype({str(precision.dtype)!r}), or build in a higher precision",
        )
    try:
        with np.errstate(over="ignore"):  # the library says that what became infinite is not finite
            return np.asarray(value, dtype=precision.dtype)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            "not an array of numbers", where=name, given=value, allowed=allowed
        ) from error
