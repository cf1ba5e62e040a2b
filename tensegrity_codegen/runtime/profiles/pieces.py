"""Piecewise polynomials of time, in the form in which the C integrators take them."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray

MIN_JUMP = 1e-9  # of the largest value: a larger difference of two neighbouring pieces is a jump
# Time [s] -> run-time parameters and inputs by name.
Schedule = Callable[[float], Mapping[str, Any]]
SCHEDULE_SAMPLES = 4000  # of a function over the time of a motion: a shorter pulse may lie between two
SMALLEST_JUMP = 1e-3  # of the range of values
# Halvings of an interval after which a smooth function has lost nearly all of its change in it.
HALVINGS_OF_SMOOTH = 4


@dataclass(frozen=True, eq=False)
class Pieces:
    """Polynomials of time between breakpoints, for n_values values at once."""

    time: FloatArray  # (n_pieces + 1,) [s], breakpoints, rising
    coefficient: FloatArray  # (n_pieces, degree + 1, n_values), of powers of the time since the piece's start
    is_kink: NDArray[np.bool_]  # (n_pieces + 1,), where steps of a method end, at another polynomial

    def at(self, time: float) -> FloatArray:
        """Return the values (n_values,) at a time [s]; at a jump those after it."""
        piece = int(np.searchsorted(self.time[1:-1], time, side="right"))
        return self.polynomial(piece, time - float(self.time[piece]))

    def polynomial(self, piece: int, since: float) -> FloatArray:
        """Return the values (n_values,) of one piece, a time [s] after its start."""
        rows = self.coefficient[piece]
        value = rows[-1]
        for row in rows[-2::-1]:
            value = row + since * value
        return np.array(value)

    def find_extremes(self, column: int) -> tuple[tuple[float, float], float]:
        """Return least and largest value of one column, and its largest rate, infinite at a jump."""
        values: list[float] = []
        rates: list[float] = []
        for piece, duration in enumerate(np.diff(self.time)):
            powers = duration ** np.arange(self.coefficient.shape[1])  # of the time over the duration, 0 to 1
            value = np.polynomial.Polynomial(self.coefficient[piece, :, column] * powers)
            values += _find_turns(value)
            rates += [rate / float(duration) for rate in _find_turns(value.deriv())]
        size = max(map(abs, values))
        ends = [self.polynomial(k, float(t))[column] for k, t in enumerate(np.diff(self.time))]
        steps = np.abs(np.array(ends[:-1]) - self.coefficient[1:, 0, column])
        jumps = bool((steps > MIN_JUMP * size).any())
        return (min(values), max(values)), np.inf if jumps else max(map(abs, rates))


def _find_turns(curve: "np.polynomial.Polynomial") -> list[float]:
    """Return the values of a polynomial at 0, at 1 and where its slope is zero in between."""
    slope = curve.deriv().coef
    slope = np.polynomial.polynomial.polytrim(slope, tol=1e-12 * float(np.abs(slope).max()))
    roots = np.polynomial.polynomial.polyroots(slope) if len(slope) > 1 else np.zeros(0)
    real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots)]
    return [float(curve(t)) for t in (0.0, 1.0, *real[(real > 0) & (real < 1)])]


def build_linear(time: FloatArray, value: FloatArray) -> Pieces:
    """Return the straight lines between knots, values (n_knots, n_values); equal times are a jump."""
    gap = np.diff(time)
    is_piece = gap > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (np.diff(value, axis=0) / gap[:, None])[is_piece]
    start, end = value[:-1][is_piece], value[1:][is_piece]
    bends = (slope[1:] != slope[:-1]).any(axis=1) | (start[1:] != end[:-1]).any(axis=1)
    return Pieces(np.unique(time), np.stack([start, slope], axis=1), _frame(bends))


def build_cubic(time: FloatArray, value: FloatArray) -> Pieces:
    """Return the cubic spline through knots, another one after each jump; arguments as of build_linear.

    The second derivative is continuous, and the third one at the first and last inner knot ("not-a-knot");
    three knots have a parabola, two a straight line (de Boor 1978, A Practical Guide to Splines, chapter 4).
    """
    ends = [0, *(np.flatnonzero(np.diff(time) == 0.0) + 1).tolist(), len(time)]
    stretches = [slice(a, b) for a, b in pairwise(ends)]
    splines = [_build_spline(time[stretch], value[stretch]) for stretch in stretches]
    coefficient = np.ascontiguousarray(np.concatenate(splines))
    jumps = np.zeros(len(coefficient) - 1, dtype=bool)
    jumps[np.cumsum([len(stretch) for stretch in splines[:-1]], dtype=np.int64) - 1] = True
    bends = (coefficient[1:, 3] != coefficient[:-1, 3]).any(axis=1)
    return Pieces(np.unique(time), coefficient, _frame(jumps | bends))


def _build_spline(time: FloatArray, value: FloatArray) -> FloatArray:
    """Return the coefficients (n_knots - 1, 4, n_values) of one spline; NAN if knots are too close."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of matrices that are as good as singular
            return np.asarray(scipy.interpolate.CubicSpline(time, value).c[::-1].transpose(1, 0, 2))
    except (ValueError, np.linalg.LinAlgError, Warning):  # the knots are finite, slopes between them are not
        return np.full((len(time) - 1, 4, value.shape[1]), np.nan)


def _frame(inner: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the kinks of all breakpoints from those of the inner ones; the ends are none."""
    return np.concatenate([[False], inner, [False]])


def locate_jumps(schedule: Schedule, t_end: float) -> list[float]:
    """Return the times (0, t_end) [s] from which on a function of time has another value than just before."""
    time = np.linspace(0.0, t_end, SCHEDULE_SAMPLES + 1)
    value = np.array([_flatten(schedule(float(t))) for t in time])
    span = np.ptp(value, axis=0)
    change = np.abs(np.diff(value, axis=0))
    is_large = (change > SMALLEST_JUMP * span).any(axis=1) & np.isfinite(change).all(axis=1)
    jumps = (
        _bisect(schedule, time[k], time[k + 1], value[k], value[k + 1]) for k in np.flatnonzero(is_large)
    )
    return [jump for jump in jumps if jump is not None and 0.0 < jump < t_end]


def _bisect(
    schedule: Schedule, before: float, after: float, low: FloatArray, high: FloatArray
) -> float | None:
    """Return where a function jumps between two times, None if it changes smoothly."""
    whole_change, count = float(np.abs(high - low).max()), 0
    while before < (middle := 0.5 * (before + after)) < after:
        between = _flatten(schedule(middle))
        if np.abs(between - low).max() >= np.abs(high - between).max():
            after, high = middle, between
        else:
            before, low = middle, between
        count += 1
        if count == HALVINGS_OF_SMOOTH and np.abs(high - low).max() < 0.5 * whole_change:
            return None
    return after


def _flatten(values: Mapping[str, Any]) -> FloatArray:
    """Return all values as one row, a 0 before them."""
    rows = [np.ravel(np.asarray(value, dtype=np.float64)) for value in values.values()]
    return np.concatenate([[0.0], *rows])
