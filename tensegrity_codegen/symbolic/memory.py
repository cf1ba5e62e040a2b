"""The interface of internal states: rates of internal states, energies, powers and margins, as expressions.

Names and order of internal states stand in structure/memory.py. To add a kind: a `MemoryKind` there, a
subclass of `Memory` here, and a line in `NodeCoordinates.memories`; for events that set states also their bit
in EVENT_KINDS, their word in SET_STATES, and their margins in EVENT_QUANTITIES. Laws of members with memory
need a file in tables/laws, see `Law.states`, a line in MEMORIES of symbolic/members/member_set.py and
their keys in the schema; integrators put `settled` into the state at events.

Motors with a time constant: u' = clip((command - u) / tau, -rate, rate), with u an internal state; the
margin rate tau - |command - u| is positive where the rate is not limited. The field is continuous: an event
there is a kink.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import casadi as ca

from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import Scalar

POWERS = ("friction", "impact", "belt", "plastic", "viscous")  # that change the total energy


class Memory(ABC):
    """A part with internal states, as expressions of the state (q, q', z) and of the arguments."""

    @abstractmethod
    def stored_energy(self) -> Scalar:
        """Return the energy that it can give back, besides that of members [J]."""

    @abstractmethod
    def powers(self) -> Mapping[str, Scalar]:
        """Return its powers, by the words of POWERS [W]."""

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates z' of its internal states by their names; those that events set have none."""
        return {}

    def settled(self) -> Mapping[str, Scalar]:
        """Return the internal states after events, by their names: states that keep up with others."""
        return {}

    def relaxed(self) -> Mapping[str, Scalar]:
        """Return the internal states at rest after infinite time, by their names."""
        return {}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return name -> builder of its quantities, margins among them."""
        return {}


class Motors(Memory):
    """All motors of a structure that have a time constant."""

    def __init__(self, arguments: SymbolicArguments) -> None:
        self.arguments = arguments
        self.lagging = arguments.structure.lagging_actuators

    def stored_energy(self) -> Scalar:
        """Return 0."""
        return ca.SX(0.0)

    def powers(self) -> Mapping[str, Scalar]:
        """Return none: the power of motors is not counted."""
        return {}

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the motors [m/s]."""
        return self.arguments.motor_rate

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builder of the margins of all motors."""
        return {"motor_margin": lambda: ca.vertcat(*map(self._margin, self.lagging.values()))}

    def _margin(self, actuator: Actuator) -> Scalar:
        """Return how far a motor is below its largest rate, times its time constant [m]; 1 without one."""
        if not actuator.has_rate:
            return ca.SX(1.0)
        return actuator.rate * actuator.time_constant - ca.fabs(self.arguments.lag[actuator.name])
