"""Fewer knots of what is stored along a motion: which ones to keep."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.checks import check_whole


def choose_even_knots(total: int, count: Any) -> NDArray[np.int64] | None:
    """Return so many of `total` knots, evenly distributed, the first and the last among them.

    total: number of knots; count: number of knots to keep. Returns indices of the knots; None where there are
    no more than `count`. Raises InvalidValueError: `count` is no integer >= 2.
    """
    count = check_whole(count, "count", 2, problem="not a number of knots")
    if total <= count:
        return None
    return np.round(np.linspace(0, total - 1, count)).astype(np.int64)
