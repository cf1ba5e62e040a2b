"""Gains of feedback and of estimators along a motion, by the names of python-control; measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.linear_samples import to_dense
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.records.timed_motion import choose_even_knots
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, is_number, is_whole
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, check_choice
from tensegrity_codegen.system.extras import CONTROL, import_extra
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.body_places import compute_spins

MAX_KNOTS = 25  # of stored gains

MEMBER_KINDS = ("member_length", "member_tension")
UNITS = {
    "member_length": "m", "member_tension": "N", "node_position": "m", "node_velocity": "m/s",
    "angular_velocity": "rad/s",
}  # fmt: skip
STEP = 1e-6  # of differences; coordinates are lengths of structures of a metre, or angles


def _interpolate(knots: FloatArray, rows: FloatArray, time: float) -> FloatArray:
    """Return the row at a time [s], linear between knots; after the last knot its row."""
    if len(rows) == 1 or time >= knots[-1]:
        return np.asarray(rows[-1])
    k = max(int(np.searchsorted(knots, time, side="right")) - 1, 0)
    fraction = max(time - float(knots[k]), 0.0) / float(knots[k + 1] - knots[k])
    return np.asarray((1.0 - fraction) * rows[k] + fraction * rows[k + 1])


@dataclass(frozen=True, eq=False, repr=False)
class Gains(Summarised):
    """Feedback gains along a motion: u = u_motion - K (x - x_motion), as of python-control's `dlqr`.

    The state x is (q, q'), then z, the sums of the outputs' errors: z[k+1] = z[k] + C (x[k] - x_motion[k]),
    then the commands on their way minus those of the motion, of each actuator the latest first.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Sample times, or knots among them; after the last one its gains hold.
    K : ndarray, shape (n_t, n_actuators, n_states + n_past)
        Gains; n_past commands are on their way where actuators have delays.
    S : ndarray, shape (n_t, n_states, n_states)
        Solutions of the Riccati recursion, of (x, z); the last one is the stationary solution.
    E : ndarray of complex, shape (n_states + n_past,)
        Eigenvalues of the closed loop at the end point.
    A, B : ndarray, shape (n_x, n_x) and (n_x, n_actuators)
        Sampled linear model at the end point, x = (q, q').
    integral_action : ndarray, shape (n_integrals, n_x)
        C.
    delay : ndarray, shape (n_actuators,) [s]
        Delays of the actuators that the gains predict.
    sample : float [s]
        Sample time.
    residual : float
        Residual of the stationary Riccati equation over the largest entry of its solution.
    actuators, state_name, integral_name : tuple of str
        Names of actuators, of the states (q, q'), and of the sums.
    """

    time: FloatArray
    K: FloatArray
    S: FloatArray
    E: NDArray[np.complex128]
    A: FloatArray
    B: FloatArray
    integral_action: FloatArray
    delay: FloatArray
    sample: float
    residual: float
    actuators: tuple[str, ...]
    state_name: tuple[str, ...]
    integral_name: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze_fields(self)

    def at(self, step: int) -> FloatArray:
        """Return the gains of a sample, (n_actuators, n_states); after the motion those of its end."""
        return _interpolate(self.time, self.K, step * self.sample)

    def at_knots(self, count: int = MAX_KNOTS) -> "Gains":
        """Return the gains of some of the sample times, between which they are interpolated.

        Parameters
        ----------
        count : int
            Largest number of knots; evenly distributed samples, the first and the last among them.

        Returns
        -------
        Gains
            The same design with fewer gains; all of them if there are no more than `count`.

        Raises
        ------
        InvalidValueError
            Fewer than two knots.
        """
        rows = choose_even_knots(len(self.time), count)
        if rows is None:
            return self
        return replace(self, time=self.time[rows], K=self.K[rows], S=self.S[rows])

    def state_space(self) -> Any:
        """Return the sampled linear model at the end point.

        Returns
        -------
        control.StateSpace
            x[k+1] = A x[k] + B u[k], y = x, of the deviations from the motion.

        Raises
        ------
        MissingExtraError
            python-control is not installed.
        """
        control = import_extra("control", CONTROL)
        n, m = self.B.shape
        return control.ss(
            self.A,
            self.B,
            np.eye(n),
            np.zeros((n, m)),
            self.sample,
            inputs=list(self.actuators),
            states=list(self.state_name),
            outputs=[f"{name} measured" for name in self.state_name],
        )


@dataclass(frozen=True)
class Sensing:
    """The measurements of a model, number by number."""

    model: CompiledModel
    sensors: tuple[Sensor, ...]  # the sensors and their noise
    names: tuple[str, ...]  # name of each number, such as "length of top1" or "top1.x"
    noise: FloatArray  # (n_y,): standard deviation of each, in its unit

    def measure(self, at: Mapping[str, Any]) -> FloatArray:
        """Return the numbers without noise, (n_y,), at a state and inputs."""
        return np.concatenate([self._read(sensor, at) for sensor in self.sensors])

    def slopes(self, at: Mapping[str, Any]) -> FloatArray:
        """Return the derivatives of the numbers by the state (q, q'), (n_y, n_states)."""
        return np.vstack([self._slope(sensor, at) for sensor in self.sensors])

    def _read(self, sensor: Sensor, at: Mapping[str, Any]) -> FloatArray:
        rows = list(sensor.targets)
        if sensor.kind in MEMBER_KINDS:
            return np.asarray(self.model.compute(sensor.kind, **at), dtype=float)[rows]
        axes = list(self.model.manifest.axes)
        arguments = {name: value for name, value in at.items() if name not in ("coordinate", "velocity")}
        q, v = at["coordinate"], at["velocity"]
        if sensor.kind == "node_position":
            values = place_nodes(self.model, q, arguments.get("anchor_position"), arguments=arguments)
        else:
            values = place_velocities(self.model, q, v, arguments=arguments)
        if sensor.kind == "angular_velocity":
            place = place_nodes(self.model, q, arguments.get("anchor_position"), arguments=arguments)
            values = compute_spins(self.model.manifest.body_places, place, values)
        return values[np.ix_(rows, axes)].ravel()

    def _slope(self, sensor: Sensor, at: Mapping[str, Any]) -> FloatArray:
        n = len(at["coordinate"])
        if sensor.kind == "member_length":
            dense = to_dense(self.model.compute("equilibrium_matrix", **at))
            return np.hstack([dense.T[list(sensor.targets)], np.zeros((len(sensor.targets), n))])
        columns = []
        for name in ("coordinate", "velocity"):
            for k in range(n):
                ends = []
                for sign in (1.0, -1.0):
                    moved = np.array(at[name], dtype=float)
                    moved[k] += sign * STEP
                    ends.append(self._read(sensor, {**at, name: moved}))
                columns.append((ends[0] - ends[1]) / (2 * STEP))
        return np.array(columns).T


def find_sensing(model: CompiledModel, sensors: Sequence[Sensor] | None = None) -> Sensing:
    """Return the measurements of a model."""
    structure, manifest = model.structure, model.manifest
    stated: Any = sensors
    if sensors is None:
        stated = () if structure is None else structure.sensors
    check_instance(stated, (list, tuple), "sensors", "a list of Sensor")
    chosen = tuple(stated)
    for k, sensor in enumerate(chosen):
        check_instance(sensor, Sensor, f"sensors[{k}]", "a Sensor")
        check_choice(sensor.kind, tuple(UNITS), "kind of sensor", f"sensors[{k}].kind")
    if not chosen:
        raise StructureError(
            "no sensors",
            where=f"{manifest.name}: sensors",
            given="none",
            allowed="at least one table [[sensors]] with kind, members or nodes, and noise",
        )
    # The quantities that they need, and name and noise of each number.
    needed: set[str] = {sensor.kind for sensor in chosen if sensor.kind in MEMBER_KINDS}
    if "member_length" in needed:
        needed.add("equilibrium_matrix")
    require_quantities(model, sorted(needed), "these sensors need")
    names: list[str] = []
    noise: list[float] = []
    for k, sensor in enumerate(chosen):
        labels = _name(sensor, model, f"sensors[{k}]")
        names += labels
        noise += [sensor.noise] * len(labels)
    return Sensing(model, chosen, tuple(names), np.array(noise))


def _name(sensor: Sensor, model: CompiledModel, where: str) -> list[str]:
    """Return the names of a sensor's numbers; raises InvalidValueError for one that cannot be used."""
    manifest = model.manifest
    if not is_number(sensor.noise) or sensor.noise <= 0.0:
        raise InvalidValueError(
            "an estimator needs the noise of its sensors",
            where=f"{where}.noise",
            given=sensor.noise,
            allowed=f"a standard deviation > 0 [{UNITS[sensor.kind]}]",
        )
    targets = manifest.member_name if sensor.kind in MEMBER_KINDS else manifest.node_name
    if sensor.kind == "angular_velocity":
        targets = tuple(body.name for body in manifest.body_places)
    is_list = isinstance(sensor.targets, list | tuple) and len(sensor.targets) > 0
    if not is_list or not all(is_whole(e) and 0 <= e < len(targets) for e in sensor.targets):
        raise InvalidValueError(
            "a sensor measures nothing that exists",
            where=f"{where}.targets",
            given=sensor.targets,
            allowed=f"indices from 0 to {len(targets) - 1}",
        )
    if sensor.kind in MEMBER_KINDS:
        return [f"{sensor.kind.removeprefix('member_')} of {targets[e]}" for e in sensor.targets]
    mark = {"node_velocity": "'", "angular_velocity": " spin"}.get(sensor.kind, "")
    return [f"{targets[i]}.{'xyz'[axis]}{mark}" for i in sensor.targets for axis in manifest.axes]


# The record of an estimator: gains at knots along a motion.


@dataclass(frozen=True, eq=False, repr=False)
class Estimator(Summarised):
    """An extended Kalman filter with gains stored at knots along a motion.

    The state is (q, q', d), d the disturbance forces on some coordinates. At each sample the prediction p of
    the full model is corrected by the measurements y: p + L (y - h(p)).

    Attributes
    ----------
    time : ndarray, shape (n_knots,) [s]
        Times of the knots; gains in between are interpolated, after the last one its gains hold.
    L : ndarray, shape (n_knots, n_states, n_y)
        Gains. A L is the gain of python-control's `dlqe`, with A the transition of the state.
    P : ndarray, shape (n_knots, n_states, n_states)
        Stationary covariances of the predictions.
    innovation : ndarray, shape (n_knots, n_y)
        Standard deviations of measurements minus their predictions.
    E : ndarray of complex, shape (n_states,)
        Eigenvalues of the error at the end point, from sample to sample.
    sample : float [s]
        Time between two measurements.
    residual : float
        Largest residual of the stationary Riccati equations over the largest entry of their solutions.
    substeps : int
        Runge-Kutta steps of the prediction in a sample.
    disturbed : ndarray of int, shape (n_disturbances,)
        Indices of the coordinates that have a disturbance force.
    sensing : Sensing
        The sensors, with names and noise.
    state_name : tuple of str
        Names of the states.
    """

    time: FloatArray
    L: FloatArray
    P: FloatArray
    innovation: FloatArray
    E: NDArray[np.complex128]
    sample: float
    residual: float
    substeps: int
    disturbed: NDArray[np.int64]
    sensing: Sensing
    state_name: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze_fields(self)

    def at(self, time: float) -> FloatArray:
        """Return the gains at a time [s], (n_states, n_y)."""
        return _interpolate(self.time, self.L, time)

    def weight(self, time: float) -> FloatArray:
        """Return 1 over the standard deviations of measurements minus predictions at a time [s], (n_y,)."""
        return _interpolate(self.time, 1.0 / self.innovation, time)
