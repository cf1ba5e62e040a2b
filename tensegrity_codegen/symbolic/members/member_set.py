"""All members of a structure at one place: lengths, laws, forces on nodes and blocks for matrices.

A formulation says where the members are, by their vectors d_e and rates d_e'; everything here follows from
these, whatever the coordinates are.

Members with memory have internal states of their laws, energies and margins.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from types import MappingProxyType

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.assembly import plan_assembly
from tensegrity_codegen.structure.member_laws import SECTION_VALUES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import Scalar, Vector
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.members.member_law import MemberLaw
from tensegrity_codegen.symbolic.members.rings import RingCable, RingSlip, SlidingStrand
from tensegrity_codegen.symbolic.memory import Memory
from tensegrity_codegen.tables.manifest import VISCOUS_WORK


class MemberSet:
    """Laws of all members; every intermediate is built once, when first needed.

    structure: the structure; arguments: its values; vectors, vector_rates: n_members vectors d_e [m] and
    d_e' [m/s] over the modelled axes; strands: those of the strands of members that pass rings, by member.
    """

    def __init__(
        self,
        structure: Structure,
        arguments: SymbolicArguments,
        vectors: list[Vector],
        vector_rates: list[Vector],
        strands: Mapping[int, tuple[tuple[Vector, Vector], ...]] = MappingProxyType({}),
    ) -> None:
        self.structure = structure
        self.arguments = arguments
        self.vectors = vectors
        self.vector_rates = vector_rates
        self.strands = strands
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity]
        self.plan = plan_assembly(structure, arguments.parameters)

    @cached_property
    def members(self) -> list[Member]:
        """All members, in the order of the structure."""
        members = [self._member(e) for e in range(self.structure.n_members)]
        for slip in self.slips:
            for e, strand in zip(slip.cable.members, slip.slide(), strict=True):
                members[e] = strand
        return members

    @cached_property
    def slips(self) -> list[RingSlip]:
        """The slip of each cable with friction at rings."""
        members = []
        for cable in self.structure.sliding:
            strands = [SlidingStrand(*self._values(e)) for e in cable.members]
            members.append(RingSlip(cable, strands))
        return members

    @cached_property
    def lengths(self) -> list[Scalar]:
        """Lengths l_e [m]."""
        return [member.length for member in self.members]

    @cached_property
    def laws(self) -> list[MemberLaw]:
        """Laws of the members at their present lengths, rates and rest lengths."""
        return [member.law for member in self.members]

    @cached_property
    def strand_ends(self) -> list[list[tuple[int, int]]]:
        """Nodes of the straight parts of each member: of most members its own two."""
        joined: list[list[tuple[int, int]]] = [[] for _ in self.ends]
        strands = self.structure.strands
        for e, (i, j) in zip(strands.member.tolist(), strands.ends.tolist(), strict=True):
            joined[e].append((i, j))
        return joined

    @cached_property
    def densities(self) -> list[Scalar]:
        """Force densities t_e / l_e with damping [N/m]."""
        return [member.density for member in self.members]

    @property
    def damped(self) -> list[int]:
        """Members that have damping."""
        return [e for e, member in enumerate(self.members) if member.is_damped]

    def spring_tension(self) -> ca.SX:
        """Return the member tensions without damping, (n_members, 1) [N]."""
        return ca.vertcat(*[law.static_tension() for law in self.laws])

    def cable_margin(self) -> ca.SX:
        """Return the margins of the members that pull only, (n_tension_only, 1) [m]."""
        return ca.vertcat(ca.SX(0, 1), *[member.margin() for member in self.members if member.tension_only])

    def switch_margin(self) -> ca.SX:
        """Return the margins of the switches of laws that have one, (n_switches, 1) [m]."""
        laws = [self.laws[e] for e in np.flatnonzero(self.structure.has_switch)]
        return ca.vertcat(ca.SX(0, 1), *[law.switch() for law in laws])

    def elastic_energy(self) -> Scalar:
        """Return the strain energy of all members, summed in the order of the plan [J]."""
        return sum((self.laws[e].energy() for e in self.plan.member), ca.SX(0.0))

    def node_load(self, weight_mass: list[Scalar]) -> list[Vector]:
        """Return weight and load on every node [N]; weight_mass: the mass whose weight each node carries."""
        gravity = self.arguments.gravity
        return [
            [f + m * g for f, g in zip(load, gravity, strict=True)]
            for load, m in zip(self.arguments.node_load, weight_mass, strict=True)
        ]

    def add_to(self, node_load: list[Vector], density: Callable[[Member], Scalar]) -> list[Vector]:
        """Return `node_load` plus the pull of all members, in the order of the plan [N].

        density: returns the force density of a member or strand [N/m].
        """
        return self.add_pulls(
            node_load,
            [[strand.pull(density(strand)) for strand in member.strands] for member in self.members],
        )

    def add_pulls(self, node_load: list[Vector], pulls: list[list[Vector]]) -> list[Vector]:
        """Return `node_load` plus given forces on node j, minus those on node i, in the order of the plan.

        pulls: of each strand of each member.
        """
        force = list(node_load)
        for e, end in self.plan.ends:
            for ends, pull in zip(self.strand_ends[e], pulls[e], strict=True):
                node = ends[end]
                if end == 0:
                    force[node] = [f - p for f, p in zip(force[node], pull, strict=True)]
                else:
                    force[node] = [f + p for f, p in zip(force[node], pull, strict=True)]
        return force

    def _member(self, e: int) -> Member:
        values = self._values(e)
        return RingCable(*values, parts=self.strands[e]) if e in self.strands else Member(*values)

    def _values(self, e: int) -> tuple[Vector, Vector, dict[str, Scalar], bool, dict[str, Scalar]]:
        """Return the fields of member e."""
        return (
            self.vectors[e],
            self.vector_rates[e],
            self.arguments.member_values(e),
            bool(self.structure.tension_only[e]),
            {name: ca.SX(float(getattr(self.structure, name)[e])) for name in SECTION_VALUES},
        )


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
        """Return 0: the stored energy of members is their strain energy."""
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
        """Return minus the power of plastic flow, -Fy a' [W]."""
        lost = (self._flow_force(law) * self._rates(name)[1] for name, law in self.laws.items())
        return {"plastic": -sum(lost, ca.SX(0.0))}

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of margins, plastic elongations, power and work of the flow."""
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
        settled = {name: law.settled()[0] for name, law in self.laws.items()}
        return ca.vertcat(*[settled.get(name, ca.SX(0.0)) for name in self.structure.member_name])

    def _work(self) -> Scalar:
        """Return minus the work of the flow, -Fy a, up to the internal states [J]."""
        powers = (self._flow_force(law) * law.law_parameter["accumulated"] for law in self.laws.values())
        return -sum(powers, ca.SX(0.0))

    def _flow_force(self, law: MemberLaw) -> Scalar:
        """Return Fy [N]."""
        return law.mu * law.law_parameter["yield_elongation"]


class ViscousMembers(MemberMemory):
    """The members that relax."""

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the states of all members [m/s], and their powers [W]."""
        return {**super().internal_rates(), VISCOUS_WORK: self.powers()["viscous"]}

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus the power of the dashpots, -c p'^2 with c = T mu / (1 - h) [W]."""
        lost = (self._viscosity(law) * self._rates(name)[0] ** 2 for name, law in self.laws.items())
        return {"viscous": -sum(lost, ca.SX(0.0))}

    def settled(self) -> Mapping[str, Scalar]:
        """Return nothing: events do not change these states."""
        return {}

    def relaxed(self) -> Mapping[str, Scalar]:
        """Return the states of all members after infinite time at their lengths [m]."""
        return super().settled()

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builder of the power of the dashpots."""
        return {"viscous_power": lambda: self.powers()["viscous"]}

    def _viscosity(self, law: MemberLaw) -> Scalar:
        """Return c [N s/m]."""
        parameter = law.law_parameter
        return parameter["relaxation_time"] * law.mu / (1.0 - parameter["relaxed_fraction"])


MEMORIES = {"plastic": PlasticMembers, "viscous": ViscousMembers}  # by the name of the law


def build_member_memories(structure: Structure, members: MemberSet) -> list[Memory]:
    """Return the memory of the members of each law that has internal states."""
    return [
        MEMORIES[law.name](structure, members, np.flatnonzero(mask).tolist())
        for law, mask in structure.members_of_law
        if law.states
    ]
