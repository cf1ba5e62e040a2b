"""Shared parts of all formulations in free node coordinates: places, members, masses, energies."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.ground import ENERGY_STATES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot, member_vector
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.interference import BarPairs, pair_members
from tensegrity_codegen.symbolic.members.member import Member, MemberBlocks
from tensegrity_codegen.symbolic.members.member_set import MemberSet, build_member_memories
from tensegrity_codegen.symbolic.members.rings import Pairs, RingFriction
from tensegrity_codegen.symbolic.memory import POWERS, Memory, Motors
from tensegrity_codegen.symbolic.node_forces import build_node_forces
from tensegrity_codegen.symbolic.node_forces.node_force import NodeForce
from tensegrity_codegen.symbolic.quantities import build_node_quantities
from tensegrity_codegen.symbolic.scatter import CoordinateMap
from tensegrity_codegen.tables.quantities import STATE


class NodeCoordinates:
    """Expressions of one structure in its free node coordinates; each is built once, when first needed."""

    def __init__(self, structure: Structure, arguments: SymbolicArguments) -> None:
        self.structure = structure
        self.arguments = arguments
        self.map = CoordinateMap(structure)
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity]
        self.members = MemberSet(
            structure,
            arguments,
            self.differences(arguments.position),
            self.differences(arguments.velocity),
            self._find_strands(),
        )

    def bar_pairs(self) -> BarPairs:
        """Return the pairs of bars whose distance can be asked for."""
        return pair_members(self.structure, self.arguments.position)

    def differences(self, vectors: list[Vector]) -> list[Vector]:
        """Return the difference of the ends' vectors, one a member."""
        return [member_vector(vectors[i], vectors[j]) for i, j in self.ends]

    def _find_strands(self) -> dict[int, tuple[tuple[Vector, Vector], ...]]:
        """Return vector and rate of each strand of the members that pass rings, by member."""
        position, velocity = self.arguments.position, self.arguments.velocity
        paths = {e: self.structure.path(e) for e in np.flatnonzero(self.structure.passes_rings).tolist()}
        return {
            e: tuple(
                (member_vector(position[i], position[j]), member_vector(velocity[i], velocity[j]))
                for i, j in pairwise(path)
            )
            for e, path in paths.items()
        }

    # Nodes

    @cached_property
    def inertia(self) -> Inertia:
        """Mass matrix over the nodes."""
        return Inertia(self.structure, self.arguments.node_mass)

    @cached_property
    def external_force(self) -> list[Vector]:
        """Weight and load on every node [N]."""
        return self.members.node_load(self.inertia.weight_mass())

    @cached_property
    def net_force(self) -> list[Vector]:
        """Weight, load, member forces and those of the ground on every node [N]."""
        total = self.members.add_to(self.external_force, lambda member: member.density)
        return _add_forces(total, (force.forces() for force in self.node_forces))

    # Forces on nodes besides members, and their internal states

    @cached_property
    def node_forces(self) -> list[NodeForce]:
        """Forces on nodes besides members, weights and loads."""
        return build_node_forces(self.structure, self.arguments)

    @cached_property
    def memories(self) -> Sequence[Memory]:
        """Everything with internal states, and the other forces on nodes."""
        memories: list[Memory] = [*self.node_forces, *build_member_memories(self.structure, self.members)]
        if self.structure.lagging_actuators:
            memories.append(Motors(self.arguments))
        if self.structure.sliding:
            memories.append(RingFriction(self.members.members, self.members.slips))
        return memories

    def memory_quantities(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of the quantities of forces on nodes and memory, none without these."""
        if not self.memories:
            return {}
        builders: dict[str, Callable[[], ca.SX]] = {"energy_rate": self.energy_rate}
        names = ("friction", "impact") if self.node_forces else ("friction",) * bool(self.structure.sliding)
        for name in names:
            builders[f"{name}_power"] = partial(self.powers.__getitem__, name)
        for memory in self.memories:
            builders |= memory.builders()
        if self.structure.internal_name:
            builders["internal_rate"] = self.internal_rate
        if any(memory.settled() for memory in self.memories):
            builders["settled_internal"] = self.settled_internal
        if self.structure.relaxes.any():
            builders["relaxed_internal"] = self.relaxed_internal
        return builders

    def settled_internal(self) -> ca.SX:
        """Return the internal states after an event, (n_internal, 1)."""
        return self._put_internal(memory.settled() for memory in self.memories)

    def relaxed_internal(self) -> ca.SX:
        """Return the internal states at rest after infinite time, (n_internal, 1)."""
        return self._put_internal({**memory.settled(), **memory.relaxed()} for memory in self.memories)

    def _put_internal(self, states: Iterable[Mapping[str, Scalar]]) -> ca.SX:
        settled = {name: value for state in states for name, value in state.items()}
        return ca.vertcat(*[settled.get(name, old) for name, old in self.arguments.internal.items()])

    def internal_rate(self) -> ca.SX:
        """Return the rates z' of the internal states, (n_internal, 1); those set at events are constant."""
        rates = {name: rate for memory in self.memories for name, rate in memory.internal_rates().items()}
        names = self.structure.internal_name
        if set(ENERGY_STATES) <= set(names):
            powers = {**self.powers, "damping": self.damping_power()}
            rates |= {name: powers[name.removesuffix("_work")] for name in ENERGY_STATES}
        return ca.vertcat(ca.SX(0, 1), *[rates.get(name, ca.SX(0.0)) for name in names])

    def state(self) -> ca.SX:
        """Return the state (q, v, z), (n_states, 1)."""
        symbols = self.arguments.symbols
        return ca.vertcat(*[symbols[name] for name in STATE if name in symbols])

    def force_jacobian(self) -> ca.SX:
        """Return df/dx of the forces on nodes besides members and loads, (n_coordinates, n_states)."""
        zeros = [[ca.SX(0.0)] * len(self.structure.axes) for _ in range(self.structure.n_nodes)]
        total = _add_forces(zeros, (force.forces() for force in self.node_forces))
        return ca.jacobian(self.map.free(total), self.state())

    def energy_rate(self) -> Scalar:
        """Return the powers of damping, of forces on nodes and of memory [W]."""
        return sum(self.powers.values(), self.damping_power())

    def damping_power(self) -> Scalar:
        """Return the power of the damping of members [W]."""
        power = ca.SX(0.0)
        for e in self.members.damped:
            power = power - self.members.members[e].damping_loss()
        return power

    @cached_property
    def powers(self) -> dict[str, Scalar]:
        """Powers of all forces on nodes and memory, see Memory.powers [W]."""
        powers = {name: ca.SX(0.0) for name in POWERS}
        for memory in self.memories:
            powers |= {name: powers[name] + power for name, power in memory.powers().items()}
        return powers

    def node_values(self) -> dict[str, Callable[[], Sequence[Any]]]:
        """Return name of a value of nodes -> function that returns it of all nodes."""
        return {
            "position": lambda: self.arguments.position,
            "velocity": lambda: self.arguments.velocity,
            "mass": self.inertia.weight_mass,
            "load": lambda: self.external_force,
            "force": lambda: self.net_force,
            "static_force": lambda: self.net_static_force,
            "spring_force": lambda: self.net_static_force,
            "cable_force": lambda: self.cable_force,
        }

    def node_quantities(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of all quantities of nodes."""
        stacks = {"n_coordinates": self.map.free, "n_anchored_coordinates": self.map.anchored}
        has_states = bool(self.structure.bodies)  # points of bodies have no coordinates
        return build_node_quantities(
            self.node_values(), self.structure.n_nodes, stacks, has_states=has_states
        )

    # Two-sided linear members apart from the others, for integrators whose unknowns their tensions are

    @cached_property
    def cable_force(self) -> list[Vector]:
        """Weight, load and forces of cables on every node [N]."""
        zero, mixed = ca.SX(0.0), self.structure.is_mixed.tolist()
        pulls = [
            [strand.pull(zero if mixed[e] else strand.density) for strand in member.strands]
            for e, member in enumerate(self.members.members)
        ]
        return self.members.add_pulls(self.external_force, pulls)

    def member_law(self) -> ca.SX:
        """Return rest length, spring constant, damping and anchored part of d_e, (3 + n_axes, n_members)."""
        return ca.horzcat(*[self._law(e, self.members.laws[e].rest_length) for e in range(len(self.ends))])

    def _law(self, e: int, rest_length: Scalar) -> ca.SX:
        held = self.structure.node_anchored[:, list(self.structure.axes)]
        position, zero, law = self.arguments.position, ca.SX(0.0), self.members.laws[e]
        ends = [
            [p if fixed else zero for p, fixed in zip(position[node], held[node], strict=True)]
            for node in self.ends[e]
        ]
        return ca.vertcat(rest_length, law.largest_mu(), law.damping, *member_vector(*ends))

    # Statics: without damping

    @cached_property
    def net_static_force(self) -> list[Vector]:
        """Weight, load, member forces and those of the ground on every node at rest [N]."""
        total = self.members.add_to(self.external_force, lambda member: member.static_density)
        return _add_forces(total, (force.static_forces() for force in self.node_forces))

    def tangent_stiffness(self) -> ca.SX:
        """Return the Hessian of U with constant z, sparse (n_coordinates, n_coordinates) [N/m]."""
        stiffness = self.assembled({e: member.tangent_block() for e, member in self.each_member()})
        for force in self.node_forces:
            stiffness = stiffness + self.map.node_matrix(force.static_stiffness())
        return stiffness

    def assembled(self, blocks: Mapping[int, MemberBlocks | Pairs]) -> ca.SX:
        """Return the matrix of these blocks of members, sparse (n_coordinates, n_coordinates)."""
        plain = {e: block for e, block in blocks.items() if isinstance(block, MemberBlocks)}
        ends = self.members.strand_ends
        pairs = [
            (ends[e][s], ends[e][t], block)
            for e, found in blocks.items()
            if not isinstance(found, MemberBlocks)
            for (s, t), block in found.items()
        ]
        return self.map.member_matrix(plain, self.ends, self.members.plan.ends, pairs)

    def columns(self, vector: Callable[[Member], Vector]) -> ca.SX:
        """Return a vector of each strand at its first node, minus it at its second, a column a member.

        Sparse (n_coordinates, n_members).
        """
        blocks = [
            (e, node, direction, sign)
            for e, member in self.each_member()
            for strand, (i, j) in zip(member.strands, self.members.strand_ends[e], strict=True)
            for direction in (vector(strand),)
            for node, sign in ((i, 1), (j, -1))
        ]
        return self.map.node_columns(blocks, len(self.ends))

    def each_member(self) -> Iterable[tuple[int, Member]]:
        """Return index and member of all."""
        return enumerate(self.members.members)

    def residual_rest_length_jacobian(self) -> ca.SX:
        """Return the derivative of the residual to rest lengths, sparse (n_coordinates, n_members) [N/m]."""
        return self.columns(Member.static_rest_pull)

    def tension_jacobian(self) -> ca.SX:
        """Return dt/dq of springs, sparse (n_members, n_coordinates) [N/m]."""
        if self.structure.sliding:
            tensions = ca.vertcat(*[member.tension for _, member in self.each_member()])
            return ca.jacobian(tensions, self.arguments.symbols["coordinate"])
        return self.columns(Member.tension_gradient).T

    # Energies

    def potential_energy(self) -> Scalar:
        """Return the energy of springs and ground minus the work of weights and loads [J]."""
        work = ca.SX(0.0)
        for force, position in zip(self.external_force, self.arguments.position, strict=True):
            work = work + dot(force, position)
        energy = self.members.elastic_energy() - work
        for memory in self.memories:
            energy = energy + memory.stored_energy()
        return energy

    def kinetic_energy(self) -> Scalar:
        """Return q'^T H q' / 2 [J]."""
        return self.inertia.kinetic_energy(self.arguments.velocity)

    def total_energy(self) -> Scalar:
        """Return kinetic plus potential energy [J]."""
        return self.kinetic_energy() + self.potential_energy()

    # Dynamics

    def mass_matrix(self) -> ca.SX:
        """Return H, sparse (n_coordinates, n_coordinates) [kg]."""
        self.inertia.check()
        return self.map.assemble(
            (self.inertia.matrix(nodes), self.map.indices(nodes, axis))
            for axis in self.structure.axes
            for nodes in self.inertia.groups(axis)
        )

    @cached_property
    def inverse_mass(self) -> ca.SX:
        """H^-1, sparse (n_coordinates, n_coordinates) [1/kg]."""
        self.inertia.check()
        return self.map.assemble(
            (self.inertia.inverse(nodes), self.map.indices(nodes, axis))
            for axis in self.structure.axes
            for nodes in self.inertia.groups(axis)
        )

    def free_acceleration(self) -> ca.SX:
        """Return H^-1 f of the forces of springs, weights and loads, (n_coordinates, 1) [m/s2]."""
        return self.accelerate(self.net_force)

    def accelerate(self, node_force: list[Vector]) -> ca.SX:
        """Return H^-1 f of a force on every node, (n_coordinates, 1)."""
        self.inertia.check()
        node_force = self.map.gather(node_force)
        result: list[Scalar] = [None] * self.map.n_coordinates
        for column, axis in enumerate(self.structure.axes):
            for nodes in self.inertia.groups(axis):
                force = [node_force[node][column] for node in nodes]
                solution = self.inertia.solve(nodes, force)
                for index, value in zip(self.map.indices(nodes, axis), solution, strict=True):
                    result[index] = value
        return ca.vertcat(*result)


def _add_forces(total: list[Vector], added: Iterable[Mapping[int, Vector]]) -> list[Vector]:
    """Return forces on nodes with those of other parts, node -> force, added [N]."""
    for node, force in (entry for forces in added for entry in forces.items()):
        total[node] = [t + f for t, f in zip(total[node], force, strict=True)]
    return total
