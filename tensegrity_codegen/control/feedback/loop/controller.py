"""The sampled controller: feedback about a motion within what the actuators can do; and its estimator."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import find_bristles, shift_commands, to_dense
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray

COMMAND_ROUNDING = 1e-12  # [m], by which a command may differ from what was wanted
OUTLIER_BOUND = 6.0  # standard deviations, up to which measurements may differ from their predictions
FIRST_INNOVATION = 100.0  # recent largest difference, which is not known at the start
INNOVATION_DECAY = 0.7  # of it from sample to sample
MAX_DOUBLINGS = 30  # of what is accepted after outliers, at most


class Controller:
    """Feedback u = u_motion - K (x - x_motion) at each sample, cut to rates and ranges.

    gains: feedback; None: the inputs of the motion alone.
    bounds: rates and ranges.
    sample [s]: time between two commands.
    distribution: finds tensions above the least ones that give the same forces.
    yielding (n_members,): members whose least tension the last command could not reach; None without a
        distribution.

    The input of the motion is that of the middle of the time in which the command holds, delays included. The
    sums of errors stand still while a command is cut, so that they do not grow without effect.
    """

    def __init__(
        self,
        motion: Motion,
        gains: Gains | None,
        bounds: ActuatorBounds,
        sample: float,
        distribution: TensionDistribution | None = None,
    ) -> None:
        self.motion, self.gains, self.bounds, self.sample = motion, gains, bounds, sample
        self.distribution = distribution
        self.yielding: NDArray[np.bool_] | None = None
        self.sums = np.zeros(0 if gains is None else len(gains.integral_action))
        self.shift, self.enter = shift_commands(np.zeros(0) if gains is None else gains.delay, sample)
        self.past = np.zeros(len(self.shift))
        self.command = motion.at(0.0).input[bounds.place]

    def step(self, k: int, state: FloatArray) -> tuple[FloatArray, str]:
        """Return the command of a sample, (n_actuators,) [m], and its status."""
        requested, error = self.find_wanted(k, state)
        if self.distribution is None:
            command, status = self.cut(requested)
        else:
            n = len(state) // 2
            distributed = self.distribution.distribute(k * self.sample, state[:n], requested, *self.reach())
            command, status, self.yielding = distributed.command, distributed.status, distributed.yielding
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
        requested = self.find_planned(k)
        error = state - np.concatenate([now.coordinate, now.velocity])
        if self.gains is not None:
            requested = requested - self.gains.at(k) @ np.concatenate([error, self.sums, self.past])
        return requested, error

    def find_planned(self, k: int) -> FloatArray:
        """Return the inputs of the motion for the command of a sample, (n_actuators,) [m]."""
        middle, late = (k + 0.5) * self.sample, self.bounds.delay
        inputs = {time: self.motion.at(middle + time).input for time in np.unique(late).tolist()}
        return np.array(
            [inputs[time][column] for time, column in zip(late.tolist(), self.bounds.place, strict=True)]
        )

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the next command within rates and ranges, (n_actuators,) each [m]."""
        step = self.bounds.rate * self.sample
        low = np.maximum(self.bounds.least, self.command - step)
        high = np.minimum(self.bounds.most, self.command + step)
        return np.minimum(low, high), high

    def cut(self, requested: FloatArray) -> tuple[FloatArray, str]:
        """Return the nearest command within rates and ranges, and the status."""
        low, high = self.reach()
        command = np.clip(requested, low, high)
        moved = np.abs(command - requested) > COMMAND_ROUNDING
        if not moved.any():
            return command, "ok"
        ranged = np.clip(requested, self.bounds.least, self.bounds.most)
        return command, "range_limited" if (
            np.abs(ranged - requested) > COMMAND_ROUNDING
        ).any() else "rate_limited"


# The estimator at work: predictions of the full model, corrected by measurements.


class Filter:
    """An estimator that runs from the start of a motion on.

    model: the model that the estimator knows.
    motion: whose start is the first prediction, without disturbances.
    arguments: run-time parameters where they differ from the scene.
    is_outlier: whether the last measurements were too far from their predictions, and were not used: further
        than six standard deviations, or twice what was accepted lately, or twice as far again after each
        outlier.
    """

    def __init__(
        self, model: CompiledModel, estimator: Estimator, motion: Motion, arguments: Mapping[str, Any]
    ) -> None:
        self.model, self.estimator, self.arguments = model, estimator, dict(arguments)
        self.start = start = motion.at(0.0)
        self.n = len(start.coordinate)
        self.state = np.concatenate([start.coordinate, start.velocity, np.zeros(len(estimator.disturbed))])
        self.is_outlier, self.n_outliers, self.innovation = False, 0, FIRST_INNOVATION

    @property
    def disturbance(self) -> FloatArray:
        """Estimated disturbance force on each coordinate, (n_coordinates,)."""
        force = np.zeros(self.n)
        force[self.estimator.disturbed] = self.state[2 * self.n :]
        return force

    def correct(self, time: float, measured: FloatArray, value: FloatArray) -> FloatArray:
        """Return the state (q, q') after a measurement, of which outliers are not used."""
        off = measured - self.estimator.sensing.measure(self._at(self.state, value))
        largest = float(np.abs(off * self.estimator.weight(time)).max(initial=0.0))
        self.is_outlier = largest > max(OUTLIER_BOUND, 2.0 * self.innovation) * 2.0**self.n_outliers
        if self.is_outlier:
            self.n_outliers = min(self.n_outliers + 1, MAX_DOUBLINGS)
        else:
            self.innovation, self.n_outliers = max(largest, INNOVATION_DECAY * self.innovation), 0
            self.state = self.state + self.estimator.at(time) @ off
        return self.state[: 2 * self.n].copy()

    def predict(self, span: float, value: FloatArray) -> None:
        """Move the state over a time span [s] with inputs (n_inputs,), by Runge-Kutta steps of order 4."""
        fraction = span / self.estimator.sample
        count = max(1, int(np.ceil(self.estimator.substeps * fraction - 1e-9)))
        step, x = span / count, self.state[: 2 * self.n]
        for _ in range(count):
            mass = to_dense(self.model.compute("mass_matrix", **self._at(x, value)))
            push = np.asarray(np.linalg.solve(mass, self.disturbance), dtype=np.float64)
            k1 = self._rate(x, value, push)
            k2 = self._rate(x + 0.5 * step * k1, value, push)
            k3 = self._rate(x + 0.5 * step * k2, value, push)
            k4 = self._rate(x + step * k3, value, push)
            x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self.state = np.concatenate([x, self.state[2 * self.n :]])

    def _rate(self, x: FloatArray, value: FloatArray, push: FloatArray) -> FloatArray:
        moved = np.asarray(self.model.compute("acceleration", **self._at(x, value)))
        return np.concatenate([x[self.n :], moved + push])

    def _at(self, state: FloatArray, value: FloatArray) -> dict[str, Any]:
        n = self.n
        return {
            **self.arguments,
            "coordinate": state[:n].copy(),
            "velocity": state[n : 2 * n].copy(),
            INPUT: value,
            **find_bristles(self.model, self.start, state[:n]),
        }
