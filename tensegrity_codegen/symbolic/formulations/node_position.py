"""Formulation `node_position`: free node coordinates, members as springs (S&K 2, 5).

H q'' = f,  f = sum over members of -t_e d_e / l_e on node i and + on node j, weight and loads
K = sum of (dt/dl) d d^T / l^2 + (t/l) (I - d d^T / l^2), material + geometric
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import casadi as ca

from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import dot, member_vector
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.interference import BarPairs, build_bar_quantities, pair_members
from tensegrity_codegen.symbolic.jacobians import below_zeros, by_inputs, by_parameters
from tensegrity_codegen.symbolic.member_blocks import MemberBlocks
from tensegrity_codegen.symbolic.member_set import MemberSet
from tensegrity_codegen.symbolic.model import SymbolicModel, frame_structure
from tensegrity_codegen.symbolic.rigid_bar_check import check_no_rigid_bar
from tensegrity_codegen.symbolic.scatter import CoordinateMap

__all__ = ["build_node_position"]

Scalar = Any
Vector = list[Scalar]


def build_node_position(structure: Structure, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of `structure` in node positions.

    Raises FormulationError for rigid bars, which this formulation does not have.
    """
    check_no_rigid_bar(structure, "node_position")
    parts = _NodePosition(structure, SymbolicArguments(structure, request.parameters))
    arguments = parts.arguments.ordered()
    return SymbolicModel("node_position", structure, frame_structure(structure), arguments, parts.builders())


class _NodePosition:
    """All expressions of one structure; every intermediate is built once, when first needed."""

    def __init__(self, structure: Structure, arguments: SymbolicArguments) -> None:
        self.structure = structure
        self.arguments = arguments
        self.map = CoordinateMap(structure)
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity]
        self.members = MemberSet(
            structure, arguments, self._differences(arguments.position), self._differences(arguments.velocity)
        )

    def builders(self) -> dict[str, Any]:
        """Return quantity name -> builder."""
        members = self.members
        return {
            "member_vector": members.member_vector,
            "member_length": members.member_length,
            "member_tension": members.member_tension,
            "force_density": members.force_density,
            "node_force": self.node_force,
            "node_residual": self.node_residual,
            "support_reaction": self.support_reaction,
            "elastic_energy": members.elastic_energy,
            "potential_energy": self.potential_energy,
            "kinetic_energy": self.kinetic_energy,
            "total_energy": self.total_energy,
            "acceleration": self.acceleration,
            "state_derivative": self.state_derivative,
            "mass_matrix": self.mass_matrix,
            "material_stiffness": self.material_stiffness,
            "geometric_stiffness": self.geometric_stiffness,
            "tangent_stiffness": self.tangent_stiffness,
            "damping_matrix": self.damping_matrix,
            "equilibrium_matrix": self.equilibrium_matrix,
            "state_jacobian": self.state_jacobian,
            "input_jacobian": self.input_jacobian,
            "rest_length_jacobian": self.rest_length_jacobian,
            "parameter_jacobian": self.parameter_jacobian,
            "member_extension": members.member_extension,
            **build_bar_quantities(self.bar_pairs, self.arguments.symbols["coordinate"]),
        }

    def bar_pairs(self) -> BarPairs:
        return pair_members(self.structure, self.arguments.position)

    def _differences(self, vectors: list[Vector]) -> list[Vector]:
        return [member_vector(vectors[i], vectors[j]) for i, j in self.ends]

    # Nodes

    @cached_property
    def inertia(self) -> Inertia:
        return Inertia(self.structure, self.arguments.node_mass)

    @cached_property
    def external_force(self) -> list[Vector]:
        """Weight and load on every node [N]."""
        return self.members.node_load(self.inertia.weight_mass())

    @cached_property
    def net_force(self) -> list[Vector]:
        return self.members.add_to(self.external_force, self.members.densities)

    @cached_property
    def net_static_force(self) -> list[Vector]:
        return self.members.add_to(self.external_force, self.members.static_densities)

    def node_force(self) -> ca.SX:
        return ca.horzcat(*[ca.vertcat(*force) for force in self.net_force])

    def node_residual(self) -> ca.SX:
        return self.map.free(self.net_static_force)

    def support_reaction(self) -> ca.SX:
        return -self.map.anchored(self.net_static_force)

    # Energies

    def potential_energy(self) -> Scalar:
        work = ca.SX(0.0)
        for force, position in zip(self.external_force, self.arguments.position, strict=True):
            work = work + dot(force, position)
        return self.members.elastic_energy() - work

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

    def material_stiffness(self) -> ca.SX:
        return self._assembled(self.members.static_blocks(e)[0] for e in self._all())

    def geometric_stiffness(self) -> ca.SX:
        return self._assembled(self.members.static_blocks(e)[1] for e in self._all())

    def tangent_stiffness(self) -> ca.SX:
        blocks = [self.members.static_blocks(e) for e in self._all()]
        return self._assembled(material.plus(geometric) for material, geometric in blocks)

    def damping_matrix(self) -> ca.SX:
        damped = self.members.damped
        return self.map.member_matrix((self.members.rate_block(e), self.ends[e]) for e in damped)

    def state_jacobian(self) -> ca.SX:
        n = self.map.n_coordinates
        stiffness = self._assembled(self.members.position_block(e) for e in self._all())
        lower = [
            -ca.mtimes(self.inverse_mass, stiffness),
            -ca.mtimes(self.inverse_mass, self.damping_matrix()),
        ]
        return ca.vertcat(ca.horzcat(ca.SX(n, n), ca.SX.eye(n)), ca.horzcat(*lower))

    def equilibrium_matrix(self) -> ca.SX:
        vectors, lengths = self.members.vectors, self.members.lengths
        directions = [[c / length for c in vector] for vector, length in zip(vectors, lengths, strict=True)]
        return self.map.member_columns(directions, self.ends)

    def rest_length_jacobian(self) -> ca.SX:
        slope = ca.diag(ca.vertcat(*[law.tension_by_rest_length() for law in self.members.laws]))
        return below_zeros(ca.mtimes(self.inverse_mass, ca.mtimes(-self.equilibrium_matrix(), slope)))

    def input_jacobian(self) -> ca.SX:
        return by_inputs(self.acceleration(), self.arguments)

    def parameter_jacobian(self) -> ca.SX:
        return by_parameters(self.acceleration(), self.arguments)

    def _assembled(self, blocks: Iterable[MemberBlocks]) -> ca.SX:
        return self.map.member_matrix(zip(blocks, self.ends, strict=True))

    def _all(self) -> range:
        return range(self.structure.n_members)
