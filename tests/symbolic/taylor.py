"""Taylor tests: what a right derivative leaves of a small change falls with the square of the change."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Short enough to stay on one side of every kink of a random structure, long enough to stand out of rounding.
STEPS = 6.4e-5 / 2.0 ** np.arange(4)
EXACT = 1e-13  # of the largest terms: what is left of a function that is linear along the direction


def check_second_order(value: Callable[[float], Array], derivative: Array, terms: float, what: str) -> None:
    """Assert that |value(h) - value(0) - h derivative| ~ h^2, or is rounding of `terms` throughout."""
    start = value(0.0)
    errors = np.array([np.linalg.norm(value(h) - start - h * derivative) for h in STEPS])
    if errors[0] <= EXACT * terms:
        return
    slope = np.polyfit(np.log(STEPS), np.log(errors), 1)[0]
    assert 1.9 < slope < 2.1, (what, slope, errors / terms)
