"""All members of a structure at one place: lengths, laws, forces on nodes and blocks for matrices.

A formulation says where the members are, by their vectors d_e and rates d_e'; everything here follows from
these, whatever the coordinates are.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import member_length, member_rate
from tensegrity_codegen.symbolic.member_blocks import MemberBlocks, stiffness_blocks
from tensegrity_codegen.symbolic.member_law import MemberLaw

__all__ = ["MemberSet"]

Scalar = Any
Vector = list[Scalar]


class MemberSet:
    """Laws of all members; every intermediate is built once, when first needed.

    structure: the structure; arguments: its values; vectors, vector_rates: n_members vectors d_e [m] and
    d_e' [m/s] over the modelled axes.
    """

    def __init__(
        self,
        structure: Structure,
        arguments: SymbolicArguments,
        vectors: list[Vector],
        vector_rates: list[Vector],
    ) -> None:
        self.structure = structure
        self.arguments = arguments
        self.vectors = vectors
        self.vector_rates = vector_rates
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity]

    @cached_property
    def lengths(self) -> list[Scalar]:
        """Lengths l_e [m]."""
        return [member_length(vector) for vector in self.vectors]

    @cached_property
    def laws(self) -> list[MemberLaw]:
        """Laws of the members at their present lengths, rates and rest lengths."""
        values = self.arguments
        return [
            MemberLaw(
                length=self.lengths[e],
                rate=self._rate(e),
                rest_length=values.rest_length[e],
                spring_constant=values.spring_constant[e],
                axial_stiffness=values.axial_stiffness[e],
                damping=values.damping[e],
                tension_only=bool(self.structure.tension_only[e]),
            )
            for e in range(self.structure.n_members)
        ]

    @cached_property
    def densities(self) -> list[Scalar]:
        """Force densities t_e / l_e with damping [N/m]."""
        return [law.force_density() for law in self.laws]

    @cached_property
    def static_densities(self) -> list[Scalar]:
        """Force densities t_e / l_e without damping [N/m]."""
        return [law.static_force_density() for law in self.laws]

    @property
    def damped(self) -> list[int]:
        """Members that have damping."""
        return [e for e in range(self.structure.n_members) if not self.arguments.damping[e].is_zero()]

    def member_vector(self) -> ca.SX:
        """Return the member vectors, (n_axes, n_members) [m]."""
        return ca.horzcat(*[ca.vertcat(*vector) for vector in self.vectors])

    def member_length(self) -> ca.SX:
        """Return the member lengths, (n_members, 1) [m]."""
        return ca.vertcat(*self.lengths)

    def member_tension(self) -> ca.SX:
        """Return the member tensions, (n_members, 1) [N]."""
        return ca.vertcat(*[law.tension() for law in self.laws])

    def member_extension(self) -> ca.SX:
        """Return the extensions l_e - rho_e, (n_members, 1) [m]."""
        return ca.vertcat(*[law.extension for law in self.laws])

    def force_density(self) -> ca.SX:
        """Return the force densities with damping, (n_members, 1) [N/m]."""
        return ca.vertcat(*self.densities)

    def elastic_energy(self) -> Scalar:
        """Return the strain energy of all members [J]."""
        return sum((law.energy() for law in self.laws), ca.SX(0.0))

    def node_load(self, weight_mass: list[Scalar]) -> list[Vector]:
        """Return weight and load on every node [N]; weight_mass: the mass whose weight each node carries."""
        gravity = self.arguments.gravity
        return [
            [f + m * g for f, g in zip(load, gravity, strict=True)]
            for load, m in zip(self.arguments.node_load, weight_mass, strict=True)
        ]

    def add_to(self, node_load: list[Vector], densities: list[Scalar]) -> list[Vector]:
        """Return `node_load` plus the pull of all members with these force densities, node by node [N]."""
        force = list(node_load)
        for (i, j), vector, density in zip(self.ends, self.vectors, densities, strict=True):
            pull = [density * component for component in vector]
            force[i] = [f - p for f, p in zip(force[i], pull, strict=True)]
            force[j] = [f + p for f, p in zip(force[j], pull, strict=True)]
        return force

    def static_blocks(self, e: int) -> tuple[MemberBlocks, MemberBlocks]:
        """Return material and geometric stiffness of member e without damping, (n_axes, n_axes) [N/m]."""
        law, density = self.laws[e], self.static_densities[e]
        return stiffness_blocks(self.vectors[e], law.length, law.static_tension_by_length(), density)

    def rate_block(self, e: int) -> MemberBlocks:
        """Return c d d^T / l^2 of member e while it pulls, (n_axes, n_axes) [N s/m]."""
        law = self.laws[e]
        return MemberBlocks.outer(
            self.vectors[e], self.vectors[e], law.tension_by_rate() / (law.length * law.length)
        )

    def position_block(self, e: int) -> MemberBlocks:
        """Return -d(force of member e)/d(its vector), damping included, (n_axes, n_axes) [N/m]."""
        law, d = self.laws[e], self.vectors[e]
        material, geometric = stiffness_blocks(d, law.length, law.tension_by_length(), self.densities[e])
        block = material.plus(geometric)
        if self.arguments.damping[e].is_zero():
            return block
        # l' = d . d' / l depends on the member vector: dl'/dd = d'/l - (l'/l^2) d.
        slope = [
            rate / law.length - law.rate / (law.length * law.length) * component
            for rate, component in zip(self.vector_rates[e], d, strict=True)
        ]
        return block.plus(MemberBlocks.outer(d, slope, law.tension_by_rate() / law.length))

    def _rate(self, e: int) -> Scalar:
        if self.arguments.damping[e].is_zero():
            return ca.SX(0.0)
        return member_rate(self.vectors[e], self.vector_rates[e], self.lengths[e])
