"""Brent's method for a root of a function, without the time that importing SciPy's takes."""

import math
from collections.abc import Callable


def find_root(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return a root between two places with values of opposite sign.

    function: continuous function of one number; low, high: ends of the bracket, in either order; tolerance:
    largest distance to a change of sign, beside four roundings of the root; 0 is allowed.
    """
    # The root is between `best` and `other`; `last` is the estimate before.
    previous, best = (low, function(low)), (high, function(high))
    if previous[1] * best[1] > 0:
        raise ValueError(f"the function has the same sign at {low} and {high}")
    opposite, moved, moved_before = previous, high - low, high - low
    while True:
        if abs(opposite[1]) < abs(best[1]):
            previous, best, opposite = best, opposite, best
        (a, fa), (b, fb), (c, fc) = previous, best, opposite
        if math.isnan(fb + fc):
            raise ValueError(f"the function is not a number between {b} and {c}")
        half, min_step = (c - b) / 2, tolerance / 2 + 4 * math.ulp(b)
        if fb == 0 or abs(half) <= min_step:
            return b
        step = math.inf
        if abs(moved_before) >= min_step and abs(fb) < abs(fa):
            step = fb * (b - a) / (fa - fb)  # of the secant
            if fc not in (fa, fb):  # of the inverse parabola through all three
                step = fb * (fa * (c - b) / ((fc - fa) * (fc - fb)) - fc * (a - b) / ((fc - fa) * (fa - fb)))
        if not 0 <= step / half < 1.5 or abs(step) > abs(moved_before) / 2:
            step = moved = half
        moved_before, moved = moved, step
        at = b + (step if abs(step) > min_step else math.copysign(min_step, half))
        previous, best = best, (at, function(at))
        if (best[1] > 0) == (fc > 0):
            opposite, moved, moved_before = previous, at - b, at - b
