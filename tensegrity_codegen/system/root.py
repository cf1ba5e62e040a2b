"""Brent's method for a root of a function, without the time that importing SciPy's takes."""

import math
from collections.abc import Callable


def find_root(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return a root between two places with values of opposite sign.

    function: continuous function of one number; low, high: ends of the bracket, in either order; tolerance:
    largest distance to a change of sign, beside four roundings of the root; 0 is allowed.
    """
    # The root is between `best` and `other`; `last` is the estimate before.
    last, best = (low, function(low)), (high, function(high))
    if last[1] * best[1] > 0:
        raise ValueError(f"the function has the same sign at {low} and {high}")
    other, moved, moved_before = last, high - low, high - low
    while True:
        if abs(other[1]) < abs(best[1]):
            last, best, other = best, other, best
        (a, fa), (b, fb), (c, fc) = last, best, other
        if math.isnan(fb + fc):
            raise ValueError(f"the function is not a number between {b} and {c}")
        half, least = (c - b) / 2, tolerance / 2 + 4 * math.ulp(b)
        if fb == 0 or abs(half) <= least:
            return b
        step = math.inf
        if abs(moved_before) >= least and abs(fb) < abs(fa):
            step = fb * (b - a) / (fa - fb)  # of the secant
            if fc not in (fa, fb):  # of the inverse parabola through all three
                step = fb * (fa * (c - b) / ((fc - fa) * (fc - fb)) - fc * (a - b) / ((fc - fa) * (fa - fb)))
        if not 0 <= step / half < 1.5 or abs(step) > abs(moved_before) / 2:
            step = moved = half
        moved_before, moved = moved, step
        at = b + (step if abs(step) > least else math.copysign(least, half))
        last, best = best, (at, function(at))
        if (best[1] > 0) == (fc > 0):
            other, moved, moved_before = last, at - b, at - b
