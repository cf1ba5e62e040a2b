"""Run-time arguments of a body system as symbols, everything else as numbers that fold away."""

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.symbolic.model import ModelArgument
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.laws import LAW_PARAMETERS
from tensegrity_codegen.tables.quantities import ARGUMENTS, PARAMETERS

Scalar = Any

_OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping")

_OF_COORDINATES = {
    "coordinate": ("m, rad", "Positions and angles of the bodies, body by body."),
    "velocity": ("m/s, rad/s", "Rates of the positions and angles of the bodies."),
}

# What a body system can keep changeable at run time.
BODY_PARAMETERS = (*_OF_MEMBERS, "node_load", "gravity")


class BodyArguments:
    """Values of a body system, element by element: a symbol where it may change at run time, else a number.

    parameters: argument name -> indices of members or nodes that stay changeable. Raises FormulationError
    for an argument that no body system has.
    """

    def __init__(self, system: BodySystem, parameters: Mapping[str, tuple[int, ...]]) -> None:
        for name in parameters:
            if name not in BODY_PARAMETERS:
                raise FormulationError(
                    "formulation 'bodies' has no such run-time parameter",
                    where=f"{system.name}: parameters",
                    given=name,
                    allowed=", ".join(BODY_PARAMETERS),
                    hint=suggest(name, BODY_PARAMETERS),
                )
        self.system, self.parameters = system, parameters
        self.symbols: dict[str, ca.SX] = {}
        self.coordinate = self._symbol("coordinate", system.n_coordinates)
        self.velocity = self._symbol("velocity", system.n_coordinates)
        self.input = self._symbol("input", len(system.inputs))
        self.rest_length = self._scalars("rest_length")
        self.spring_constant = self._scalars("spring_constant")
        self.axial_stiffness = self._scalars("axial_stiffness")
        self.damping = self._scalars("damping")
        self.law_parameter = {name: self._scalars(name) for name in LAW_PARAMETERS}
        self.node_load = self._loads()
        self.gravity = self._gravity()
        self._add_inputs()

    def member_values(self, e: int) -> dict[str, Scalar]:
        """Return what the law of tendon e takes, by the names of MEMBER_VALUES."""
        own = {name: getattr(self, name)[e] for name in _OF_MEMBERS}
        return own | {name: values[e] for name, values in self.law_parameter.items()}

    def ordered(self) -> dict[str, ModelArgument]:
        """Return the arguments in the fixed order, with the scene's values."""
        return {name: self._argument(name) for name in ARGUMENTS if name in self.symbols}

    def parameter_symbols(self) -> ca.SX:
        """Return all run-time parameters stacked in argument order, (n_parameters, 1)."""
        chosen = [self.symbols[name] for name in PARAMETERS if name in self.parameters]
        return ca.vertcat(*[ca.vec(symbol) for symbol in chosen]) if chosen else ca.SX(0, 1)

    def _symbol(self, name: str, rows: int, columns: int = 1) -> ca.SX:
        self.symbols[name] = ca.SX.sym(name, rows, columns)
        return self.symbols[name]

    def _scalars(self, name: str) -> list[Scalar]:
        result = [ca.SX(float(value)) for value in self.system.member_value(name)]
        if name in self.parameters:
            symbol = self._symbol(name, len(self.parameters[name]))
            for position, index in enumerate(self.parameters[name]):
                result[index] = symbol[position]
        return result

    def _loads(self) -> list[list[Scalar]]:
        result = [[ca.SX(float(value)) for value in row] for row in self.system.node_load]
        if "node_load" in self.parameters:
            # Columns are nodes, so that the bytes are those of a C-ordered (k, 3) array.
            symbol = self._symbol("node_load", 3, len(self.parameters["node_load"]))
            for position, index in enumerate(self.parameters["node_load"]):
                result[index] = [symbol[row, position] for row in range(3)]
        return result

    def _gravity(self) -> list[Scalar]:
        if "gravity" in self.parameters:
            symbol = self._symbol("gravity", 3)
            return [symbol[row] for row in range(3)]
        return [ca.SX(float(value)) for value in self.system.gravity]

    def _add_inputs(self) -> None:
        """Let inputs change rest lengths, and the forces on nodes that keep their direction."""
        for index, item in enumerate(self.system.inputs):
            for e, gain in item.rest_length_gain.items():
                self.rest_length[e] = self.rest_length[e] + gain * self.input[index]
            for node in item.targets if item.kind == "force" and item.frame == "inertial" else ():
                load = self.node_load[node]
                for axis, part in enumerate(item.direction):
                    load[axis] = load[axis] + self.input[index] * part

    def _argument(self, name: str) -> ModelArgument:
        system, symbol = self.system, self.symbols[name]
        if name == "gravity":
            return ModelArgument(symbol, np.array(system.gravity))
        if name in ("coordinate", "velocity"):
            unit, sentence = _OF_COORDINATES[name]
            return ModelArgument(symbol, np.array(getattr(system, name)), (), sentence, unit)
        if name == "input":
            names = tuple(item.name for item in system.inputs)
            sentence = "Rest-length changes, forces and torques of the actuated inputs."
            unit = "m, K, N or N m" if any(i.kind == "temperature" for i in system.inputs) else "m, N or N m"
            return ModelArgument(symbol, np.zeros(len(names)), names, sentence, unit)
        chosen = list(self.parameters[name])
        names = system.node_name if name == "node_load" else system.member_name
        return ModelArgument(symbol, getattr(system, name)[chosen], tuple(names[k] for k in chosen))
