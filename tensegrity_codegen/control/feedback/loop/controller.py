"""The sampled controller: feedback about a motion, within what the actuators can do."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.delays import shift_commands
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray

SAME = 1e-12  # [m], by which a command may differ from what was wanted


class Answer(Protocol):
    """The command of one sample, its status, and the members whose least tension yields."""

    @property
    def command(self) -> FloatArray:
        """Inputs of the actuators, (n_actuators,) [m]."""
        ...

    @property
    def status(self) -> str:
        """Status of the step."""
        ...

    @property
    def yielding(self) -> NDArray[np.bool_]:
        """Members whose least tension yields, (n_members,)."""
        ...


class Distribution(Protocol):
    """What finds the tensions of a sample."""

    def distribute(
        self, time: float, coordinate: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray
    ) -> Answer:
        """Return the command of a sample within the bounds low and high [m]."""
        ...


class Controller:
    """Feedback u = u_motion - K (x - x_motion) at each sample, cut to rates and ranges.

    Parameters
    ----------
    motion : Motion
        The motion to hold.
    gains : Gains or None
        Feedback; None: the inputs of the motion alone.
    bounds : ActuatorBounds
        Rates and ranges.
    sample : float [s]
        Time between two commands.
    distribution : TensionDistribution, optional
        Finds tensions above the least ones that give the same forces.

    Attributes
    ----------
    yielding : ndarray of bool, shape (n_members,), or None
        Members whose least tension the last command could not reach; None without a distribution.

    Notes
    -----
    The input of the motion is that of the middle of the time in which the command holds, delays included. The
    sums of errors stand still while a command is cut, so that they do not grow without effect.
    """

    def __init__(
        self,
        motion: Motion,
        gains: Gains | None,
        bounds: ActuatorBounds,
        sample: float,
        distribution: Distribution | None = None,
    ) -> None:
        self.motion, self.gains, self.bounds, self.sample = motion, gains, bounds, sample
        self.distribution = distribution
        self.yielding: NDArray[np.bool_] | None = None
        self.sums = np.zeros(0 if gains is None else len(gains.integral_action))
        self.shift, self.enter = shift_commands(np.zeros(0) if gains is None else gains.delay, sample)
        self.past = np.zeros(len(self.shift))
        self.command = motion.at(0.0).input[bounds.place]

    def step(self, k: int, state: FloatArray) -> tuple[FloatArray, str]:
        """Return the command of a sample, (n_actuators,) [m], and its status.

        Parameters
        ----------
        k : int
            Number of the sample, from 0.
        state : ndarray, shape (n_states,)
            Coordinates and velocities, true or estimated.
        """
        wanted, error = self.find_wanted(k, state)
        if self.distribution is None:
            command, status = self.cut(wanted)
        else:
            n = len(state) // 2
            found = self.distribution.distribute(k * self.sample, state[:n], wanted, *self.reach())
            command, status, self.yielding = found.command, found.status, found.yielding
        if status == "ok" and self.gains is not None:
            self.sums = self.sums + self.gains.integral_action @ error
        self.command = command
        self._remember(command - self.find_planned(k))
        return command, status

    def hold(self, k: int) -> tuple[FloatArray, str]:
        """Return the last command for another sample, where measurements were not used."""
        self._remember(self.command - self.find_planned(k))
        return self.command, "outlier"

    def _remember(self, change: FloatArray) -> None:
        """Take what a command differs from the motion by, (n_actuators,) [m], among those on their way."""
        if len(self.past):
            self.past = self.shift @ self.past + self.enter @ change

    def find_wanted(self, k: int, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the gains ask of the actuators [m], and the error of the state."""
        now = self.motion.at(k * self.sample)
        wanted = self.find_planned(k)
        error = state - np.concatenate([now.coordinate, now.velocity])
        if self.gains is not None:
            wanted = wanted - self.gains.at(k) @ np.concatenate([error, self.sums, self.past])
        return wanted, error

    def find_planned(self, k: int) -> FloatArray:
        """Return the inputs of the motion for the command of a sample, (n_actuators,) [m]."""
        middle, late = (k + 0.5) * self.sample, self.bounds.delay
        inputs = {time: self.motion.at(middle + time).input for time in np.unique(late).tolist()}
        return np.array(
            [inputs[time][place] for time, place in zip(late.tolist(), self.bounds.place, strict=True)]
        )

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the next command within rates and ranges, (n_actuators,) each [m]."""
        step = self.bounds.rate * self.sample
        low = np.maximum(self.bounds.least, self.command - step)
        high = np.minimum(self.bounds.most, self.command + step)
        return np.minimum(low, high), high

    def cut(self, wanted: FloatArray) -> tuple[FloatArray, str]:
        """Return the nearest command within rates and ranges, and the status."""
        low, high = self.reach()
        command = np.clip(wanted, low, high)
        moved = np.abs(command - wanted) > SAME
        if not moved.any():
            return command, "ok"
        ranged = np.clip(wanted, self.bounds.least, self.bounds.most)
        return command, "range_limited" if (np.abs(ranged - wanted) > SAME).any() else "rate_limited"
