"""Sliders of a running model: inputs, run-time parameters, gravity, damping, with ranges that suit them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.tables.manifest import ArgumentSpec, Manifest

# Factors of the values of the scene, by parameter; the others have no slider.
FACTORS = {
    "rest_length": ("rest lengths", 0.7, 1.3),
    "spring_constant": ("stiffness", 0.2, 3.0),
    "axial_stiffness": ("stiffness", 0.2, 3.0),
    "node_mass": ("masses", 0.5, 3.0),
}
GRAVITY = 20.0  # [m/s2]
DAMPED = 0.2  # part of critical damping of one cable with one node, the end of a slider that starts at none
LENGTH_PART = 0.15  # part of the rest length by which an input without a range changes it


@dataclass(frozen=True)
class Scales:
    """What is usual in a structure: size [m], force [N], mass of a node [kg], spring constant [N/m]."""

    size: float
    force: float
    mass: float
    stiffness: float


def find_scales(subject: Structure | BodySystem, structure: Structure) -> Scales:
    """Return what is usual in a structure, given with its outline."""
    size = float(np.linalg.norm(np.ptp(structure.node_position, axis=0))) or 1.0
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    carried = mass[(mass > 0) & ~structure.node_anchored.all(axis=1)]
    weight = float(mass.sum()) * float(np.linalg.norm(structure.gravity))
    tension = float(np.abs(structure.static_tension()).max(initial=0.0))
    cable = structure.tension_only & (structure.mu > 0)
    usual = float(np.median(structure.mu[cable])) if cable.any() else 1.0
    force = max(tension, weight) or 0.1 * usual * size
    least = float(carried.min()) if carried.size else 0.0
    if isinstance(subject, BodySystem):
        least = find_body_mass(subject)
    return Scales(size, force, least, usual)


class Sliders:
    """The sliders of a page, in the order in which they stand there."""

    def __init__(
        self, subject: Structure | BodySystem, structure: Structure, manifest: Manifest, scales: Scales
    ) -> None:
        self.subject, self.structure, self.scales = subject, structure, scales
        self.arguments = {item.name: item for item in manifest.arguments}
        self.axes = manifest.axes

    def build(self) -> list[dict[str, Any]]:
        """Return all sliders: label, argument, places in it, range, value, unit, whether it is a factor."""
        return [*self._inputs(), *self._gravity(), *self._damping(), *self._factors()]

    def _inputs(self) -> list[dict[str, Any]]:
        if "input" not in self.arguments:
            return []
        nominal = self.arguments["input"].nominal
        ranges = {actuator.name: actuator for actuator in self.subject.actuators}
        rows = []
        inputs: Sequence[ActuatedInput | BodyInput] = self.subject.inputs
        for k, item in enumerate(inputs):
            unit = {"rest_length": "m", "force": "N"}.get(item.kind, "N m")
            low, high = self._input_range(item, ranges.get(item.name))
            rows.append(_row(item.name, "input", [k], low, high, float(nominal[k]), unit))
        return rows

    def _input_range(self, item: ActuatedInput | BodyInput, actuator: Actuator | None) -> tuple[float, float]:
        """Return the range of an input: that of its actuator, else one that suits it."""
        if item.kind != "rest_length":
            reach = self.scales.force * (self.scales.size if item.kind == "torque" else 1.0)
            return -reach, reach
        rest = self.subject.rest_length[list(item.targets)]
        if actuator is not None and np.isfinite(actuator.range).all():
            return float(actuator.range[0] - rest.max()), float(actuator.range[1] - rest.min())
        reach = LENGTH_PART * float(rest.min())
        return -reach, reach

    def _gravity(self) -> list[dict[str, Any]]:
        if "gravity" not in self.arguments:
            return []
        up = 2 if 2 in self.axes else max(self.axes)
        place = self.axes.index(up)
        value = float(self.arguments["gravity"].nominal[place])
        label = f"gravity {'xyz'[up]}"
        reach = max(GRAVITY, 2 * abs(value))
        return [_row(label, "gravity", [place], -reach, reach, value, "m/s²")]

    def _damping(self) -> list[dict[str, Any]]:
        if "damping" not in self.arguments:
            return []
        argument = self.arguments["damping"]
        if any(argument.nominal):
            return [_factor("damping", argument, 0.0, 10.0)]
        mass = self.scales.mass or 1.0
        high = DAMPED * 2 * float(np.sqrt(self.scales.stiffness * mass))
        return [_row("damping", "damping", _places(argument), 0.0, high, 0.0, "N s/m")]

    def _factors(self) -> list[dict[str, Any]]:
        rows = []
        for name, (label, low, high) in FACTORS.items():
            if name in self.arguments and any(self.arguments[name].nominal):
                rows.append(_factor(label, self.arguments[name], low, high))
        return rows


def find_body_mass(system: BodySystem) -> float:
    """Return the mass of the lightest body that moves [kg]."""
    return min((body.mass for body in system.bodies if isinstance(body, Bar | RigidBody)), default=0.0)


def _places(argument: ArgumentSpec) -> list[int]:
    return list(range(len(argument.nominal)))


def _row(
    label: str, argument: str, places: list[int], low: float, high: float, value: float, unit: str
) -> dict[str, Any]:
    low, high = min(low, value), max(high, value)
    return {
        "label": label, "argument": argument, "places": places, "low": low, "high": high, "value": value,
        "unit": unit, "is_factor": False, "base": 0.0,
    }  # fmt: skip


def _factor(label: str, argument: ArgumentSpec, low: float, high: float) -> dict[str, Any]:
    row = _row(label, argument.name, _places(argument), low, high, 1.0, "")
    return row | {"is_factor": True}
