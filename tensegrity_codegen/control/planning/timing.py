"""Times of a plan: from the rates of the actuators, or from a duration."""

from collections.abc import Sequence

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import InvalidValueError

ROUNDING = 1e-9


def check_duration(duration: float | None) -> None:
    """Raise InvalidValueError for a duration [s] that is not a positive finite number."""
    if duration is not None and not (is_number(duration) and duration > 0):
        raise InvalidValueError(
            "the duration is not positive",
            where="duration",
            given=duration,
            allowed="a finite number above 0 [s]",
        )


def compute_times(
    change: FloatArray, rate: FloatArray, duration: float | None, names: Sequence[str]
) -> FloatArray | None:
    """Return the times at which the points of a plan are reached.

    Parameters
    ----------
    change : ndarray, shape (n_steps, n_actuators) [m]
        Values of the inputs.
    rate : ndarray, shape (n_actuators,) [m/s]
        Largest rates, infinite without a limit.
    duration : float, optional
        Time of the whole plan [s]; by default the shortest that the rates permit.
    names : sequence of str
        Names of the actuators, for the error.

    Returns
    -------
    ndarray, shape (n_steps,) [s], or None
        None without rates and duration.

    Raises
    ------
    InvalidValueError
        The rates need more than the duration.

    Notes
    -----
    Each step takes as long as its slowest actuator, with straight lines between the points. A longer duration
    stretches all steps alike; without rates it is shared by the largest changes of the steps.
    """
    moved = np.abs(np.diff(change, axis=0))
    own = (moved / rate).max(axis=1, initial=0.0)
    if not np.any(np.isfinite(rate)):
        if duration is None:
            return None
        own = moved.max(axis=1, initial=0.0)
    elif duration is not None and own.sum() > duration * (1 + ROUNDING):
        slowest = (moved / rate).sum(axis=0)
        raise InvalidValueError(
            "the rates of the actuators need more time",
            where="duration",
            given=f"{duration:g} s",
            allowed=f"at least {own.sum():.6g} s",
            hint=f"actuator {names[int(slowest.argmax())]!r} moves longest: {slowest.max():.6g} s",
        )
    total = float(own.sum())
    if duration is not None and total > 0:
        own = own * (duration / total)
    return np.concatenate([[0.0], np.cumsum(own)])
