"""Largest rates of the actuators in a motion, and the shortest duration that their limits permit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly
from scipy.optimize import brentq

from tensegrity_codegen.control.planning.actuation import Actuation
from tensegrity_codegen.runtime.profiles.pieces import build_cubic
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError

WITHIN = 1e-6  # of a rate limit: excess that counts as none
CLOSE = 1e-8  # of the shortest duration: its accuracy
GROW = 1.25
MOST_TRIALS = 40


@dataclass(frozen=True)
class Peaks:
    """Largest rate of each actuator, (n_actuators,) [m/s], and its time [s]."""

    rate: FloatArray
    time: FloatArray


def compute_peaks(time: FloatArray, change: FloatArray) -> Peaks:
    """Return the largest rates of the cubic spline through the inputs, which the profile follows.

    Parameters
    ----------
    time : ndarray, shape (n_t,) [s]
        Knots.
    change : ndarray, shape (n_t, n_actuators) [m]
        Inputs at the knots.

    Returns
    -------
    Peaks
        Exact maxima: at knots, and where the second derivative vanishes between them.
    """
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
    """Return the shortest duration [s] with no rate above its limit, next to that of the static path.

    Parameters
    ----------
    first : float [s]
        Duration of the static path; 0 where nothing limits it.
    excess : callable
        Duration [s] -> largest ratio of a peak rate to its limit.

    Returns
    -------
    float
        The duration at which the ratio is 1.

    Raises
    ------
    ConvergenceError
        No duration within the trials keeps the limits.
    """
    if first == 0.0:
        return 0.0
    low = high = first
    if excess(first) > 1.0:
        for _ in range(MOST_TRIALS):
            low, high = high, GROW * high
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
        for _ in range(MOST_TRIALS):
            low, high = low / GROW, low
            if excess(low) > 1.0:
                break
        else:
            return low
    found = float(brentq(lambda duration: excess(duration) - 1.0, low, high, rtol=CLOSE))
    return found if excess(found) <= 1.0 + WITHIN else high


def check_rates(
    actuation: Actuation, peaks: Peaks, members: tuple[str, ...], duration: float, shortest: float
) -> None:
    """Raise InvalidValueError where a rate exceeds its limit: which cable, when, by how much."""
    ratio = peaks.rate / actuation.rate
    if len(ratio) == 0 or ratio.max() <= 1.0 + WITHIN:
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
