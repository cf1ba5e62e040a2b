"""The quadratic program of a distribution of tensions about one command."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.loop.cable_tensions import CableTensions
from tensegrity_codegen.control.planning.quadratic_program import find_nearest
from tensegrity_codegen.system.arrays import FloatArray

LONGEST = 100.0  # rest length over length, up to which tensions are counted with
SMALLEST = 1e-9  # part of the weight, for inputs that change no tension
TOLERANCE = 1e-12  # of bounds, over the largest tension (1 N at least)


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
        rest = np.where(high, LONGEST * self.length, np.minimum(rest, LONGEST * self.length))
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
        least = share * np.sqrt(SMALLEST) * np.eye(len(size))
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
