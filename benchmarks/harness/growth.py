"""How times grow with the structure: the exponent p of ns ~ members^p, fitted on logarithms."""

from collections.abc import Sequence

import numpy as np

MEANINGFUL_POINTS = 3


def fit_exponent(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Return the slope of log(values) over log(sizes) by least squares, None for less than three points.

    Values must be positive. 1 is linear growth, 0 none.
    """
    if len(sizes) < MEANINGFUL_POINTS:
        return None
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])
