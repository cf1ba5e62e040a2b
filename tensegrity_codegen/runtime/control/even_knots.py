"""Fewer knots of what is stored along a motion: which ones to keep."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import InvalidValueError

__all__ = ["choose_even_knots"]


def choose_even_knots(total: int, count: Any) -> NDArray[np.int64] | None:
    """Return so many of `total` knots, evenly distributed, the first and the last among them.

    Parameters
    ----------
    total : int
        Number of knots.
    count : int
        Number of knots to keep.

    Returns
    -------
    ndarray of int, or None
        Indices of the knots; None where there are no more than `count`.

    Raises
    ------
    InvalidValueError
        `count` is no integer >= 2.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 2:
        raise InvalidValueError("out of range", where="count", given=count, allowed="2 or more knots")
    if total <= count:
        return None
    return np.round(np.linspace(0, total - 1, int(count))).astype(np.int64)
