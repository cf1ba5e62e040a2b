"""Formulation `node_position`: free node coordinates, members as springs (S&K 2, 5).

H q'' = f,  f = sum over members of -t_e d_e / l_e on node i and + on node j, weight and loads
K = sum of (dt/dl) d d^T / l^2 + (t/l) (I - d d^T / l^2), material + geometric
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import dot, member_length, member_rate, member_vector
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.member_blocks import MemberBlocks, stiffness_blocks
from tensegrity_codegen.symbolic.member_law import MemberLaw
from tensegrity_codegen.symbolic.model import SymbolicModel, frame_structure
from tensegrity_codegen.symbolic.scatter import CoordinateMap

__all__ = ["build_node_position"]

Scalar = Any
Vector = list[Scalar]


def build_node_position(structure: Structure, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of `structure` in node positions.

    Raises FormulationError for rigid bars, which this formulation does not have.
    """
    check_no_rigid_bar(structure)
    parts = _NodePosition(structure, SymbolicArguments(structure, request.parameters))
    arguments = parts.arguments.ordered()
    return SymbolicModel("node_position", structure, frame_structure(structure), arguments, parts.builders())


def check_no_rigid_bar(structure: Structure) -> None:
    """Raise FormulationError if a member has neither spring constant nor axial stiffness."""
    rigid = np.flatnonzero(structure.is_rigid)
    if rigid.size:
        name = structure.member_name[rigid[0]]
        others = f" and {rigid.size - 1} more" if rigid.size > 1 else ""
        raise FormulationError(
            "formulation 'node_position' has no rigid bars; rigid bars will be served by the formulation "
            "'rigid_bar', which this version does not have yet",
            where=f"{structure.name}: members.{name}",
            given=f"bar {name}{others} without axial_stiffness and spring_constant",
            allowed="axial_stiffness > 0 [N] or spring_constant > 0 [N/m] on every bar",
            hint="give the bar a finite stiffness, 1,000 times that of the cables is nearly rigid",
        )


class _NodePosition:
    """All expressions of one structure; every intermediate is built once, when first needed."""

    def __init__(self, structure: Structure, arguments: SymbolicArguments) -> None:
        self.structure = structure
        self.arguments = arguments
        self.map = CoordinateMap(structure)
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity]

    def builders(self) -> dict[str, Any]:
        """Return quantity name -> builder."""
        names = (
            "member_vector",
            "member_length",
            "member_tension",
            "force_density",
            "node_force",
            "node_residual",
            "support_reaction",
            "elastic_energy",
            "potential_energy",
            "kinetic_energy",
            "total_energy",
            "acceleration",
            "state_derivative",
            "mass_matrix",
            "material_stiffness",
            "geometric_stiffness",
            "tangent_stiffness",
            "damping_matrix",
            "equilibrium_matrix",
            "state_jacobian",
            "input_jacobian",
            "rest_length_jacobian",
            "parameter_jacobian",
        )
        return {name: getattr(self, name) for name in names}

    # Geometry of every member

    @cached_property
    def vectors(self) -> list[Vector]:
        position = self.arguments.position
        return [member_vector(position[i], position[j]) for i, j in self.ends]

    @cached_property
    def lengths(self) -> list[Scalar]:
        return [member_length(vector) for vector in self.vectors]

    @cached_property
    def vector_rates(self) -> list[Vector]:
        velocity = self.arguments.velocity
        return [member_vector(velocity[i], velocity[j]) for i, j in self.ends]

    @cached_property
    def laws(self) -> list[MemberLaw]:
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

    def _rate(self, e: int) -> Scalar:
        if self.arguments.damping[e].is_zero():
            return ca.SX(0.0)
        return member_rate(self.vectors[e], self.vector_rates[e], self.lengths[e])

    # Members

    def member_vector(self) -> ca.SX:
        return ca.horzcat(*[ca.vertcat(*vector) for vector in self.vectors])

    def member_length(self) -> ca.SX:
        return ca.vertcat(*self.lengths)

    def member_tension(self) -> ca.SX:
        return ca.vertcat(*[law.tension() for law in self.laws])

    def force_density(self) -> ca.SX:
        return ca.vertcat(*self.densities)

    @cached_property
    def densities(self) -> list[Scalar]:
        return [law.force_density() for law in self.laws]

    @cached_property
    def static_densities(self) -> list[Scalar]:
        return [law.static_force_density() for law in self.laws]

    # Nodes

    @cached_property
    def inertia(self) -> Inertia:
        return Inertia(self.structure, self.arguments.node_mass)

    def external_force(self) -> list[Vector]:
        """Return weight and load on every node [N]."""
        mass, gravity = self.inertia.weight_mass(), self.arguments.gravity
        return [
            [f + m * g for f, g in zip(load, gravity, strict=True)]
            for load, m in zip(self.arguments.node_load, mass, strict=True)
        ]

    def _net_force(self, densities: list[Scalar]) -> list[Vector]:
        force = self.external_force()
        for (i, j), vector, density in zip(self.ends, self.vectors, densities, strict=True):
            pull = [density * component for component in vector]
            force[i] = [f - p for f, p in zip(force[i], pull, strict=True)]
            force[j] = [f + p for f, p in zip(force[j], pull, strict=True)]
        return force

    @cached_property
    def net_force(self) -> list[Vector]:
        return self._net_force(self.densities)

    @cached_property
    def net_static_force(self) -> list[Vector]:
        return self._net_force(self.static_densities)

    def node_force(self) -> ca.SX:
        return ca.horzcat(*[ca.vertcat(*force) for force in self.net_force])

    def node_residual(self) -> ca.SX:
        return self.map.free(self.net_static_force)

    def support_reaction(self) -> ca.SX:
        return -self.map.anchored(self.net_static_force)

    # Energies

    def elastic_energy(self) -> Scalar:
        return sum((law.energy() for law in self.laws), ca.SX(0.0))

    def potential_energy(self) -> Scalar:
        work = ca.SX(0.0)
        for force, position in zip(self.external_force(), self.arguments.position, strict=True):
            work = work + dot(force, position)
        return self.elastic_energy() - work

    def kinetic_energy(self) -> Scalar:
        return self.inertia.kinetic_energy(self.arguments.velocity)

    def total_energy(self) -> Scalar:
        return self.kinetic_energy() + self.potential_energy()

    # Dynamics

    def mass_matrix(self) -> ca.SX:
        self.inertia.check()
        return self.map.assemble(
            (self.inertia.matrix(nodes), self.map.indices(nodes, axis))
            for axis in self.structure.axes
            for nodes in self.inertia.groups(axis)
        )

    @cached_property
    def inverse_mass(self) -> ca.SX:
        self.inertia.check()
        return self.map.assemble(
            (self.inertia.inverse(nodes), self.map.indices(nodes, axis))
            for axis in self.structure.axes
            for nodes in self.inertia.groups(axis)
        )

    def acceleration(self) -> ca.SX:
        self.inertia.check()
        result: list[Scalar] = [None] * self.map.n_coordinates
        for column, axis in enumerate(self.structure.axes):
            for nodes in self.inertia.groups(axis):
                force = [self.net_force[node][column] for node in nodes]
                solution = self.inertia.solve(nodes, force)
                for index, value in zip(self.map.indices(nodes, axis), solution, strict=True):
                    result[index] = value
        return ca.vertcat(*result)

    def state_derivative(self) -> ca.SX:
        return ca.vertcat(self.arguments.symbols["velocity"], self.acceleration())

    # Stiffness and Jacobians, member block by member block

    def _static_blocks(self, e: int) -> tuple[MemberBlocks, MemberBlocks]:
        law, density = self.laws[e], self.static_densities[e]
        return stiffness_blocks(self.vectors[e], law.length, law.static_tension_by_length(), density)

    def material_stiffness(self) -> ca.SX:
        return self.map.member_matrix((self._static_blocks(e)[0], self.ends[e]) for e in self._all())

    def geometric_stiffness(self) -> ca.SX:
        return self.map.member_matrix((self._static_blocks(e)[1], self.ends[e]) for e in self._all())

    def tangent_stiffness(self) -> ca.SX:
        blocks = [self._static_blocks(e) for e in self._all()]
        return self.map.member_matrix(
            (m.plus(g), ends) for (m, g), ends in zip(blocks, self.ends, strict=True)
        )

    def _rate_block(self, e: int) -> MemberBlocks:
        law = self.laws[e]
        return MemberBlocks.outer(
            self.vectors[e], self.vectors[e], law.tension_by_rate() / (law.length * law.length)
        )

    def damping_matrix(self) -> ca.SX:
        return self.map.member_matrix((self._rate_block(e), self.ends[e]) for e in self._damped())

    def _position_block(self, e: int) -> MemberBlocks:
        """Return -d(member force)/d(member vector), damping included, (n_axes, n_axes)."""
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

    def state_jacobian(self) -> ca.SX:
        n = self.map.n_coordinates
        stiffness = self.map.member_matrix((self._position_block(e), self.ends[e]) for e in self._all())
        lower = [
            -ca.mtimes(self.inverse_mass, stiffness),
            -ca.mtimes(self.inverse_mass, self.damping_matrix()),
        ]
        return ca.vertcat(ca.horzcat(ca.SX(n, n), ca.SX.eye(n)), ca.horzcat(*lower))

    def _tension_to_force(self) -> ca.SX:
        """Return d(node force)/d(member tension) = -A, sparse (n_coordinates, n_members)."""
        return -self.equilibrium_matrix()

    def equilibrium_matrix(self) -> ca.SX:
        directions = [
            [c / length for c in vector] for vector, length in zip(self.vectors, self.lengths, strict=True)
        ]
        return self.map.member_columns(directions, self.ends)

    def rest_length_jacobian(self) -> ca.SX:
        slope = ca.diag(ca.vertcat(*[law.tension_by_rest_length() for law in self.laws]))
        return self._below_zeros(ca.mtimes(self.inverse_mass, ca.mtimes(self._tension_to_force(), slope)))

    def input_jacobian(self) -> ca.SX:
        return self._below_zeros(ca.jacobian(self.acceleration(), self.arguments.symbols["input"]))

    def parameter_jacobian(self) -> ca.SX:
        stacked = self.arguments.parameter_symbols()
        if stacked.numel() == 0:
            raise FormulationError(
                "parameter_jacobian needs run-time parameters, and the scene keeps none",
                where=f"{self.structure.name}: model.quantities",
                hint='name some under [parameters], for example rest_length = "all"',
            )
        return self._below_zeros(ca.jacobian(self.acceleration(), stacked))

    def _below_zeros(self, matrix: ca.SX) -> ca.SX:
        return ca.vertcat(ca.SX(self.map.n_coordinates, matrix.shape[1]), matrix)

    def _all(self) -> range:
        return range(self.structure.n_members)

    def _damped(self) -> list[int]:
        return [e for e in self._all() if not self.arguments.damping[e].is_zero()]
