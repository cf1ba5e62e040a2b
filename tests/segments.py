"""The distance between two segments, written down twice without any of the package's code.

`exact_distance` enumerates every place where a convex quadratic over the unit square can have its minimum, in
rational arithmetic, so that nothing is lost but the last square root. `searched_distance` only evaluates
|P(s) - Q(t)|.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rational = list[Fraction]


@dataclass(frozen=True)
class Nearest:
    """Where two segments are nearest, and the number of the case that LIN 3.2 lists."""

    distance: float
    s: float
    t: float
    case: int


def exact_distance(a: Sequence[float], b: Sequence[float], c: Sequence[float], d: Sequence[float]) -> float:
    """Distance between segments a-b and c-d from exact rationals."""
    return find_nearest(a, b, c, d).distance


def find_nearest(a: Sequence[float], b: Sequence[float], c: Sequence[float], d: Sequence[float]) -> Nearest:
    """Nearest points of segments a-b and c-d from exact rationals; of several, the ones in the middle."""
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
    feet = None
    if determinant:
        feet = (uw * vv - uv * vw) / determinant, (uv * uw - uu * vw) / determinant
        if all(0 <= foot <= 1 for foot in feet):
            candidates.append(feet)
    square = min(squared_gap(w, u, v, s, t) for s, t in candidates)
    best = sorted(pair for pair in candidates if squared_gap(w, u, v, *pair) == square)
    s, t = ((x + y) / 2 for x, y in zip(best[0], best[-1], strict=True))
    case = 11 if not (uu and vv) else name_case(feet, s, t)
    return Nearest(sqrt(square), float(s), float(t), case)


def name_case(feet: tuple[Fraction, Fraction] | None, s: Fraction, t: Fraction) -> int:
    """The number of the case; feet: where the common normal meets the lines, None if they are parallel."""
    first_inner, second_inner = 0 < s < 1, 0 < t < 1
    if feet is None:
        return 9 if first_inner or second_inner else 10
    on_first, on_second = (0 <= foot <= 1 for foot in feet)
    if on_first and on_second:
        return 1
    if on_second:
        return 2 if second_inner else 3
    if on_first:
        return 4 if first_inner else 5
    return 6 if second_inner else 7 if first_inner else 8


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
