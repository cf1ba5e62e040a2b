"""Tensions of members as functions of the actuators' inputs, and the program that distributes them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.planning.quadratic_program import find_nearest
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.bodies import BodyInput
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.laws import LINEAR

LONGEST_REST = 100.0  # rest length over length, up to which tensions are counted with
IDLE_WEIGHT = 1e-9  # part of the weight, for inputs that change no tension
TOLERANCE = 1e-12  # of bounds, over the largest tension (1 N at least)


@dataclass(frozen=True)
class CableTensions:
    """Linear springs t = (k + EA / rho) (l - rho), taut or not, with rest lengths moved by actuators.

    spring_constant, axial_stiffness (n_members,) [N/m, N]: k and EA.
    base (n_members,) [m]: rest lengths without inputs.
    incidence (n_members, n_actuators): which actuators change which rest lengths.
    other_incidence (n_members, n_inputs): gains of the inputs that are not these actuators.
    limited (n_limited,): members that actuators pull and that have a least tension.
    """

    spring_constant: FloatArray
    axial_stiffness: FloatArray
    base: FloatArray
    incidence: FloatArray
    other_incidence: FloatArray
    limited: NDArray[np.int64]

    @property
    def driven(self) -> NDArray[np.int64]:
        """Members that actuators pull, (n_driven,)."""
        return np.flatnonzero(self.incidence.any(axis=1)).astype(np.int64)

    @property
    def shared(self) -> NDArray[np.int64]:
        """Limited members that several actuators pull, (n_shared,)."""
        several: NDArray[np.bool_] = self.incidence[self.limited].sum(axis=1) > 1.0
        return self.limited[several]

    @property
    def is_one_to_one(self) -> bool:
        """Whether each actuator pulls one member, and no member has several actuators."""
        counts = self.incidence.sum(axis=0), self.incidence.sum(axis=1)
        return bool((counts[0] == 1.0).all() and (counts[1] <= 1.0).all())

    def rest_length(self, inputs: FloatArray, change: FloatArray) -> FloatArray:
        """Return rest lengths (n_members,) [m] for inputs (n_inputs,) and those of the actuators."""
        found: FloatArray = self.base + self.other_incidence @ inputs + self.incidence @ change
        return found

    def tension(self, length: FloatArray, rest: FloatArray) -> FloatArray:
        """Return tensions (n_members,) [N]; negative where a cable is slack."""
        return (self.spring_constant + self.axial_stiffness / rest) * (length - rest)

    def slope(self, length: FloatArray, rest: FloatArray) -> FloatArray:
        """Return the derivatives of tensions by rest lengths, (n_members,) [N/m]."""
        return -(self.spring_constant + self.axial_stiffness * length / rest**2)

    def find_rest_length(self, length: FloatArray, tension: FloatArray) -> FloatArray:
        """Return the rest lengths [m] at which tensions are reached; infinite where any one does."""
        given = {"spring_constant": self.spring_constant, "axial_stiffness": self.axial_stiffness}
        found = np.full(len(length), np.inf)
        finite = np.isfinite(tension) & (self.spring_constant + self.axial_stiffness > 0.0)
        found[finite] = LINEAR.find_rest_length(length, np.where(finite, tension, 0.0), given)[finite]
        return found


def find_cables(
    model: CompiledModel, bounds: ActuatorBounds, least: FloatArray, arguments: Mapping[str, Any]
) -> CableTensions:
    """Return the members of a model as functions of its actuators.

    model: with its structure.
    least (n_members,) [N]: least tensions.
    arguments: run-time rest lengths and stiffnesses where they differ from the scene.
    Raises FormulationError: an actuator pulls a member whose law is not a linear spring.
    """
    structure = model.structure
    assert structure is not None
    count = structure.n_members
    # Which actuators pull which members, all of them linear springs.
    incidence = np.zeros((count, len(bounds.names)))
    for column, members in enumerate(bounds.members):
        incidence[list(members), column] = 1.0
    bent = np.flatnonzero(incidence.any(axis=1) & ~structure.is_linear)
    if bent.size:
        raise FormulationError(
            "tensions are distributed over linear springs only",
            where=f"{structure.name}: {structure.member_name[int(bent[0])]}",
            given=structure.law_of(int(bent[0])).name,
            allowed="members with spring_constant or axial_stiffness alone",
        )
    # Inputs that are not these actuators.
    others = np.zeros((count, len(structure.inputs)))
    inputs: Sequence[ActuatedInput | BodyInput] = structure.inputs
    for column, item in enumerate(inputs):
        for e, gain in item.rest_length_gain.items() if column not in bounds.place.tolist() else ():
            others[e, column] = gain
    # Stiffnesses and rest lengths: of the scene, or as given.
    values = {
        name: np.array(getattr(structure, name), dtype=float)
        for name in ("spring_constant", "axial_stiffness", "rest_length")
    }
    for name, value in values.items():
        spec = next((item for item in model.manifest.arguments if item.name == name), None)
        if spec is not None and name in arguments:
            rows = [structure.member_name.index(member) for member in spec.over]
            value[rows] = np.asarray(arguments[name], dtype=float).ravel()
    limited = np.flatnonzero(incidence.any(axis=1) & np.isfinite(least))
    return CableTensions(
        values["spring_constant"],
        values["axial_stiffness"],
        values["rest_length"],
        incidence,
        others,
        limited.astype(np.int64),
    )


# The quadratic program of a distribution of tensions about one command.


@dataclass(frozen=True, eq=False)
class TensionLine:
    """Tensions as straight lines of changes of a command.

    Where each actuator pulls one member, changes stand for tensions, so that lines and bounds are exact.
    """

    cables: CableTensions
    length: FloatArray
    others: FloatArray
    command: FloatArray

    def to_change(self, inputs: FloatArray) -> FloatArray:
        """Return the changes (n_actuators,) [m] at which the lines have the tensions of inputs."""
        plain = inputs - self.command
        if not self.cables.is_one_to_one:
            return plain
        rest = self.cables.rest_length(self.others, np.where(np.isfinite(inputs), inputs, 0.0))
        high = self.cables.incidence @ np.where(inputs == np.inf, 1.0, 0.0) > 0.0
        rest = np.where(high, LONGEST_REST * self.length, np.minimum(rest, LONGEST_REST * self.length))
        slope, tension = self._at_command()
        with np.errstate(all="ignore"):
            found = (self.cables.tension(self.length, rest) - tension) / slope
        found = np.where(rest > 0.0, found, -np.inf)[self._member()]
        return np.where(slope[self._member()] < 0.0, found, plain)

    def to_input(self, change: FloatArray) -> FloatArray:
        """Return the inputs (n_actuators,) [m] that have the tensions of changes on the lines."""
        plain = self.command + change
        if not self.cables.is_one_to_one:
            return plain
        slope, tension = self._at_command()
        reached = tension + slope * (self.cables.incidence @ change)
        rest = self.cables.find_rest_length(self.length, reached)
        base = self.cables.rest_length(self.others, np.zeros(len(change)))
        return np.where(slope[self._member()] < 0.0, (rest - base)[self._member()], plain)

    def _member(self) -> NDArray[np.int64]:
        found: NDArray[np.int64] = np.argmax(self.cables.incidence, axis=0).astype(np.int64)
        return found

    def _at_command(self) -> tuple[FloatArray, FloatArray]:
        rest = self.cables.rest_length(self.others, self.command)
        return self.cables.slope(self.length, rest), self.cables.tension(self.length, rest)


@dataclass(frozen=True, eq=False)
class TensionProgram:
    """The quadratic program about one command.

    a: equilibrium matrix of the members that actuators pull, over the root of the mean square of all entries;
    tension (n_driven,) [N]; moved (n_driven, n_actuators): derivatives of tensions by the inputs [N/m].
    """

    a: FloatArray
    tension: FloatArray
    moved: FloatArray

    def solve(
        self,
        asked: FloatArray,
        preferred: FloatArray,
        weight: float,
        command: FloatArray,
        limits: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ) -> FloatArray | None:
        """Return the change of the command (n_actuators,) [m]; None where the solver fails."""
        low, high, rows, top = limits
        size = np.linalg.norm(self.moved, axis=0)
        size = np.where(size > 0.0, size, max(float(size.max(initial=0.0)), 1.0))
        change, share = self.moved / size, np.sqrt(weight)
        least = share * np.sqrt(IDLE_WEIGHT) * np.eye(len(size))
        found = find_nearest(
            np.vstack([self.a @ change, share * change, least]),
            np.concatenate(
                [self.a @ (asked - self.tension), share * (preferred - self.tension), np.zeros(len(size))]
            ),
            np.vstack([np.eye(len(size)), rows]) / size,
            np.concatenate([low, np.full(len(top), -np.inf)]),
            np.concatenate([high, top - rows @ command]),
            tolerance=TOLERANCE * max(1.0, float(np.abs(asked).max(initial=0.0))),
        )
        return None if found is None else found.x / size
