"""What the sensors of a scene measure, and how that changes with the state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.model.require import require_quantities
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, is_number, is_whole
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, check_choice

MEMBER_KINDS = ("member_length", "member_tension")
UNITS = {"member_length": "m", "member_tension": "N", "node_position": "m", "node_velocity": "m/s"}
STEP = 1e-6  # of differences; coordinates are lengths of structures of a metre, or angles


@dataclass(frozen=True)
class Sensing:
    """The measurements of a model, number by number.

    Attributes
    ----------
    model : CompiledModel
        The model.
    sensors : tuple of Sensor
        What is measured.
    names : tuple of str
        Name of each number, such as "length of top1" or "top1.x".
    noise : ndarray, shape (n_y,)
        Standard deviation of each, in its unit.
    """

    model: CompiledModel
    sensors: tuple[Sensor, ...]
    names: tuple[str, ...]
    noise: FloatArray

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
        given = {name: value for name, value in at.items() if name not in ("coordinate", "velocity")}
        q, v = at["coordinate"], at["velocity"]
        if sensor.kind == "node_position":
            place = place_nodes(self.model, q, given.get("anchor_position"), arguments=given)
        else:
            place = place_velocities(self.model, q, v, arguments=given)
        return place[np.ix_(rows, axes)].ravel()

    def _slope(self, sensor: Sensor, at: Mapping[str, Any]) -> FloatArray:
        n = len(at["coordinate"])
        if sensor.kind == "member_length":
            matrix = self.model.compute("equilibrium_matrix", **at)
            dense = matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)
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
    """Return the measurements of a model.

    Parameters
    ----------
    model : CompiledModel
        With its structure.
    sensors : sequence of Sensor, optional
        What is measured; by default the sensors of the scene.

    Returns
    -------
    Sensing
        All numbers, sensor by sensor.

    Raises
    ------
    StructureError
        There are no sensors.
    InvalidValueError
        A sensor without noise, or of members or nodes that do not exist.
    FormulationError
        The model does not compute what is measured.
    """
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
    known = manifest.member_name if sensor.kind in MEMBER_KINDS else manifest.node_name
    is_list = isinstance(sensor.targets, list | tuple) and len(sensor.targets) > 0
    if not is_list or not all(is_whole(e) and 0 <= e < len(known) for e in sensor.targets):
        raise InvalidValueError(
            "a sensor measures nothing that exists",
            where=f"{where}.targets",
            given=sensor.targets,
            allowed=f"indices from 0 to {len(known) - 1}",
        )
    if sensor.kind in MEMBER_KINDS:
        return [f"{sensor.kind.removeprefix('member_')} of {known[e]}" for e in sensor.targets]
    mark = "'" if sensor.kind == "node_velocity" else ""
    return [f"{known[i]}.{'xyz'[axis]}{mark}" for i in sensor.targets for axis in manifest.axes]
