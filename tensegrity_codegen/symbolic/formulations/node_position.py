"""Formulation `node_position`: free node coordinates, members as springs (S&K 2, 5).

H q'' = f,  f = sum over members of -t_e d_e / l_e on node i and + on node j, weight and loads
K = sum of (dt/dl) d d^T / l^2 + (t/l) (I - d d^T / l^2), material + geometric
"""

from collections.abc import Iterable
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.memory_support import require_no_memory
from tensegrity_codegen.structure.sliding import require_no_ring_friction
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.geometry import Vector
from tensegrity_codegen.symbolic.interference import build_bar_quantities
from tensegrity_codegen.symbolic.jacobians import below_zeros, by_parameters
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.model import SymbolicModel, frame_structure
from tensegrity_codegen.symbolic.node_coordinates import NodeCoordinates
from tensegrity_codegen.symbolic.quantities import build_member_quantities
from tensegrity_codegen.symbolic.rigid_bar_check import check_no_rigid_bar
from tensegrity_codegen.tables.request import ModelRequest


def build_node_position(structure: Structure, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of `structure` in node positions."""
    check_no_rigid_bar(structure, "node_position")
    expressions = _NodePosition(structure, SymbolicArguments(structure, request.parameters))
    arguments = expressions.arguments.ordered()
    frame = frame_structure(structure)
    return SymbolicModel(
        "node_position", structure, frame, arguments, expressions.builders(), parts=expressions
    )


class _NodePosition(NodeCoordinates):
    """All expressions of one structure; every intermediate is built once, when first needed."""

    def builders(self) -> dict[str, Any]:
        """Return quantity name -> builder."""
        members = self.members
        return {
            **build_member_quantities(self.structure, lambda: members.members),
            **self.node_quantities(),
            "member_law": self.member_law,
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
            "residual_rest_length_jacobian": self.residual_rest_length_jacobian,
            "tension_jacobian": self.tension_jacobian,
            "parameter_jacobian": self.parameter_jacobian,
            "cable_margin": members.cable_margin,
            "switch_margin": members.switch_margin,
            **build_bar_quantities(self.bar_pairs, self.arguments.symbols["coordinate"]),
            **self.memory_quantities(),
        }

    # Dynamics

    def acceleration(self) -> ca.SX:
        return self.free_acceleration()

    def state_derivative(self) -> ca.SX:
        return ca.vertcat(self.arguments.symbols["velocity"], self.acceleration(), self.internal_rate())

    # Stiffness and Jacobians, member block by member block

    def material_stiffness(self) -> ca.SX:
        return self.assembled({e: member.material_block() for e, member in self.each_member()})

    def geometric_stiffness(self) -> ca.SX:
        return self.assembled({e: member.geometric_block() for e, member in self.each_member()})

    def damping_matrix(self) -> ca.SX:
        return self.assembled(
            {e: member.rate_block() for e, member in self.each_member() if member.is_damped}
        )

    def state_jacobian(self) -> ca.SX:
        if self.structure.remembers.any() or self.structure.lagging_actuators or self.structure.sliding:
            return ca.jacobian(self.state_derivative(), self.state())
        n = self.map.n_coordinates
        stiffness = self.assembled({e: member.position_block() for e, member in self.each_member()})
        lower = [
            -ca.mtimes(self.inverse_mass, stiffness),
            -ca.mtimes(self.inverse_mass, self.damping_matrix()),
        ]
        upper = ca.horzcat(ca.SX(n, n), ca.SX.eye(n))
        if not self.node_forces:
            return ca.vertcat(upper, ca.horzcat(*lower))
        count = len(self.structure.internal_name)
        accelerations = ca.horzcat(*lower, ca.SX(n, count)) + ca.mtimes(
            self.inverse_mass, self.force_jacobian()
        )
        memory = ca.jacobian(self.internal_rate(), self.state())
        return ca.vertcat(ca.horzcat(upper, ca.SX(n, count)), accelerations, memory)

    def equilibrium_matrix(self) -> ca.SX:
        return self.columns(Member.direction)

    def rest_length_jacobian(self) -> ca.SX:
        if self.structure.relaxes.any():
            require_no_memory(self.structure, "rest_length_jacobian", "use input_jacobian")
        require_no_ring_friction(self.structure, "rest_length_jacobian", "use input_jacobian")
        pull = ca.mtimes(self.inverse_mass, self.columns(Member.rest_pull))
        return below_zeros(pull, len(self.structure.internal_name))

    def input_jacobian(self) -> ca.SX:
        if self.structure.lagging_actuators or self.structure.relaxes.any() or self.structure.sliding:
            return ca.jacobian(self.state_derivative(), self.arguments.symbols["input"])
        force = self.map.node_columns(self._pulls_of_inputs(), len(self.structure.inputs))
        return below_zeros(ca.mtimes(self.inverse_mass, force), len(self.structure.internal_name))

    def _pulls_of_inputs(self) -> Iterable[tuple[int, int, Vector, int]]:
        """Yield input, node, force that one unit of it adds there, and its sign: members in their order."""
        gains = [source.rest_length_gain for source in self.structure.inputs]
        for e in self.members.plan.member.tolist():
            for number, gain in ((n, gain[e]) for n, gain in enumerate(gains) if e in gain):
                for strand, ends in zip(
                    self.members.members[e].strands, self.members.strand_ends[e], strict=True
                ):
                    pull = [gain * component for component in strand.rest_pull()]
                    for node, sign in zip(ends, (1, -1), strict=True):
                        yield number, node, pull, sign
        for number, source in enumerate(self.structure.inputs):
            for node in source.targets if source.kind == "force" else ():
                yield number, node, [ca.SX(source.direction[axis]) for axis in self.structure.axes], 1

    def parameter_jacobian(self) -> ca.SX:
        return by_parameters(ca.vertcat(self.acceleration(), self.internal_rate()), self.arguments)
