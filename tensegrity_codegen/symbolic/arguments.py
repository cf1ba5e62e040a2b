"""Run-time arguments as symbols, everything else as numbers that fold away.

An expression built on these values carries only the changeable values of the scene: a number takes part in
CasADi's constant folding (0 x -> 0, x + 0 -> x), so an absent gravity or damping leaves no trace.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.memory import find_start
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.free_bodies import BodyFrame
from tensegrity_codegen.symbolic.geometry import Scalar
from tensegrity_codegen.symbolic.model import ModelArgument
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.laws import LAW_PARAMETERS
from tensegrity_codegen.tables.manifest import SET_STATES
from tensegrity_codegen.tables.quantities import ARGUMENTS, PARAMETERS

WITH_MEMBERS = "Internal states: memory of members, deflections of contacts with friction."


class ChangeableArguments(ABC):
    """Run-time arguments by name, and values of which those that may change are their symbols.

    parameters: argument name -> indices that stay changeable; n_axes: components of vectors.
    """

    def __init__(self, parameters: Mapping[str, tuple[int, ...]], n_axes: int) -> None:
        self.parameters, self.n_axes = parameters, n_axes
        self.symbols: dict[str, ca.SX] = {}

    def ordered(self) -> dict[str, ModelArgument]:
        """Return the arguments in the fixed order, with the scene's values."""
        return {name: self._argument(name) for name in ARGUMENTS if name in self.symbols}

    def parameter_symbols(self) -> ca.SX:
        """Return all run-time parameters stacked in argument order, (n_parameters, 1)."""
        chosen = [self.symbols[name] for name in PARAMETERS if name in self.parameters]
        return ca.vertcat(*[ca.vec(symbol) for symbol in chosen]) if chosen else ca.SX(0, 1)

    @abstractmethod
    def _argument(self, name: str) -> ModelArgument:
        """Return an argument with the scene's value."""

    def _symbol(self, name: str, rows: int, columns: int = 1) -> ca.SX:
        self.symbols[name] = ca.SX.sym(name, rows, columns)
        return self.symbols[name]

    def _scalars(self, name: str, values: Any) -> list[Scalar]:
        result = [ca.SX(float(value)) for value in values]
        if name in self.parameters:
            symbol = self._symbol(name, len(self.parameters[name]))
            for position, index in enumerate(self.parameters[name]):
                check_whole(index, f"parameters.{name}", 0, len(result) - 1)
                result[index] = symbol[position]
        return result

    def _vectors(self, name: str, values: Any) -> list[list[Scalar]]:
        result = [[ca.SX(float(value)) for value in row] for row in np.asarray(values)]
        if name in self.parameters:
            # Columns are nodes, so that the bytes are those of a C-ordered (k, n_axes) array.
            symbol = self._symbol(name, self.n_axes, len(self.parameters[name]))
            for position, index in enumerate(self.parameters[name]):
                check_whole(index, f"parameters.{name}", 0, len(result) - 1)
                result[index] = [symbol[row, position] for row in range(self.n_axes)]
        return result

    def _gravity(self, values: Any) -> list[Scalar]:
        if "gravity" in self.parameters:
            symbol = self._symbol("gravity", len(values))
            return [symbol[row] for row in range(len(values))]
        return [ca.SX(float(value)) for value in values]


class SymbolicArguments(ChangeableArguments):
    """Values of a structure, element by element: a symbol where it may change at run time, else a number.

    structure: the structure; parameters: argument name -> indices that stay changeable.
    Raises FormulationError for an argument that no structure has.
    """

    def __init__(self, structure: Structure, parameters: Mapping[str, tuple[int, ...]]) -> None:
        check_parameters(parameters)
        super().__init__(parameters, len(structure.axes))
        self.structure = structure
        axes = list(structure.axes)
        self.free = structure.coordinate_node_axis
        n_coordinates = len(self.free)
        self._symbol("coordinate", n_coordinates)
        self._symbol("velocity", n_coordinates)
        self.internal: dict[str, Scalar] = {}  # internal states by name
        if structure.internal_name:
            states = ca.vertsplit(self._symbol("internal", len(structure.internal_name)))
            self.internal = dict(zip(structure.internal_name, states, strict=True))
        self._symbol("input", len(structure.inputs))
        self.rest_length = self._scalars("rest_length", structure.rest_length)
        self.spring_constant = self._scalars("spring_constant", structure.spring_constant)
        self.axial_stiffness = self._scalars("axial_stiffness", structure.axial_stiffness)
        self.damping = self._scalars("damping", structure.damping)
        self.law_parameter = {
            name: self._scalars(name, structure.member_value(name)) for name in LAW_PARAMETERS
        }
        self.node_mass = self._scalars("node_mass", structure.node_mass)
        bodies = structure.bodies
        self.body_mass = self._scalars("body_mass", [body.mass for body in bodies])
        self.body_inertia = self._vectors("body_inertia", [body.principal_inertia for body in bodies])
        for k in parameters.get("body_mass", ()):  # corners have constant shares of the mass
            for node, mass in zip(bodies[k].corner, bodies[k].tetrahedron[2].tolist(), strict=True):
                self.node_mass[node] = mass / bodies[k].mass * self.body_mass[k]
        self.node_load = self._vectors("node_load", structure.node_load[:, axes])
        self.gravity = self._gravity(structure.gravity[axes])
        self.ground = self._ground()
        fixed = self._vectors("anchor_position", structure.node_position[:, axes])
        column = {axis: position for position, axis in enumerate(self.structure.axes)}
        result = [list(row) for row in fixed]
        for index, (node, axis) in enumerate(self.free):
            result[node][column[axis]] = self.symbols["coordinate"][index]
        self.position = result
        self.velocity = self._velocities()
        about = zip(bodies, self.body_mass, self.body_inertia, strict=True)
        self.body_frames = [BodyFrame(*body, self.position, self.velocity) for body in about]
        for frame in self.body_frames:
            for node, local in zip(frame.body.point, frame.body.point_local, strict=True):
                self.position[node], self.velocity[node] = frame.place(local)
        self.rest_rate: dict[int, Scalar] = {}  # of rest lengths that motors change, by member
        self.add_inputs()
        self._add_slips()

    def member_values(self, e: int) -> dict[str, Scalar]:
        """Return the values of the law of member e: MEMBER_VALUES, and the internal states of its memory."""
        law, member = self.structure.law_of(e), self.structure.member_name[e]
        set_state = f"_{SET_STATES.get(law.set_at, '')}"
        return {
            **{name: self.internal[f"{member}_{name}"] for name in law.states},
            **{name: self.internal[f"{member}_{name}{set_state}"] for name in law.flags},
            "rest_length": self.rest_length[e],
            "spring_constant": self.spring_constant[e],
            "axial_stiffness": self.axial_stiffness[e],
            "damping": self.damping[e],
            **{name: values[e] for name, values in self.law_parameter.items()},
        }

    def add_inputs(self) -> None:
        """Let each actuated input change rest lengths or loads: rho_e + gain u, F_i + u direction.

        If an actuator has a time constant the input is its command, and u its internal state.
        """
        self.lag: dict[str, Scalar] = {}  # command - u, by actuator
        self.motor_rate: dict[str, Scalar] = {}  # u', by internal state
        lagging = self.structure.lagging_actuators
        for index, source in enumerate(self.structure.inputs):
            u = self.symbols["input"][index]
            if motor := lagging.get(source.name):
                self.lag[motor.name] = u - self.internal[motor.state_name]
                u, rate = self.internal[motor.state_name], self.lag[motor.name] / motor.time_constant
                limited = ca.fmin(ca.fmax(rate, -motor.rate), motor.rate) if motor.has_rate else rate
                self.motor_rate[motor.state_name] = limited
                self.rest_rate |= {e: self.rest_rate.get(e, ca.SX(0.0)) + limited for e in source.targets}
            for e, gain in source.rest_length_gain.items():
                self.rest_length[e] = self.rest_length[e] + gain * u
            for node in source.targets if source.kind == "force" else ():
                load = self.node_load[node]
                for column, axis in enumerate(self.structure.axes):
                    load[column] = load[column] + u * source.direction[axis]

    def _add_slips(self) -> None:
        """Let material that slid through rings lengthen the strand behind each and shorten that before."""
        for cable in self.structure.sliding:
            for name, (before, after) in zip(cable.state_names, cable.pairs, strict=True):
                self.rest_length[before] = self.rest_length[before] - self.internal[name]
                self.rest_length[after] = self.rest_length[after] + self.internal[name]

    def _argument(self, name: str) -> ModelArgument:
        nominal = nominal_value(self.structure, self.parameters, name)
        sentence, unit = describe_argument(self.structure, name)
        return ModelArgument(self.symbols[name], *nominal, sentence, unit)

    def _ground(self) -> dict[str, Scalar]:
        """Return the numbers of the ground that stay changeable."""
        chosen = self.parameters.get("ground", ())
        symbol = self._symbol("ground", len(chosen)) if chosen else None
        return {CHANGEABLE[k]: symbol[i] for i, k in enumerate(chosen) if symbol is not None}

    def _velocities(self) -> list[list[Scalar]]:
        column = {axis: position for position, axis in enumerate(self.structure.axes)}
        result = [[ca.SX(0.0) for _ in self.structure.axes] for _ in range(self.structure.n_nodes)]
        for index, (node, axis) in enumerate(self.free):
            result[node][column[axis]] = self.symbols["velocity"][index]
        return result


def check_parameters(parameters: Mapping[str, tuple[int, ...]]) -> None:
    """Raise FormulationError for a run-time parameter that no structure has."""
    for name in parameters:
        if name not in PARAMETERS:
            raise FormulationError(
                "unknown run-time parameter", where="parameters", given=name, hint=suggest(name, PARAMETERS)
            )


def describe_argument(structure: Structure, name: str) -> tuple[str, str]:
    """Return sentence and unit of an argument if they differ from the table of arguments, else ""."""
    if name == "internal" and structure.remembers.any():
        return WITH_MEMBERS, ""
    if name != "input" or all(source.kind != "temperature" for source in structure.inputs):
        return "", ""
    return "Rest-length changes, changes of temperature and forces of the inputs.", "m, K or N"


def nominal_value(
    structure: Structure, parameters: Mapping[str, tuple[int, ...]], name: str
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return an argument's value in the scene, in C order, and the names it runs over."""
    axes, node_axes = list(structure.axes), structure.coordinate_node_axis
    if name == "coordinate":
        return structure.node_position[node_axes[:, 0], node_axes[:, 1]], ()
    if name == "velocity":
        return structure.node_velocity[node_axes[:, 0], node_axes[:, 1]], ()
    if name == "internal":
        return find_start(structure), structure.internal_name
    if name == "input":
        return np.zeros(len(structure.inputs)), tuple(source.name for source in structure.inputs)
    if name == "gravity":
        return structure.gravity[axes], ()
    chosen = list(parameters[name])
    if name == "ground":
        numbers = tuple(CHANGEABLE[k] for k in chosen)
        return np.array([getattr(structure.ground, number) for number in numbers]), numbers
    if name.startswith("body_"):
        bodies = [structure.bodies[k] for k in chosen]
        values = [body.mass if name == "body_mass" else body.principal_inertia for body in bodies]
        return np.array(values), tuple(body.name for body in bodies)
    of_nodes = name in ("node_mass", "node_load", "anchor_position")
    names = structure.node_name if of_nodes else structure.member_name
    values = getattr(structure, "node_position" if name == "anchor_position" else name)[chosen]
    return values[:, axes] if values.ndim == 2 else values, tuple(names[k] for k in chosen)
