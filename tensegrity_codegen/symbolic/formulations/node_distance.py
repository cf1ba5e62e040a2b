"""Formulation `node_distance`: differences of node positions over pairs, and centres of mass (S&K 3 to 7).

delta = D r over the members ("connected") or over all pairs of nodes ("full"); r_c the centre of mass
delta'' = D H^-1 D^T f, r_c'' = M^-1 f_e    in factored form: forces on nodes, over masses, differences
H_delta delta'' + L lambda = f, L^T delta'' = 0    the same as a saddle system, for checks

Member vectors are coordinates: no difference of large numbers enters a tension.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.distance_terms import (
    DistanceBlocks,
    DistanceConstraints,
    build_distance_inertia,
    build_inverse_inertia,
    spread_force,
)
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.interference import BarPairs, build_bar_quantities, pair_members
from tensegrity_codegen.symbolic.jacobians import below_zeros, by_inputs, by_parameters
from tensegrity_codegen.symbolic.members.member_set import MemberSet
from tensegrity_codegen.symbolic.model import Frame, ModelArgument, SymbolicModel, frame_structure
from tensegrity_codegen.symbolic.pair_coordinates import PairCoordinates
from tensegrity_codegen.symbolic.quantities import build_member_quantities, build_node_quantities
from tensegrity_codegen.symbolic.rigid_bar_check import check_no_rigid_bar
from tensegrity_codegen.symbolic.scatter import CoordinateMap
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest, complete_options


def build_node_distance(structure: Structure, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of `structure` in node distances.

    Options: pairs "connected" or "full"; order "uvec321" or "uvec123"; basis "cycles" or "orthonormal".
    """
    check_no_rigid_bar(structure, "node_distance")
    if "anchor_position" in request.parameters:
        raise FormulationError(
            "formulation 'node_distance' has no anchor positions at run time: where the anchors are is part "
            "of the coordinates of the pairs that end there",
            where=f"{structure.name}: parameters.anchor_position",
            given="anchor_position",
            allowed="any other run-time parameter",
            hint='formulation = "node_position", or other coordinates at the start of a simulation',
        ).unless_chosen_otherwise()
    options = complete_options("node_distance", request.options)
    expressions = _NodeDistance(structure, SymbolicArguments(structure, request.parameters), options)
    return SymbolicModel(
        "node_distance",
        structure,
        expressions.frame(),
        expressions.ordered_arguments(),
        expressions.builders(),
    )


class _NodeDistance:
    """All expressions of one structure; every intermediate is built once, when first needed."""

    def __init__(self, structure: Structure, arguments: SymbolicArguments, options: dict[str, str]) -> None:
        self.structure = structure
        self.arguments = arguments
        self.options = options
        self.inertia = Inertia(structure, arguments.node_mass)
        selection, order = options["pairs"], options["order"]
        self.layout = PairCoordinates(structure, selection, order, self.inertia.weight_mass())
        self.coordinate = ca.SX.sym("coordinate", self.layout.n_coordinates)
        self.velocity = ca.SX.sym("velocity", self.layout.n_coordinates)
        zero = self.zero = [[ca.SX(0.0) for _ in structure.axes] for _ in range(structure.n_nodes)]
        positions = structure.node_position[:, list(structure.axes)]
        held = self.held = [[ca.SX(float(x)) for x in row] for row in positions]
        pairs = [int(pair) for pair in self.layout.pairs.pair_of_member]
        self.members = MemberSet(
            structure,
            arguments,
            [self.layout.pair_vector(pair, self.coordinate, held) for pair in pairs],
            [self.layout.pair_vector(pair, self.velocity, zero) for pair in pairs],
        )
        self.constraints = DistanceConstraints(self.layout, options["basis"])
        self.blocks = DistanceBlocks(self.layout, self.members)
        self.positions = self.layout.node_vectors(self.coordinate, held)
        self.velocities = self.layout.node_vectors(self.velocity, zero)

    def frame(self) -> Frame:
        """Return the frame: coordinates by name, none of them that of a node."""
        frame = frame_structure(self.structure)
        return Frame(**{**vars(frame), "coordinate_name": self.layout.names(), "coordinate_node_axis": ()})

    def ordered_arguments(self) -> dict[str, ModelArgument]:
        """Return the arguments, the state in coordinates of its own."""
        structure, layout = self.structure, self.layout
        mass = [ca.SX(float(value)) for value in structure.node_mass]
        weight = np.array([float(value) for value in Inertia(structure, mass).weight_mass()])
        builders = {
            "coordinate": ModelArgument(
                self.coordinate,
                layout.compute(structure.node_position, weight),
                sentence="Differences of node positions over the pairs, then the centre of mass.",
            ),
            "velocity": ModelArgument(
                self.velocity,
                layout.compute(structure.node_velocity, weight),
                sentence="Rates of these differences and of the centre of mass.",
            ),
        }
        return {**self.arguments.ordered(), **builders}

    def builders(self) -> dict[str, Any]:
        """Return quantity name -> builder."""
        members = self.members
        return {
            **self.node_quantities(),
            **build_member_quantities(self.structure, lambda: members.members),
            "elastic_energy": members.elastic_energy,
            "potential_energy": self.potential_energy,
            "kinetic_energy": self.kinetic_energy,
            "total_energy": self.total_energy,
            "acceleration": self.acceleration,
            "state_derivative": lambda: ca.vertcat(self.velocity, self.acceleration()),
            "difference_map": lambda: ca.sparsify(ca.SX(self.layout.difference_map())),
            "centre_map": self.layout.centre_map,
            "distance_force": self.distance_force,
            "distance_inertia": self.distance_inertia,
            "distance_inertia_inverse": lambda: self.inverse_inertia,
            "constraint_basis": lambda: ca.SX(self.constraints.basis),
            "constraint_residual": lambda: self.constraints.residual(self.coordinate),
            "consistent_coordinate": lambda: self._close_cycles(self.coordinate, self.held),
            "consistent_velocity": lambda: self._close_cycles(self.velocity, self.zero),
            "multiplier": self.multiplier,
            "saddle_matrix": lambda: self.constraints.saddle_matrix(self.distance_inertia()),
            "force_jacobian": self.blocks.by_position,
            "control_jacobian": self.blocks.by_input,
            "state_jacobian": self.state_jacobian,
            "input_jacobian": self.input_jacobian,
            "rest_length_jacobian": self.rest_length_jacobian,
            "tension_jacobian": self.tension_jacobian,
            "parameter_jacobian": self.parameter_jacobian,
            "cable_margin": members.cable_margin,
            "switch_margin": members.switch_margin,
            **build_bar_quantities(self.bar_pairs, self.coordinate),
        }

    # Nodes and energies

    def bar_pairs(self) -> BarPairs:
        """Return the pairs of bars, between points counted from a point of the structure."""
        origin = self.layout.find_origin(self.coordinate, self.held)
        nodes = self.layout.node_vectors(self.coordinate, self.held, origin)
        return pair_members(self.structure, nodes, origin)

    @cached_property
    def external_force(self) -> list[Vector]:
        """Weight and load on every node [N]."""
        return self.members.node_load(self.inertia.weight_mass())

    @cached_property
    def net_force(self) -> list[Vector]:
        return self.members.add_to(self.external_force, lambda member: member.density)

    @cached_property
    def net_static_force(self) -> list[Vector]:
        return self.members.add_to(self.external_force, lambda member: member.static_density)

    def node_quantities(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of quantities of nodes, but those of free node coordinates."""
        values: dict[str, Callable[[], Sequence[Any]]] = {
            "position": lambda: self.positions,
            "velocity": lambda: self.velocities,
            "mass": self.inertia.weight_mass,
            "load": lambda: self.external_force,
            "force": lambda: self.net_force,
            "static_force": lambda: self.net_static_force,
        }
        stacks = {"n_anchored_coordinates": CoordinateMap(self.structure).anchored}
        return build_node_quantities(values, self.structure.n_nodes, stacks, has_states=True)

    def potential_energy(self) -> Scalar:
        work = ca.SX(0.0)
        for force, position in zip(self.external_force, self.positions, strict=True):
            work = work + dot(force, position)
        return self.members.elastic_energy() - work

    def kinetic_energy(self) -> Scalar:
        return self.inertia.kinetic_energy(self.velocities)

    def total_energy(self) -> Scalar:
        return self.kinetic_energy() + self.potential_energy()

    # Dynamics: forces on nodes, over masses, differences

    def acceleration(self) -> ca.SX:
        self.inertia.check()
        node: list[Vector] = [[ca.SX(0.0) for _ in self.layout.axes] for _ in self.net_force]
        for column, axis in enumerate(self.layout.axes):
            for nodes in self.inertia.groups(axis):
                solution = self.inertia.solve(nodes, [self.net_force[k][column] for k in nodes])
                for k, value in zip(nodes, solution, strict=True):
                    node[k][column] = value
        return ca.vertcat(*self.layout.differences(node), *self._centre_accelerations())

    def _centre_forces(self) -> list[Scalar]:
        """Return the sum of external forces on each floating part; member forces cancel in it."""
        return [
            sum((self.external_force[node][centre.column] for node in centre.nodes), ca.SX(0.0))
            for centre in self.layout.centres
        ]

    def _centre_accelerations(self) -> list[Scalar]:
        forces = zip(self.layout.centres, self._centre_forces(), strict=True)
        return [force / self.layout.mass(centre) for centre, force in forces]

    def distance_force(self) -> ca.SX:
        values = spread_force(self.layout, self.external_force)
        for e, vector in enumerate(self.members.vectors):
            for index, row in self.blocks.places(e):
                values[index] = values[index] - self.members.densities[e] * vector[row]
        return ca.vertcat(*values, *self._centre_forces())

    def distance_inertia(self) -> ca.SX:
        self._check_full("the diagonal inertia in node distances")
        self.inertia.check()
        return build_distance_inertia(self.layout, self.inertia)

    @cached_property
    def inverse_inertia(self) -> ca.SX:
        return build_inverse_inertia(self.layout, self.inertia)

    # Constraints

    def _close_cycles(self, vector: ca.SX, fixed: list[Vector]) -> ca.SX:
        if not any(graph.closing.size for graph in self.layout.graphs):
            raise FormulationError(
                "the pairs form no cycle, so that every state is consistent",
                where=f"{self.structure.name}: model.quantities",
                hint="remove it from the quantities",
            )
        return ca.vertcat(*self.layout.close_cycles(vector, fixed))

    def multiplier(self) -> ca.SX:
        inertia_force = ca.mtimes(self.distance_inertia(), self.acceleration())
        return self.constraints.multiplier(self.distance_force() - inertia_force)

    def _check_full(self, quantity: str) -> None:
        if self.options["pairs"] != "full":
            raise FormulationError(
                f"{quantity} needs the pairs of all nodes",
                where=f"{self.structure.name}: model.options.pairs",
                given=self.options["pairs"],
                allowed="full",
                hint='options = { pairs = "full" }',
            ).unless_chosen_otherwise()

    # Linear model (S&K 5, 6)

    def state_jacobian(self) -> ca.SX:
        n = self.layout.n_coordinates
        blocks = (self.blocks.by_position(), self.blocks.by_velocity())
        lower = [ca.mtimes(self.inverse_inertia, block) for block in blocks]
        return ca.vertcat(ca.horzcat(ca.SX(n, n), ca.SX.eye(n)), ca.horzcat(*lower))

    def rest_length_jacobian(self) -> ca.SX:
        return below_zeros(ca.mtimes(self.inverse_inertia, self.blocks.by_rest_length()))

    def tension_jacobian(self) -> ca.SX:
        tensions = ca.vertcat(*[member.tension for member in self.members.members])
        return ca.jacobian(tensions, self.coordinate)

    def input_jacobian(self) -> ca.SX:
        return by_inputs(self.acceleration(), self.arguments)

    def parameter_jacobian(self) -> ca.SX:
        return by_parameters(self.acceleration(), self.arguments)
