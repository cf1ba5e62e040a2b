"""Time laws s(t): how progress along a path goes from 0 to 1; and the shortest duration that rates permit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly, PPoly, make_interp_spline
from scipy.optimize import brentq

from tensegrity_codegen.control.planning.plan_point import Actuation
from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles
from tensegrity_codegen.runtime.profiles.pieces import build_cubic
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, check_choice

QUINTIC = "quintic"
SLOPE_ROUNDING = 1e-9  # of the largest slope: a negative slope that counts as rounding
RATE_TOLERANCE = 1e-6  # of a rate limit: excess that counts as none
DURATION_TOLERANCE = 1e-8  # of the shortest duration: its accuracy
DURATION_FACTOR = 1.25  # from one trial of the shortest duration to the next
MAX_TRIALS = 40  # of durations


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """Progress s over the part x = t / duration of the time, both from 0 to 1, at rest at both ends."""

    piece: PPoly  # polynomials of x
    own_duration: float | None = None  # [s]: last time of a table, None without one
    # whether the first half of the time leads from 0 to 1, and the second half back to 0 as a mirror image
    returns: bool = False

    def at(self, part: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s, ds/dx and d2s/dx2 at parts x of the time, each of the shape of `part`."""
        x, slope = part, np.ones_like(part)
        if self.returns:
            x, slope = 1.0 - np.abs(1.0 - 2.0 * part), np.where(part <= 0.5, 2.0, -2.0)
        s, rate, change = (self.piece(x, order) for order in range(3))
        return np.clip(s, 0.0, 1.0), rate * slope, change * slope**2

    def returning(self) -> "TimeLaw":
        """Return the law that goes back after it: in twice the time, at rest at the far end too."""
        duration = None if self.own_duration is None else 2.0 * self.own_duration
        return TimeLaw(self.piece, duration, returns=True)


def read_law(law: str | ArrayLike) -> TimeLaw:
    """Return a time law of class C2, "quintic" or by a table (n, 2), with s' = s'' = 0 at both ends."""
    # "quintic": s = 10 x^3 - 15 x^4 + 6 x^5. A table of times [s] that rise from 0, and of values of s from 0
    # to 1 that do not fall, is interpolated by the spline of degree 5. If this goes back anywhere, by
    # polynomials of degree 5 with s'' = 0 at all points, and as s' the smaller of the mean slopes on both
    # sides. With end slopes a, b <= 1 (over the mean slope of the interval) such a polynomial has the slope
    # a (1 - h) + b h + 30 (1 - (a + b) / 2) x^2 (1 - x)^2 >= 0, h = 3 x^2 - 2 x^3.
    if isinstance(law, str):
        check_choice(law, (QUINTIC,), "time law", "law")
        return TimeLaw(_build_spline(np.array([0.0, 1.0]), np.array([0.0, 1.0])))
    time, value = _read_table(law)
    fraction = time / time[-1]
    smooth = _build_spline(fraction, value)
    # It never goes back where the smallest of its slopes is not negative.
    slope = smooth.derivative()
    extreme = np.asarray(slope.derivative().roots(extrapolate=False), dtype=float)
    values = slope(np.concatenate([extreme[np.isfinite(extreme)], smooth.x]))
    rises = bool(values.min() >= -SLOPE_ROUNDING * np.abs(values).max())
    return TimeLaw(smooth if rises else _build_monotone(fraction, value), float(time[-1]))


def _read_table(law: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return times and values of a table after checks."""
    allowed = "two rows (time [s], progress) or more, from (0, 0) to (duration, 1)"
    table = to_doubles(law, "law", allowed)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise InvalidValueError(
            "not a table of times and progress", where="law", given=table.shape or law, allowed=allowed
        )
    check_finite(table, "law", "a time or a progress that is not finite")
    time, value = table.T
    if time[0] != 0.0 or value[0] != 0.0 or value[-1] != 1.0:
        raise InvalidValueError(
            "the table does not lead from the start to the end of the path",
            where="law",
            given=f"({time[0]:g}, {value[0]:g}) to ({time[-1]:g}, {value[-1]:g})",
            allowed=allowed,
        )
    for rows, fault in ((np.diff(time) <= 0, "times do not rise"), (np.diff(value) < 0, "progress falls")):
        if rows.any():
            k = int(np.argmax(rows)) + 1
            raise InvalidValueError(
                f"the {fault}" if fault.startswith("times") else f"the {fault}: the motion would go back",
                where=f"law, row {k}",
                given=f"({time[k]:g}, {value[k]:g}) after ({time[k - 1]:g}, {value[k - 1]:g})",
                allowed="rising times, progress that stays or rises",
            )
    return time, value


def _build_spline(part: FloatArray, value: FloatArray) -> PPoly:
    """Return the spline of degree 5 with no slope and curvature at both ends; of two points the quintic."""
    at_rest: Any = ([(1, 0.0), (2, 0.0)], [(1, 0.0), (2, 0.0)])
    spline = make_interp_spline(part, value, k=5, bc_type=at_rest)
    return PPoly.from_spline((spline.t, spline.c, spline.k))


def _build_monotone(part: FloatArray, value: FloatArray) -> PPoly:
    slope = np.diff(value) / np.diff(part)
    inner = np.minimum(slope[1:], slope[:-1])
    rate = np.concatenate([[0.0], inner, [0.0]])
    knots = np.stack([value, rate, np.zeros_like(value)], axis=1)
    return PPoly.from_bernstein_basis(BPoly.from_derivatives(part, knots))


# Largest rates of the actuators in a motion, and the shortest duration that their limits permit.


@dataclass(frozen=True)
class Peaks:
    """Largest rate of each actuator, (n_actuators,) [m/s], and its time [s]."""

    rate: FloatArray
    time: FloatArray


def compute_peaks(time: FloatArray, change: FloatArray) -> Peaks:
    """Return the largest rates of the cubic spline through the inputs, which the profile follows."""
    pieces = build_cubic(time, change)
    slope = PPoly(pieces.coefficient[:, ::-1].transpose(1, 0, 2), pieces.time).derivative()
    linear, constant = slope.c[0], slope.c[1]  # slope = linear' x^2 + constant x + rate, of each piece
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = -constant / (2 * linear)
    inside = np.isfinite(inner) & (inner > 0) & (inner < np.diff(pieces.time)[:, None])
    inner = np.where(inside, inner, 0.0)
    at_inner = np.abs(slope.c[2] + inner * (constant + inner * linear))
    at_knots = np.abs(np.asarray(slope(pieces.time)))
    rates = np.concatenate([at_inner, at_knots])
    times = np.concatenate(
        [pieces.time[:-1, None] + inner, np.broadcast_to(pieces.time[:, None], at_knots.shape)]
    )
    largest, columns = rates.argmax(axis=0), np.arange(rates.shape[1])
    return Peaks(rates[largest, columns], times[largest, columns])


def find_shortest(first: float, excess: Callable[[float], float]) -> float:
    """Return the shortest duration [s] with no rate above its limit, next to that of the static path."""
    if first == 0.0:
        return 0.0
    low = high = first
    if excess(first) > 1.0:
        for _ in range(MAX_TRIALS):
            low, high = high, DURATION_FACTOR * high
            if excess(high) <= 1.0:
                break
        else:
            raise ConvergenceError(
                "no duration keeps the rates of the actuators",
                evidence={"tried": f"{first:.6g} to {high:.6g} s"},
                where="duration",
                hint="raise the rates",
            )
    else:  # inertia can also lower the largest rate
        for _ in range(MAX_TRIALS):
            low, high = low / DURATION_FACTOR, low
            if excess(low) > 1.0:
                break
        else:
            return low
    shortest = float(brentq(lambda duration: excess(duration) - 1.0, low, high, rtol=DURATION_TOLERANCE))
    return shortest if excess(shortest) <= 1.0 + RATE_TOLERANCE else high


def check_rates(
    actuation: Actuation, peaks: Peaks, members: tuple[str, ...], duration: float, shortest: float
) -> None:
    """Raise InvalidValueError if a rate exceeds its limit: which cable, when, by how much."""
    ratio = peaks.rate / actuation.rate
    if len(ratio) == 0 or ratio.max() <= 1.0 + RATE_TOLERANCE:
        return
    k = int(ratio.argmax())
    actuator = actuation.actuators[k]
    cables = ", ".join(members[e] for e in actuator.members)
    raise InvalidValueError(
        f"the motion is too fast for the actuator {actuator.name} of {cables}",
        where="duration",
        given=f"{duration:.6g} s, in which it moves at {peaks.rate[k]:.6g} m/s at {peaks.time[k]:.6g} s",
        allowed=f"at least {shortest:.6g} s, for its rate of {actuator.rate:.6g} m/s",
        hint="move longer, raise the rate, or use more actuators",
    )
