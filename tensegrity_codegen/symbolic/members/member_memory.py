"""Members with memory: internal states of their laws, energies and margins, as expressions."""

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.members.member_law import MemberLaw
from tensegrity_codegen.symbolic.members.member_set import MemberSet
from tensegrity_codegen.symbolic.memory import Memory
from tensegrity_codegen.tables.manifest import VISCOUS_WORK

Scalar = Any


class MemberMemory(Memory):
    """All members of a structure that follow one law with internal states."""

    def __init__(self, structure: Structure, members: MemberSet, rows: list[int]) -> None:
        self.structure = structure
        # Rates of elongation, with those of rest lengths that motors change
        self.rate = {
            structure.member_name[e]: members.laws[e].rate - members.arguments.rest_rate.get(e, ca.SX(0.0))
            for e in rows
        }
        self.laws: dict[str, MemberLaw] = {structure.member_name[e]: members.laws[e] for e in rows}

    def stored_energy(self) -> Scalar:
        """Return 0: what members store is their strain energy."""
        return ca.SX(0.0)

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the states of all members [m/s]."""
        return {
            f"{name}_{state}": rate
            for name, law in self.laws.items()
            for state, rate in zip(law.law.states, self._rates(name), strict=True)
        }

    def settled(self) -> Mapping[str, Scalar]:
        """Return the states of all members behind what they have done [m]."""
        return {
            f"{name}_{state}": value
            for name, law in self.laws.items()
            for state, value in zip(law.law.states, law.settled(), strict=True)
        }

    def _rates(self, name: str) -> tuple[Scalar, ...]:
        law = self.laws[name]
        motion = (law.extension, self.rate[name])
        return law.law.rates(motion, law.law_parameter, ca.if_else, law.tension_only)


class PlasticMembers(MemberMemory):
    """The members that yield."""

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus what plastic flow takes, -Fy a' [W]."""
        lost = (self._flow_force(law) * self._rates(name)[1] for name, law in self.laws.items())
        return {"plastic": -sum(lost, ca.SX(0.0))}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of margins, plastic elongations, and what flow takes and has taken."""
        return {
            "plastic_power": lambda: self.powers()["plastic"],
            "yield_margin": self._margins,
            "plastic_elongation": self._elongations,
            "plastic_work": self._work,
        }

    def _margins(self) -> ca.SX:
        found = [law.memory_margins(self.rate[name]) for name, law in self.laws.items()]
        return ca.vertcat(*[margin for margins in found for margin in margins])

    def _elongations(self) -> ca.SX:
        """Return q of all members, 0 of those that are elastic, (n_members, 1) [m]."""
        found = {name: law.settled()[0] for name, law in self.laws.items()}
        return ca.vertcat(*[found.get(name, ca.SX(0.0)) for name in self.structure.member_name])

    def _work(self) -> Scalar:
        """Return minus what flow has taken, -Fy a, up to the internal states [J]."""
        taken = (self._flow_force(law) * law.law_parameter["accumulated"] for law in self.laws.values())
        return -sum(taken, ca.SX(0.0))

    def _flow_force(self, law: MemberLaw) -> Scalar:
        """Return Fy [N]."""
        return law.mu * law.law_parameter["yield_elongation"]


class ViscousMembers(MemberMemory):
    """The members that relax."""

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the states of all members [m/s], and of what they have taken [W]."""
        return {**super().internal_rates(), VISCOUS_WORK: self.powers()["viscous"]}

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus what the dashpots take, -c p'^2 with c = T mu / (1 - h) [W]."""
        lost = (self._viscosity(law) * self._rates(name)[0] ** 2 for name, law in self.laws.items())
        return {"viscous": -sum(lost, ca.SX(0.0))}

    def settled(self) -> Mapping[str, Scalar]:
        """Return nothing: events do not change what changes with time."""
        return {}

    def relaxed(self) -> Mapping[str, Scalar]:
        """Return the states of all members after infinite time at their lengths [m]."""
        return super().settled()

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builder of what the dashpots take."""
        return {"viscous_power": lambda: self.powers()["viscous"]}

    def _viscosity(self, law: MemberLaw) -> Scalar:
        """Return c [N s/m]."""
        given = law.law_parameter
        return given["relaxation_time"] * law.mu / (1.0 - given["relaxed_fraction"])


MEMORIES = {"plastic": PlasticMembers, "viscous": ViscousMembers}  # by the name of the law


def build_member_memories(structure: Structure, members: MemberSet) -> list[Memory]:
    """Return the memory of the members of each law that has internal states."""
    return [
        MEMORIES[law.name](structure, members, np.flatnonzero(mask).tolist())
        for law, mask in structure.members_of_law
        if law.states
    ]
