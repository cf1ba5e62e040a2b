"""The face of what remembers: rates of internal states, energies, powers and margins, as expressions.

Names and order of internal states stand in structure/memory.py. To add a kind: a `MemoryKind` there, a
subclass of `Memory` here, and a line in `NodeCoordinates.memories`; for events that set states also their bit
in EVENT_KINDS, their word in SET_STATES, and their margins in EVENT_QUANTITIES. Laws of members with memory
need a file in tables/laws, see `Law.states`, a line in MEMORIES of symbolic/members/member_memory.py and
their keys in the schema; `settled` is what integrators put into the state at events.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

Scalar = Any

POWERS = ("friction", "impact", "belt", "plastic", "viscous")  # what changes the total energy


class Memory(ABC):
    """What remembers, as expressions of the state (q, q', z) and of the arguments."""

    @abstractmethod
    def stored_energy(self) -> Scalar:
        """Return the energy that it can give back, besides that of members [J]."""

    @abstractmethod
    def powers(self) -> Mapping[str, Scalar]:
        """Return what it adds to the total energy, by the words of POWERS [W]."""

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates z' of its internal states by their names; those that events set have none."""
        return {}

    def settled(self) -> Mapping[str, Scalar]:
        """Return what internal states become at events, by their names: states that keep up with others."""
        return {}

    def relaxed(self) -> Mapping[str, Scalar]:
        """Return what internal states come to at rest after infinite time, by their names."""
        return {}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return quantity name -> builder of what it offers, margins among them."""
        return {}
