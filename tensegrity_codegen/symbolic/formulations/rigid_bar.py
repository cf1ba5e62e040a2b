"""Formulation `rigid_bar`: free node coordinates, bars that keep their length exactly.

H q'' = f - J^T lambda,  g_b = (d_b . d_b - l_b^2) / 2 = 0,  J = dg/dq
S lambda = J H^-1 f + |d_b'|^2 - (l_b l_b'' + l_b'^2),  S = J H^-1 J^T;  t_b = lambda_b |d_b|

H is constant. S is diagonal in class-1 structures, so that every multiplier is a closed form; elsewhere its
sparse LDL^T is part of the code. Lengths are constant (l' = 0), or follow the tension to first order.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.free_bodies import BodyFrame, build_body_quantities
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, add_vectors, combine, cross, dot
from tensegrity_codegen.symbolic.interference import build_bar_quantities
from tensegrity_codegen.symbolic.jacobians import by_inputs, by_parameters
from tensegrity_codegen.symbolic.members.member import Member, MemberBlocks
from tensegrity_codegen.symbolic.model import SymbolicModel, frame_structure
from tensegrity_codegen.symbolic.node_coordinates import NodeCoordinates
from tensegrity_codegen.symbolic.quantities import HeldMember, build_member_quantities
from tensegrity_codegen.symbolic.rigid_bar_check import check_rigid_bars, keeps_scene_lengths
from tensegrity_codegen.symbolic.rigid_motion import BarConstraints, RigidMotion
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest, complete_options


def build_rigid_bar(structure: Structure, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of `structure` with rigid bars.

    Options: bars "without_stiffness" or "all"; correction "none" or "first_order" (of bars that have a
    stiffness).
    """
    options = complete_options("rigid_bar", request.options)
    rigid = find_rigid_bars(structure, request)
    check_rigid_bars(structure, rigid, request)
    values = {name: np.where(rigid, 0.0, getattr(structure, name)) for name in ELASTIC}
    arguments = SymbolicArguments(structure.with_changes(**values), request.parameters)
    expressions = _RigidBar(structure, arguments, [int(e) for e in np.flatnonzero(rigid)], options)
    frame = replace(frame_structure(structure), rigid_bar=expressions.constant_bars())
    return SymbolicModel("rigid_bar", structure, frame, arguments.ordered(), expressions.builders(), WORDS)


# Meaning of quantities of structures with rigid bars.
WORDS = {
    "constraint_residual": ("m", "Lengths of the rigid bars minus what they are kept at."),
    "node_residual": (
        "N",
        "Static force -dU/dq of springs, weights and loads on every free coordinate, without that of rigid "
        "bars, which balances it in equilibrium.",
    ),
    "tangent_stiffness": (
        "N/m",
        "Hessian of the potential energy of springs, weights and loads; the rigid bars are not in it.",
    ),
}

SPRINGS_ALONE = "The rigid bars are not in it."
WORDS |= {
    "material_stiffness": (
        "N/m",
        f"Part of the tangent stiffness that comes from the springs' stretching. {SPRINGS_ALONE}",
    ),
    "geometric_stiffness": (
        "N/m",
        f"Part of the tangent stiffness that comes from the springs' tension and turning. {SPRINGS_ALONE}",
    ),
    "damping_matrix": ("N s/m", f"Viscous damping of springs on the free coordinates. {SPRINGS_ALONE}"),
    "support_reaction": (
        "N",
        "Force of the anchors on the structure: springs without damping, weights, loads and the tensions "
        "that the rigid bars have in the motion.",
    ),
}

ELASTIC = ("spring_constant", "axial_stiffness", "damping")


def find_alone_bodies(
    structure: Structure, bars: Sequence[int], changed: Sequence[int] = ()
) -> tuple[int, ...]:
    """Return the bodies that no rigid bar holds but their own edges: their motion has a closed form.

    changed: nodes whose masses can change at run time, which the closed form knows as numbers.
    """
    others = {int(node) for e in bars if not structure.is_edge[e] for node in structure.connectivity[e]}
    others |= set(changed)
    return tuple(
        k for k, body in enumerate(structure.bodies) if others.isdisjoint((*body.corner, *body.point))
    )


class _RigidBar(NodeCoordinates):
    """All expressions of one structure; every intermediate is built once, when first needed.

    structure: as in the scene, with the stiffness of its rigid bars; bars: their indices.
    """

    def __init__(
        self, structure: Structure, arguments: SymbolicArguments, bars: list[int], options: dict[str, str]
    ) -> None:
        super().__init__(arguments.structure, arguments)
        self.elastic = structure
        self.bars = bars
        self.is_corrected = options["correction"] == "first_order"
        self.keeps_scene_lengths = keeps_scene_lengths(options)
        self.q, self.v = (arguments.symbols[name] for name in ("coordinate", "velocity"))
        changed = arguments.parameters.get("node_mass", ())
        self.alone = () if self.is_corrected else find_alone_bodies(structure, bars, changed)
        self._check_changeable_bodies()
        corners = {node for k in self.alone for node in structure.bodies[k].corner}
        self.solved = [b for b, e in enumerate(bars) if int(structure.connectivity[e, 0]) not in corners]

    def _check_changeable_bodies(self) -> None:
        """Raise FormulationError for changeable numbers of bodies that other rigid bars hold."""
        for name in ("body_mass", "body_inertia"):
            held = [k for k in self.arguments.parameters.get(name, ()) if k not in self.alone]
            if held:
                raise FormulationError(
                    "bodies that rigid bars hold have constant masses and inertias",
                    where=f"{self.structure.name}: parameters.{name}",
                    given=self.structure.bodies[held[0]].name,
                    allowed="bodies at which no rigid bar ends",
                    hint="give these bars a stiffness",
                )

    def constant_bars(self) -> tuple[str, ...]:
        """Return the names of the bars whose lengths no tension changes."""
        return () if self.is_corrected else tuple(self.elastic.member_name[e] for e in self.bars)

    def builders(self) -> dict[str, Any]:
        """Return quantity name -> builder."""
        members = self.members
        return {
            "cable_margin": members.cable_margin,
            "switch_margin": members.switch_margin,
            **build_member_quantities(self.elastic, self.each_with_bars),
            **self.node_quantities(),
            "equilibrium_matrix": self.equilibrium_matrix,
            "material_stiffness": lambda: self.of_springs(Member.material_block),
            "geometric_stiffness": lambda: self.of_springs(Member.geometric_block),
            "damping_matrix": lambda: self.of_springs(Member.rate_block, damped=True),
            "elastic_energy": members.elastic_energy,
            "potential_energy": self.potential_energy,
            "kinetic_energy": self.kinetic_energy,
            "total_energy": self.total_energy,
            "energy_rate": self.energy_rate,
            "acceleration": self.acceleration,
            "state_derivative": self.state_derivative,
            "mass_matrix": self.mass_matrix,
            "state_jacobian": self.state_jacobian,
            "input_jacobian": self.input_jacobian,
            "parameter_jacobian": lambda: by_parameters(
                ca.vertcat(self.acceleration(), self.internal_rate()), self.arguments
            ),
            "constraint_residual": self.constraint_residual,
            "consistent_coordinate": self.consistent_coordinate,
            "consistent_velocity": self.consistent_velocity,
            "multiplier": lambda: self.multipliers,
            "rigidity_error": self.rigidity_error,
            **self.mixed_form(),
            **self.statics(),
            **build_bar_quantities(self.bar_pairs, self.q),
            **build_body_quantities(self.arguments.body_frames),
            **self.memory_quantities(),
        }

    def mixed_form(self) -> dict[str, Any]:
        """Return the numbers of the mixed form; a spring constant of zero means that a length is kept."""
        if self.is_corrected:
            return {}
        bar_length = dict(zip(self.bars, self.lengths, strict=True))
        rest_length = self.arguments.rest_length
        laws = [(e, bar_length.get(e, rest_length[e])) for e in range(len(self.ends))]
        return {"member_law": lambda: ca.horzcat(*[self._law(e, length) for e, length in laws])}

    def statics(self) -> dict[str, Any]:
        """Return the stiffness of an equilibrium: springs alone, since the bars only keep their lengths."""
        if self.is_corrected:
            return {}
        return {
            "tangent_stiffness": self.tangent_stiffness,
            "spring_tension": self.members.spring_tension,
            "residual_rest_length_jacobian": self.residual_rest_length_jacobian,
            "tension_jacobian": self.tension_jacobian,
        }

    def tangent_stiffness(self) -> ca.SX:
        """Return the Hessian of U, zeros on the diagonal if no spring moves: nothing is no function."""
        stiffness = super().tangent_stiffness()
        if stiffness.nnz():
            return stiffness
        return ca.SX(ca.Sparsity.diag(self.map.n_coordinates), ca.SX.zeros(self.map.n_coordinates))

    def mass_matrix(self) -> ca.SX:
        """Return H; FormulationError where inertias of bodies can change, which corners do not follow."""
        if "body_inertia" in self.arguments.parameters:
            raise FormulationError(
                "masses at corners do not follow inertias of bodies that can change",
                where=f"{self.structure.name}: parameters.body_inertia",
                given="mass_matrix",
                allowed="motions and their derivatives",
                hint="remove body_inertia from the parameters, or ask for no mass_matrix",
            )
        return super().mass_matrix()

    def kinetic_energy(self) -> ca.SX:
        """Return the kinetic energy [J], of bodies whose inertias can change by their frames."""
        velocity, energy = list(self.arguments.velocity), ca.SX(0.0)
        for k in self.arguments.parameters.get("body_inertia", ()):
            frame = self.arguments.body_frames[k]
            energy = energy + frame.kinetic_energy()
            for node in frame.body.corner:
                velocity[node] = [ca.SX(0.0)] * 3
        return energy + self.inertia.kinetic_energy(velocity)

    # Constraints

    @cached_property
    def constraints(self) -> BarConstraints:
        solved = [self.bars[b] for b in self.solved]
        return BarConstraints(self.structure, solved, self.map, self.inverse_mass)

    @cached_property
    def motion(self) -> RigidMotion:
        """The motion with bars of constant length."""
        return RigidMotion(self, self.constraints)

    @cached_property
    def multipliers(self) -> ca.SX:
        """Multipliers lambda, (n_bars, 1) [N/m]: force densities, positive in tension.

        Those of the edges of bodies that are alone are 0: see `find_alone_bodies`.
        """
        if not self.is_corrected:
            result = ca.SX.zeros(len(self.bars), 1)
            if self.solved:
                result[self.solved] = self.motion.multipliers()
            return result
        bar_lengths = ca.vertcat(*self.lengths)
        pull = bar_lengths * self.stretch(2) + self.stretch(1) * self.stretch(1)
        return self.motion.multipliers() - self.constraints.solve(self.motion.matrix, pull)

    def acceleration(self) -> ca.SX:
        result = self.free_acceleration()
        if self.solved:
            multipliers = self.multipliers[self.solved]
            result = result - self.constraints.move(self.motion.jacobian, multipliers)
        return self._put_bodies(result, self._accelerate_body)

    def _put_bodies(self, values: ca.SX, corners: Callable[[BodyFrame], list[Vector]]) -> ca.SX:
        """Return values of coordinates with those of corners of bodies that are alone."""
        if not self.alone:
            return values
        entries = ca.vertsplit(ca.densify(values))
        for frame in (self.arguments.body_frames[k] for k in self.alone):
            for node, vector in zip(frame.body.corner, corners(frame), strict=True):
                for axis, value in zip(self.structure.axes, vector, strict=True):
                    entries[self.map.index[node, axis]] = value
        return ca.vertcat(*entries)

    def _accelerate_body(self, frame: BodyFrame) -> list[Vector]:
        """Return the accelerations of the corners of a body by the forces on its points."""
        body, zero = frame.body, [ca.SX(0.0)] * 3
        weight = [frame.mass * g for g in self.arguments.gravity]
        forces, moments = [weight], [zero]
        for node, local in zip(body.point, body.point_local, strict=True):
            forces.append(self.net_force[node])
            arm = combine(frame.arm(local), frame.axes) if frame.arm(local) else zero
            moments.append(cross(arm, self.net_force[node]))
        for force in self.node_forces:
            moments += force.body_moments().get(body.corner[0], [])
        for node in body.corner:
            forces.append(self.arguments.node_load[node])
            arm = [x - y for x, y in zip(self.arguments.position[node], frame.centre, strict=True)]
            moments.append(cross(arm, self.arguments.node_load[node]))
        return frame.accelerate(add_vectors(forces), add_vectors(moments))

    def input_jacobian(self) -> ca.SX:
        if self.structure.lagging_actuators or self.structure.relaxes.any() or self.structure.sliding:
            return ca.jacobian(self.state_derivative(), self.arguments.symbols["input"])
        return by_inputs(self.acceleration(), self.arguments)

    def state_derivative(self) -> ca.SX:
        return ca.vertcat(self.v, self.acceleration(), self.internal_rate())

    def state_jacobian(self) -> ca.SX:
        return ca.jacobian(self.state_derivative(), self.state())

    # Lengths that bars are kept at: constant, or rest length + tension / mu to first order

    @cached_property
    def mu_inverse(self) -> list[Scalar]:
        """Inverse of the spring constants of the rigid bars in the scene [m/N]; zero if they have none."""
        return [ca.SX(1.0 / mu if mu else 0.0) for mu in self.elastic.mu[self.bars]]

    def stretch(self, n: int = 0) -> ca.SX:
        """Return the n-th derivative of the stretch t / mu, (n_bars, 1) [m/s^n]; zero without mu."""
        result = ca.SX.zeros(len(self.bars), 1)
        for b, tension in zip(self.solved, self.motion.tensions(n) if self.solved else (), strict=True):
            result[b] = tension * self.mu_inverse[b]
        return result

    @cached_property
    def lengths(self) -> list[Scalar]:
        if self.keeps_scene_lengths:
            reference = np.where(
                self.elastic.is_rigid, self.elastic.rest_length, self.elastic.member_length()
            )
            return [ca.SX(float(reference[e])) for e in self.bars]
        rest_lengths = [self.arguments.rest_length[e] for e in self.bars]
        if not self.is_corrected:
            return rest_lengths
        stretch = self.stretch()
        return [rest_lengths[b] + stretch[b] for b in range(len(self.bars))]

    def constraint_residual(self) -> ca.SX:
        lengths = [self.members.lengths[e] for e in self.bars]
        return ca.vertcat(
            *[length - bar_length for length, bar_length in zip(lengths, self.lengths, strict=True)]
        )

    def consistent_coordinate(self) -> ca.SX:
        lengths = [self.lengths[b] for b in self.solved]
        result = self.q
        if lengths:
            result = self.constraints.project_position(self.q, self.arguments.position, lengths)
        return self._put_bodies(result, BodyFrame.straighten)

    def consistent_velocity(self) -> ca.SX:
        change = self.stretch(1) if self.is_corrected else ca.SX.zeros(len(self.bars), 1)
        rates = [self.lengths[b] * change[b] for b in self.solved]
        result = self.v
        if rates:
            result = self.constraints.project_velocity(self.arguments.position, self.v, rates)
        return self._put_bodies(result, BodyFrame.straighten_velocity)

    def rigidity_error(self) -> ca.SX:
        """Return the neglected part of the bars' lengths: stretch, or the inertia of its change."""
        if not self.is_corrected:
            return ca.fabs(self.stretch())
        square = ca.vertcat(*[dot(d, d) for d in (self.members.vectors[e] for e in self.bars)])
        lag = square * self.stretch(2) / ca.diag(self.motion.matrix)
        return ca.fabs(lag * ca.vertcat(*self.mu_inverse))

    # Forces

    def each_with_bars(self) -> list[Member | HeldMember]:
        """Return all members, rigid bars with their multipliers for force densities."""
        members: list[Member | HeldMember] = list(self.members.members)
        stiffness = self.elastic.mu * self.elastic.rest_length
        for b, e in enumerate(self.bars):
            members[e] = HeldMember(
                self.members.members[e],
                partial(self._multiplier, b),
                partial(self._kept_length, b),
                ca.SX(float(stiffness[e])),
            )
        return members

    def _multiplier(self, b: int) -> Scalar:
        return self.multipliers[b]

    def _kept_length(self, b: int) -> Scalar:
        return self.arguments.rest_length[self.bars[b]] if self.is_corrected else self.lengths[b]

    def node_values(self) -> dict[str, Callable[[], Sequence[Any]]]:
        """Return the values for quantities of nodes; forces without bars where these only keep lengths."""
        values = super().node_values()
        values["force"] = lambda: self.net_force_with_bars
        values["static_force"] = lambda: self.net_static_force_with_bars
        if self.is_corrected:
            del values["spring_force"], values["cable_force"]
        return values

    @cached_property
    def net_force_with_bars(self) -> list[Vector]:
        return self._with_bars(self.net_force)

    @cached_property
    def net_static_force_with_bars(self) -> list[Vector]:
        return self._with_bars(self.net_static_force)

    def equilibrium_matrix(self) -> ca.SX:
        """Return unit vectors of all members, rigid ones too, (n_coordinates, n_members)."""
        return self.columns(Member.direction)

    def of_springs(self, block: Callable[[Member], MemberBlocks], damped: bool = False) -> ca.SX:
        """Return the sum of blocks of members that are springs, of the damped ones alone if asked."""
        rigid = set(self.bars)
        springs = [(e, m) for e, m in self.each_member() if e not in rigid and (m.is_damped or not damped)]
        return self.assembled({e: block(member) for e, member in springs})

    def _with_bars(self, node_force: list[Vector]) -> list[Vector]:
        """Return forces on nodes with those of the rigid bars added [N]."""
        force = [list(row) for row in node_force]
        for b, (i, j) in enumerate(self.constraints.ends):
            pull = [self.multipliers[b] * component for component in self.members.vectors[self.bars[b]]]
            force[i] = [f - p for f, p in zip(force[i], pull, strict=True)]
            force[j] = [f + p for f, p in zip(force[j], pull, strict=True)]
        return force
