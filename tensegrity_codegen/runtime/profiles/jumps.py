"""Jumps of arguments that a function of time gives, located so that steps can end there."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray

# Time [s] -> run-time parameters and inputs by name.
Schedule = Callable[[float], Mapping[str, Any]]
SCHEDULE_SAMPLES = 4000  # of a function over the time of a motion: a shorter pulse may lie between two
SMALLEST_JUMP = 1e-3  # of the range of values
# Halvings of an interval after which a smooth function has lost nearly all of its change in it.
HALVINGS_OF_SMOOTH = 4


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
    """Return where a function jumps between two times, None where it changes smoothly."""
    whole, count = float(np.abs(high - low).max()), 0
    while before < (middle := 0.5 * (before + after)) < after:
        between = _flatten(schedule(middle))
        if np.abs(between - low).max() >= np.abs(high - between).max():
            after, high = middle, between
        else:
            before, low = middle, between
        count += 1
        if count == HALVINGS_OF_SMOOTH and np.abs(high - low).max() < 0.5 * whole:
            return None
    return after


def _flatten(values: Mapping[str, Any]) -> FloatArray:
    """Return all values as one row, a 0 before them."""
    rows = [np.ravel(np.asarray(value, dtype=np.float64)) for value in values.values()]
    return np.concatenate([[0.0], *rows])
