"""The distance between two segments, written down twice without any of the package's code.

`exact_distance` enumerates every place where a convex quadratic over the unit square can have its minimum, in
rational arithmetic, so that nothing is lost but the last square root. `searched_distance` only evaluates
|P(s) - Q(t)|.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import product

import numpy as np
from numpy.typing import NDArray

__all__ = ["exact_distance", "searched_distance"]

Array = NDArray[np.float64]
Rational = list[Fraction]


def exact_distance(a: Sequence[float], b: Sequence[float], c: Sequence[float], d: Sequence[float]) -> float:
    """Distance between segments a-b and c-d from exact rationals."""
    start, other = rational(a), rational(c)
    u, v = minus(rational(b), start), minus(rational(d), other)
    w = minus(other, start)
    uu, vv, uv, uw, vw = dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    candidates: list[tuple[Fraction, Fraction]] = list(product((Fraction(0), Fraction(1)), repeat=2))
    for end in (Fraction(0), Fraction(1)):
        if vv:
            candidates.append((end, clamp((end * uv - vw) / vv)))
        if uu:
            candidates.append((clamp((end * uv + uw) / uu), end))
    determinant = uu * vv - uv * uv
    if determinant:
        s, t = (uw * vv - uv * vw) / determinant, (uv * uw - uu * vw) / determinant
        if 0 <= s <= 1 and 0 <= t <= 1:
            candidates.append((s, t))
    square = min(squared_gap(w, u, v, s, t) for s, t in candidates)
    return sqrt(square)


def searched_distance(a: Array, b: Array, c: Array, d: Array, size: int = 33, rounds: int = 12) -> float:
    """Distance between segments a-b and c-d by sampling the parameter square ever more finely."""
    low, high, best = np.zeros(2), np.ones(2), np.inf
    for _ in range(rounds):
        s, t = (np.linspace(x, y, size) for x, y in zip(low, high, strict=True))
        gap = (a + np.outer(s, b - a))[:, None, :] - (c + np.outer(t, d - c))[None, :, :]
        value = np.sqrt((gap**2).sum(axis=2))
        row, column = np.unravel_index(int(value.argmin()), value.shape)
        best = min(best, float(value[row, column]))
        reach = 4 * (high - low) / (size - 1)
        place = np.array([s[row], t[column]])
        low, high = np.maximum(place - reach, 0), np.minimum(place + reach, 1)
    return best


def squared_gap(w: Rational, u: Rational, v: Rational, s: Fraction, t: Fraction) -> Fraction:
    gap = [x + t * z - s * y for x, y, z in zip(w, u, v, strict=True)]
    return dot(gap, gap)


def sqrt(value: Fraction) -> float:
    """Square root to the last bit or so, also of rationals far below the smallest double."""
    if not value:
        return 0.0
    half = (value.denominator.bit_length() - value.numerator.bit_length()) // 2
    return math.ldexp(math.sqrt(float(value * Fraction(4) ** half)), -half)


def rational(point: Sequence[float]) -> Rational:
    return [Fraction(float(x)) for x in point]


def minus(x: Rational, y: Rational) -> Rational:
    return [p - q for p, q in zip(x, y, strict=True)]


def dot(x: Rational, y: Rational) -> Fraction:
    return sum((p * q for p, q in zip(x, y, strict=True)), Fraction(0))


def clamp(x: Fraction) -> Fraction:
    return min(max(x, Fraction(0)), Fraction(1))
