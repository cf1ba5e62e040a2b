"""The record of a simulated closed loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, is_number
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import Summarised


@dataclass(frozen=True, eq=False, repr=False)
class ControlRun(Summarised):
    """A simulated closed loop, at n_t sample times; the loop acts at all of them but the last.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"does_not_hold"`` where the last sixth of the time is further from the motion than without
        feedback, by more than 1/200 of the size of the structure; ``"unstable"`` where the integration
        stopped: arrays end there.
    message : str
        A sentence.
    time : ndarray, shape (n_t,) [s]
        Sample times.
    coordinate, velocity : ndarray, shape (n_t, n_coordinates)
        True state [m, rad, and per second].
    error : ndarray, shape (n_t, n_coordinates)
        True coordinates minus those of the motion.
    command : ndarray, shape (n_t - 1, n_actuators) [m]
        Commanded inputs of the actuators, within rate and range.
    input : ndarray, shape (n_t - 1, n_inputs)
        Inputs of the model at the end of each sample, delays included.
    member_tension : ndarray, shape (n_t, n_members) [N]
        True tensions.
    estimate : ndarray, shape (n_t - 1, n_states), or None
        Estimated state at each command.
    disturbance : ndarray, shape (n_t - 1, n_coordinates), or None
        Estimated disturbance force on each coordinate [N or N m].
    step_status : tuple of str, length n_t - 1
        Of each command: ``"ok"``, ``"rate_limited"``, ``"range_limited"``, and with a distribution of
        tensions ``"tension_limited"`` (least tensions prevent the forces of feedback), ``"least_tension"``
        (one cannot be reached within rate and range) and ``"not_solved"`` (feedback was cut instead); with an
        estimator ``"outlier"`` (measurements that are too far from their prediction: the last command holds).
    actuators, coordinate_name, member_name : tuple of str
        Names.
    yielding : ndarray of bool, shape (n_t - 1, n_members), or None
        Members whose least tension could not be reached; None without a distribution of tensions.
    warnings : tuple of str
        What to check.
    """

    status: str
    message: str
    time: FloatArray
    coordinate: FloatArray
    velocity: FloatArray
    error: FloatArray
    command: FloatArray
    input: FloatArray
    member_tension: FloatArray
    estimate: FloatArray | None
    disturbance: FloatArray | None
    step_status: tuple[str, ...]
    actuators: tuple[str, ...]
    coordinate_name: tuple[str, ...]
    member_name: tuple[str, ...]
    yielding: NDArray[np.bool_] | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_fields(self)

    def worst_error(self, last: float | None = None, coordinates: Any = slice(None)) -> float:
        """Return the largest error of some coordinates.

        Parameters
        ----------
        last : float, optional [s]
            Time before the end that is looked at; by default all of it.
        coordinates : index
            Which coordinates; by default all.

        Returns
        -------
        float
            In the unit of the coordinates [m or rad].
        """
        start = -np.inf if last is None else self.time[-1] - check_positive(last, "last", "[s]")
        try:
            chosen = self.error[:, coordinates]
        except (IndexError, TypeError, ValueError) as error:
            raise InvalidValueError(
                "not an index of coordinates", where="coordinates", given=coordinates,
                allowed=f"indices from 0 to {len(self.coordinate_name) - 1}, a mask or a slice",
            ) from error  # fmt: skip
        return float(np.abs(chosen[self.time >= start - 1e-12]).max(initial=0.0))

    def least_tension(self, since: float = 0.0) -> FloatArray:
        """Return the smallest tension of each member from a time [s] on, (n_members,) [N]."""
        if not is_number(since) or since > self.time[-1]:
            allowed = f"a time up to {self.time[-1]:g} [s]"
            raise InvalidValueError("out of range", where="since", given=since, allowed=allowed)
        found: FloatArray = self.member_tension[self.time >= since - 1e-12].min(axis=0)
        return found

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name, with the names of actuators, coordinates and members."""
        kept = {name: value for name, value in vars(self).items() if name != "warnings"}
        return {name: np.asarray(value) for name, value in kept.items() if value is not None}
