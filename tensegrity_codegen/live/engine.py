"""The interactive content of a page: a compiled model, a WebAssembly module, with the data for its calls.

Or a net whose force densities are moved by sliders, and whose shape is found in the page.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.live.live_scene import LiveScene, pack
from tensegrity_codegen.pipeline.forming.force_density import static_load
from tensegrity_codegen.pipeline.forming.form import Form
from tensegrity_codegen.pipeline.forming.targets import find_members
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import count_names
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR, find_row
from tensegrity_codegen.tables.manifest import STATUS, STATUS_TEXT, ArgumentSpec, Manifest
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS

# Factors of the values of the scene, by parameter; the others have no slider.
FACTORS = {
    "rest_length": ("rest lengths", 0.7, 1.3),
    "spring_constant": ("stiffness", 0.2, 3.0),
    "axial_stiffness": ("stiffness", 0.2, 3.0),
    "node_mass": ("masses", 0.5, 3.0),
}
GRAVITY = 20.0  # [m/s2]
DAMPED = 0.2  # part of critical damping of one cable with one node, the end of a slider that starts at none
TEMPERATURE_REACH = 100.0  # of inputs of temperature, up and down [K]
LENGTH_PART = 0.15  # part of the rest length by which an input without a range changes it

FACT = (
    "The shape follows from the force densities, tension over length, by linear equations that this page "
    "solves (Schek 1974). Rest lengths are those that give each member its tension."
)


@dataclass(frozen=True)
class Scales:
    """Typical values of a structure: size [m], force [N], mass of a node [kg], spring constant [N/m]."""

    size: float
    force: float
    mass: float
    stiffness: float


def find_scales(subject: Structure | BodySystem, structure: Structure) -> Scales:
    """Return the typical values of a structure, given with its outline."""
    size = float(np.linalg.norm(np.ptp(structure.node_position, axis=0))) or 1.0
    mass = structure.lumped_mass
    moved = np.where(structure.is_corner, 0.0, structure.effective_mass)
    carried = moved[(moved > 0) & ~structure.node_anchored.all(axis=1)]
    weight = float(mass.sum()) * float(np.linalg.norm(structure.gravity))
    tension = float(np.abs(structure.static_tension()).max(initial=0.0))
    cable = structure.tension_only & (structure.mu > 0)
    usual = float(np.median(structure.mu[cable])) if cable.any() else 1.0
    force = max(tension, weight) or 0.1 * usual * size
    lightest = float(carried.min()) if carried.size else 0.0
    if isinstance(subject, BodySystem):
        moving = [body.mass for body in subject.bodies if isinstance(body, Bar | RigidBody)]
        lightest = min(moving, default=0.0)
    return Scales(size, force, lightest, usual)


class Sliders:
    """The sliders of a page, in the order in which they stand there."""

    def __init__(
        self, subject: Structure | BodySystem, structure: Structure, manifest: Manifest, scales: Scales
    ) -> None:
        self.subject, self.structure, self.scales = subject, structure, scales
        self.arguments = {argument.name: argument for argument in manifest.arguments}
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
        for k, scene_input in enumerate(inputs):
            low, high = self._input_range(scene_input, ranges.get(scene_input.name))
            rows.append(
                _row(
                    scene_input.name,
                    "input",
                    [k],
                    low,
                    high,
                    float(nominal[k]),
                    INPUT_UNITS[scene_input.kind],
                )
            )
        return rows

    def _input_range(self, item: ActuatedInput | BodyInput, actuator: Actuator | None) -> tuple[float, float]:
        """Return the range of an input: that of its actuator, else one that suits it."""
        if item.kind == "temperature":
            return -TEMPERATURE_REACH, TEMPERATURE_REACH
        if item.kind != "rest_length":
            reach = self.scales.force * (self.scales.size if item.kind == "torque" else 1.0)
            return -reach, reach
        rest_length = self.subject.rest_length[list(item.targets)]
        if actuator is not None and np.isfinite(actuator.range).all():
            return float(actuator.range[0] - rest_length.max()), float(actuator.range[1] - rest_length.min())
        reach = LENGTH_PART * float(rest_length.min())
        return -reach, reach

    def _gravity(self) -> list[dict[str, Any]]:
        if "gravity" not in self.arguments:
            return []
        up = 2 if 2 in self.axes else max(self.axes)
        index = self.axes.index(up)
        value = float(self.arguments["gravity"].nominal[index])
        label = f"gravity {'xyz'[up]}"
        reach = max(GRAVITY, 2 * abs(value))
        return [_row(label, "gravity", [index], -reach, reach, value, "m/s²")]

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


EXPLICIT = "rk54"
DAMPED_OUT = (
    f"The method {STIFF_INTEGRATOR} damps vibrations of stiff bars that its steps do not resolve; "
    "rk54 does not."
)

MAX_WORK = 1e6  # members times explicit steps a simulated second above which implicit ones are considered
STIFFER = 20.0  # bars to cables, as frequencies, from which implicit steps are so much longer that they pay
PULL = 0.2  # of the structure's size: displacement at which a pull of strength 1 has the usual force
STATE = ("coordinate", "velocity", "internal")
UNSHOWN = ("held", "reaction", "use")  # of stated positions only


def add_engine(
    scene: LiveScene,
    subject: Structure | BodySystem,
    manifest: Manifest,
    module: bytes,
    *,
    rtol: float,
    method: str = "auto",
    profile: Profile | None = None,
) -> LiveScene:
    """Return a live scene with a compiled model inside."""
    structure = outline_bodies(subject)
    methods = {spec.name: spec for spec in manifest.integrators}
    method = choose_method(structure, methods) if method == "auto" else method
    sizes = {argument.name: len(argument.nominal) for argument in manifest.arguments}
    scales = find_scales(subject, structure)
    engine: dict[str, Any] = {
        "methods": [
            {
                "name": spec.name,
                "symbol": spec.symbol,
                "arguments": spec.arguments,
                "work_size": spec.work_size,
                "is_stiff": find_row(spec.name, manifest.needs_state_jacobian).kind == "implicit",
                "tensions": spec.tensions,
            }
            for spec in manifest.integrators
        ],
        "method": method,
        "rtol": rtol,
        "atol": 1e-3 * rtol * scales.size,
        "axes": manifest.axes,
        "sizes": sizes,
        "changeable": [name for name in sizes if name not in STATE],
        "functions": {
            spec.quantity: {
                "symbol": spec.symbol,
                "inputs": spec.arguments,
                "size": max(math.prod(spec.shape), 1),
            }
            for spec in manifest.functions
        },
        "bodies": [
            {"corner": body.corner, "point": body.point, "weights": body.weights}
            for body in manifest.body_places
        ],
        "statuses": [f"{name}: {STATUS_TEXT[name]}" for name in STATUS],
        "size": scales.size,
        "usual_force": scales.force,
        "sliders": Sliders(subject, structure, manifest, scales).build(),
        "pull": {
            "mass": scales.mass,
            "stiffness": scales.force / (PULL * scales.size),
            "place": sum(sizes[name] for name in manifest.driven[:-1]),
        },
    }
    # Inputs that follow a profile have no sliders.
    if profile is not None:
        inputs = [manifest.input_name.index(name) for name in profile.values]
        engine["profile"] = {
            "inputs": inputs,
            "place": sum(sizes[name] for name in manifest.driven[: manifest.driven.index("input")]),
            "time": profile.time.tolist(),
            "values": [row.tolist() for row in profile.values.values()],
        }
        engine["sliders"] = [
            row for row in engine["sliders"] if row["argument"] != "input" or row["places"][0] not in inputs
        ]
    # Arrays that the engine reads, and sentences on it.
    coordinates = [3 * node + axis for node, axis in manifest.coordinate_node_axis]
    channels = {name: channel for name, channel in scene.channels.items() if name not in UNSHOWN}
    channels |= {
        f"nominal_{argument.name}": pack(np.asarray(argument.nominal, dtype=float).ravel(), "float64")
        for argument in manifest.arguments
    }
    channels |= {
        "coordinate_place": pack(np.asarray(coordinates), "int32"),
        "stated_position": pack(manifest.stated_position.ravel(), "float64"),
        "module": pack(np.frombuffer(module, dtype=np.uint8), "uint8"),
    }
    facts = (
        f"The compiled model runs in this page: {' or '.join(methods)} with error control, relative "
        f"tolerance {rtol:g} of each step. A pull is a spring and a damper between node and pointer, in the "
        "equations of motion.",
        *((f"Inputs follow their profile until {profile.t_end:g} s, then stand still.",) if profile else ()),
        *((DAMPED_OUT,) if any(row["is_stiff"] for row in engine["methods"]) else ()),
        *(fact for fact in scene.facts if not fact.startswith("Reactions")),
    )
    return replace(scene, data={**scene.data, "engine": engine}, channels=channels, facts=facts)


def choose_method(structure: Structure, methods: Collection[str]) -> str:
    """Return the integrator with which a page starts: implicit where stiff bars keep rk54 from real time.

    The largest frequency is at most the root of the largest sum of 2 k / m over the members of a node
    (Gershgorin), with spring constants k and the mass m of the node; rk54 takes 0.5 to 3 steps a radian of it
    at a tolerance of 1e-6.
    """
    if STIFF_INTEGRATOR not in methods:
        return EXPLICIT
    steps = 1.5 * _bound_frequency(structure)
    slow = 1.5 * _bound_frequency(structure, structure.tension_only)
    work = structure.n_members * steps
    return STIFF_INTEGRATOR if work > MAX_WORK and steps > STIFFER * slow else EXPLICIT


def _bound_frequency(structure: Structure, chosen: NDArray[np.bool_] | None = None) -> float:
    """Return a bound of the frequencies [rad/s] with the chosen members only."""
    ends = structure.connectivity
    spring = np.where(structure.is_rigid, 0.0, structure.mu)
    spring = spring if chosen is None else np.where(chosen, spring, 0.0)
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, ends.ravel(), np.repeat(structure.member_mass / 6, 2))
    mass[structure.is_attached] = structure.effective_mass[structure.is_attached]
    total = np.zeros(structure.n_nodes)
    np.add.at(total, ends.ravel(), np.repeat(2.0 * spring, 2))
    moving = (mass > 0) & ~structure.node_anchored.all(axis=1)
    return float(np.sqrt((total[moving] / mass[moving]).max(initial=0.0)))


# A net whose force densities are moved by sliders.


def add_forming(scene: LiveScene, form: Form, density: Mapping[str, float]) -> LiveScene:
    """Return a live scene of a shape whose force densities, loads and heights of supports have sliders."""
    structure = form.structure
    group, rank = np.full(structure.n_members, -1), np.full(structure.n_members, 9)
    for k, name in enumerate(density):
        members, order = find_members(structure, name, "density")
        chosen = [e for e in members if order < rank[e]]
        group[chosen], rank[chosen] = k, order
    if (group < 0).any():
        raise InvalidValueError(
            "a page of shapes needs the force density of every member",
            where=structure.name,
            given=f"none of {count_names([structure.member_name[e] for e in np.flatnonzero(group < 0)])}",
            allowed="a force density of each member",
            hint="`density` cables=100; shapes of stated forces and lengths are written as scenes (.toml)",
        )
    # Groups of members with one force density each, and arrays for the linear equations.
    forming = {
        "groups": [{"label": name, "density": value} for name, value in density.items()],
        "document": form.document,
    }
    linear = structure.is_linear
    channels = {name: channel for name, channel in scene.channels.items() if name != "use"} | {
        "form_order": pack(_order_nodes(structure), "int32"),
        "form_group": pack(group, "int32"),
        "form_position": pack(structure.node_position.ravel(), "float64"),
        "form_weight": pack((static_load(structure) - structure.node_load).ravel(), "float64"),
        "axial_stiffness": pack(structure.axial_stiffness, "float64"),
        "spring_constant": pack(np.where(linear, structure.spring_constant, np.nan), "float64"),
    }
    return replace(
        scene, data={**scene.data, "forming": forming}, channels=channels, facts=(FACT, *scene.facts)
    )


def _order_nodes(structure: Structure) -> Any:
    """Return the nodes in an order in which neighbours are near to each other (Cuthill and McKee)."""
    i, j = structure.connectivity.T
    n = structure.n_nodes
    graph = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(n, n))
    return scipy.sparse.csgraph.reverse_cuthill_mckee(scipy.sparse.csr_array(graph + graph.T), True)
