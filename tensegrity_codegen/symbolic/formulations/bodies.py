"""Formulation `bodies`: rigid bodies and tendons in minimal coordinates, Lagrange by differentiation.

M(q) q'' + c(q, q') + A(q) T(q) + C(q) q' + H(q) F = 0 (SCS 10), where M and c come from the kinetic energy,
A = dl/dq, C from the friction of joints and the damping of tendons, H from the loads; weight and forces of
constant direction enter through their potential.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodyLoad, BodySystem, FixedBody, RigidBody
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.member_laws import SECTION_VALUES
from tensegrity_codegen.symbolic.body_motion import BodyArguments, BodyMotion, Lagrangian
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot, member_vector
from tensegrity_codegen.symbolic.interference import BarPairs, build_bar_quantities
from tensegrity_codegen.symbolic.jacobians import below_zeros
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.members.member_law import MemberLaw
from tensegrity_codegen.symbolic.model import Frame, SymbolicModel
from tensegrity_codegen.symbolic.quantities import build_member_quantities, build_node_quantities, stack_nodes
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest

QUANTITIES = (
    "node_jacobian", "chart_margin",
    "cable_margin", "switch_margin",
    "elastic_energy", "potential_energy", "kinetic_energy", "total_energy", "energy_rate",
    "coordinate_force", "unpotential_force", "coriolis_force", "acceleration", "state_derivative",
    "mass_matrix", "equilibrium_matrix", "damping_matrix", "load_matrix", "tangent_stiffness",
    "state_jacobian", "input_jacobian", "rest_length_jacobian", "parameter_jacobian",
    "residual_rest_length_jacobian", "tension_jacobian",
)  # fmt: skip


# Units and sentences, where coordinates are angles and positions.
WORDS = {
    "acceleration": ("m/s2, rad/s2", "Accelerations q'' = M^-1 (f - c) of the coordinates."),
    "state_derivative": ("m/s, rad/s, m/s2, rad/s2", "Derivative of the state x = (q, q')."),
    "mass_matrix": ("kg, kg m, kg m2", "Mass matrix M(q) of the bodies."),
    "equilibrium_matrix": ("1, m", "Tendon matrix A = dl/dq, transposed: A t balances the other forces."),
    "damping_matrix": (
        "N s/m, N s, N m s",
        "Matrix C(q) of joint friction and of the damping of taut tendons: C q' in the equations of motion.",
    ),
    "tangent_stiffness": (
        "N/m, N, N m",
        "Hessian of the potential energy, less the slope of the forces that have no potential.",
    ),
    "kinetic_energy": ("J", "Kinetic energy q'^T M(q) q' / 2."),
    "potential_energy": ("J", "Strain energy minus the work of gravity and of forces of constant direction."),
    "residual_rest_length_jacobian": (
        "N/m, N",
        "Derivative of `coordinate_force` to the rest lengths of all members; zero in the columns of slack "
        "cables.",
    ),
    "tension_jacobian": (
        "N/m, N",
        "Derivative of the member tensions to the coordinates at constant rest lengths; zero in the rows of "
        "slack cables.",
    ),
    "state_jacobian": ("1/s, 1/s2, and per m", "Jacobian of the state derivative to the state."),
}


def build_bodies(system: BodySystem, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model of bodies and tendons in minimal coordinates."""
    _check_inertia(system)
    expressions = _Bodies(BodyArguments(system, request.parameters))
    builders = expressions.node_quantities() | {name: getattr(expressions, name) for name in QUANTITIES}
    builders |= build_member_quantities(system, lambda: expressions.members)
    builders |= build_bar_quantities(expressions.bar_pairs, expressions.q)
    return SymbolicModel(
        "bodies", system, expressions.frame(), expressions.arguments.ordered(), builders, WORDS
    )


def _check_inertia(system: BodySystem) -> None:
    """Raise FormulationError if a body can move without any kinetic energy."""
    for body in system.bodies:
        if isinstance(body, Bar):
            bare = not body.mass > 0 or (not body.held and not body.inertia > 0)
        elif isinstance(body, RigidBody):
            bare = not body.mass > 0 or not np.linalg.eigvalsh(np.array(body.inertia))[0] > 0
        else:
            bare = False
        if bare:
            raise FormulationError(
                "a body that can move without any kinetic energy has no acceleration",
                where=f"{system.name}: bodies.{body.name}",
                allowed="a mass > 0 and an inertia > 0; a held bar needs no inertia of its own",
            )


class _Bodies:
    """All expressions of one system; every intermediate is built once, when first needed."""

    def __init__(self, arguments: BodyArguments) -> None:
        self.arguments, self.system = arguments, arguments.system
        self.motion = BodyMotion(arguments)
        self.place = self.motion.place
        self.q, self.v, self.u = arguments.coordinate, arguments.velocity, arguments.input
        self.n = self.system.n_coordinates

    def frame(self) -> Frame:
        system = self.system
        speed = ca.Function("node_velocity", [self.q, self.v], [stack_nodes(self.node_rates)])
        return Frame(
            axes=(0, 1, 2),
            node_name=system.node_name,
            node_position=compute_node_position(system),
            node_velocity=np.array(speed(system.coordinate, system.velocity)).T.reshape(-1, 3),
            member_name=system.member_name,
            connectivity=tuple((int(i), int(j)) for i, j in system.connectivity),
            coordinate_name=system.coordinate_name,
            coordinate_node_axis=(),
            input_name=tuple(source.name for source in system.inputs),
            find_bar_pair=lambda: tuple(
                (system.bodies[i].name, system.bodies[j].name) for i, j in system.bar_pairs
            ),
        )

    def bar_pairs(self) -> BarPairs:
        system = self.system
        bars = [k for k, body in enumerate(system.bodies) if isinstance(body, Bar)]
        row = {body: k for k, body in enumerate(bars)}
        ends = [[[ca.SX(x) for x in self.points[node]] for node in system.bar_ends(body)] for body in bars]
        radius = [body.radius for body in system.bodies if isinstance(body, Bar)]
        return BarPairs(ends, radius, [(row[int(i)], row[int(j)]) for i, j in system.bar_pairs], system.name)

    # Points

    @cached_property
    def points(self) -> list[Vector]:
        return [self.place.point(node) for node in range(self.system.n_nodes)]

    @cached_property
    def stacked_points(self) -> ca.SX:
        return ca.vertcat(*[ca.SX(component) for point in self.points for component in point])

    @cached_property
    def node_rates(self) -> list[Vector]:
        rates = ca.jtimes(self.stacked_points, self.q, self.v)
        return [ca.vertsplit(rate) for rate in ca.vertsplit(rates, 3)]

    def node_quantities(self) -> dict[str, Callable[[], ca.SX]]:
        values: dict[str, Callable[[], Sequence[Any]]] = {
            "position": lambda: self.points,
            "velocity": lambda: self.node_rates,
        }
        return build_node_quantities(values, self.system.n_nodes, has_states=True)

    def node_jacobian(self) -> ca.SX:
        return ca.jacobian(self.stacked_points, self.q)

    def chart_margin(self) -> ca.SX:
        return ca.vertcat(*[self.place.margin(body) for body in self.system.charted])

    # Tendons

    @cached_property
    def vectors(self) -> list[Vector]:
        pairs = [(int(i), int(j)) for i, j in self.system.connectivity]
        return [[ca.SX(x) for x in member_vector(self.points[i], self.points[j])] for i, j in pairs]

    @cached_property
    def members(self) -> list[Member]:
        return [self._member(e, vector) for e, vector in enumerate(self.vectors)]

    def _member(self, e: int, vector: Vector) -> Member:
        values = self.arguments.member_values(e)
        rate = [] if values["damping"].is_zero() else self.motion.rate(vector)
        section = {name: ca.SX(float(getattr(self.system, name)[e])) for name in SECTION_VALUES}
        return Member(vector, rate, values, bool(self.system.tension_only[e]), section)

    @cached_property
    def laws(self) -> list[MemberLaw]:
        return [member.law for member in self.members]

    @cached_property
    def lengths(self) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *[law.length for law in self.laws])

    def cable_margin(self) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *[law.margin() for law in self.laws if law.tension_only])

    def switch_margin(self) -> ca.SX:
        laws = [self.laws[e] for e in np.flatnonzero(self.system.has_switch)]
        return ca.vertcat(ca.SX(0, 1), *[law.switch() for law in laws])

    @cached_property
    def tendon_matrix(self) -> ca.SX:
        return ca.jacobian(self.lengths, self.q).T

    def equilibrium_matrix(self) -> ca.SX:
        return self.tendon_matrix

    # Energies

    def elastic_energy(self) -> Scalar:
        return sum((law.energy() for law in self.laws), ca.SX(0.0))

    @cached_property
    def load_potential(self) -> Scalar:
        """Potential of weight and of forces with a constant direction [J]."""
        energy = ca.SX(0.0)
        for body, spec in enumerate(self.system.bodies):
            if not isinstance(spec, FixedBody):
                energy = energy - spec.mass * dot(self.arguments.gravity, self.place.centre(body))
        for node, load in enumerate(self.arguments.node_load):
            if not isinstance(self.system.bodies[int(self.system.node_body[node])], FixedBody):
                energy = energy - dot(load, self.points[node])
        return energy

    def potential_energy(self) -> Scalar:
        return self.elastic_energy() + self.load_potential

    @cached_property
    def lagrangian(self) -> Lagrangian:
        return Lagrangian(self.motion.kinetic_energy(), self.q, self.v)

    def kinetic_energy(self) -> Scalar:
        return self.lagrangian.kinetic_energy

    def total_energy(self) -> Scalar:
        return self.kinetic_energy() + self.potential_energy()

    # Generalised forces

    def unpotential_force(self) -> ca.SX:
        return self.turning_force

    @cached_property
    def turning_force(self) -> ca.SX:
        """Generalised force of torques and of forces that turn with their body, (n_coordinates, 1)."""
        force = ca.SX(self.n, 1)
        for load in self.system.loads:
            force = force + self._spread(load, load.target, [ca.SX(x) for x in load.vector])
        for index, source in enumerate(self.system.inputs):
            if source.kind == "torque" or (source.kind == "force" and source.frame == "body"):
                for target in source.targets:
                    vector = [self.u[index] * x for x in source.direction]
                    force = force + self._spread(source, target, vector)
        return force

    def _spread(self, load: BodyLoad | BodyInput, target: int, vector: Vector) -> ca.SX:
        """Return J^T F of a force on a node or a torque on a body, (n_coordinates, 1) (SCS 6)."""
        body = target if load.kind == "torque" else int(self.system.node_body[target])
        if load.frame == "body":
            vector = [dot(row, vector) for row in self.place.rotation(body)]
        if load.kind == "force":
            point = ca.vertcat(*self.points[target])
            return ca.jtimes(point, self.q, ca.vertcat(*vector), True)
        turning = ca.vertcat(*self.motion.angular_velocity(body))
        return ca.jtimes(turning, self.v, ca.vertcat(*vector), True)

    @cached_property
    def external_force(self) -> ca.SX:
        return self.turning_force - ca.gradient(self.load_potential, self.q)

    @cached_property
    def static_force(self) -> ca.SX:
        tension = ca.vertcat(ca.SX(0, 1), *[law.static_tension() for law in self.laws])
        return self.external_force - ca.mtimes(self.tendon_matrix, tension)

    def coordinate_force(self) -> ca.SX:
        return self.static_force

    def coriolis_force(self) -> ca.SX:
        return self.lagrangian.coriolis_force

    @cached_property
    def dissipation(self) -> Scalar:
        """Rayleigh's function of the joints, half the power that they lose [W]."""
        half_power = ca.SX(0.0)
        for joint in self.system.friction:
            half_power = half_power - 0.5 * joint.coefficient * self.motion.relative_rotation(*joint.bodies)
        return half_power

    @cached_property
    def force(self) -> ca.SX:
        """All generalised forces, (n_coordinates, 1): M q'' + c = force."""
        tension = ca.vertcat(ca.SX(0, 1), *[law.tension() for law in self.laws])
        friction = ca.gradient(self.dissipation, self.v)
        return self.external_force - ca.mtimes(self.tendon_matrix, tension) - friction

    def energy_rate(self) -> Scalar:
        """Power of joints, damping and loads without potential [W]; a plain zero if there is none."""
        power = ca.SX(0.0)
        if self.system.friction:
            power = power - 2.0 * self.dissipation
        if self.system.has_unpotential_load:
            power = power + ca.dot(self.turning_force, self.v)
        for e, law in enumerate(self.laws):
            if not self.arguments.damping[e].is_zero():
                power = power + (law.static_tension() - law.tension()) * law.rate
        return power

    def damping_matrix(self) -> ca.SX:
        matrix = ca.hessian(self.dissipation, self.v)[0]
        damped = [e for e, value in enumerate(self.arguments.damping) if not value.is_zero()]
        if damped:
            columns = self.tendon_matrix[:, damped]
            rates = ca.diag(ca.vertcat(*[self.laws[e].tension_by_rate() for e in damped]))
            matrix = matrix + ca.mtimes(columns, ca.mtimes(rates, columns.T))
        return matrix

    def load_matrix(self) -> ca.SX:
        return -ca.jacobian(self.external_force, self.u)

    def tangent_stiffness(self) -> ca.SX:
        return ca.hessian(self.potential_energy(), self.q)[0] - ca.jacobian(self.turning_force, self.q)

    # Dynamics

    def mass_matrix(self) -> ca.SX:
        return self.lagrangian.mass_matrix

    @cached_property
    def accelerations(self) -> ca.SX:
        return self.lagrangian.solve(self.force - self.coriolis_force())

    def acceleration(self) -> ca.SX:
        return self.accelerations

    def state_derivative(self) -> ca.SX:
        return ca.vertcat(self.v, self.accelerations)

    def _by(self, symbols: ca.SX) -> ca.SX:
        """Return dq''/dsymbols = -M^-1 d(M a + c - f)/dsymbols at a = q'', without differentiating M^-1."""
        a = ca.SX.sym("a", self.n)
        residual = ca.mtimes(self.mass_matrix(), a) + self.coriolis_force() - self.force
        slope = ca.substitute(ca.jacobian(residual, symbols), a, self.accelerations)
        return self.lagrangian.solve(-slope)

    def state_jacobian(self) -> ca.SX:
        upper = ca.horzcat(ca.SX(self.n, self.n), ca.SX.eye(self.n))
        return ca.vertcat(upper, self._by(ca.vertcat(self.q, self.v)))

    def input_jacobian(self) -> ca.SX:
        return below_zeros(self._by(self.u))

    def rest_length_jacobian(self) -> ca.SX:
        slope = ca.diag(ca.vertcat(*[law.tension_by_rest_length() for law in self.laws]))
        return below_zeros(self.lagrangian.solve(-ca.mtimes(self.tendon_matrix, slope)))

    def residual_rest_length_jacobian(self) -> ca.SX:
        slope = ca.diag(ca.vertcat(*[law.static_tension_by_rest_length() for law in self.laws]))
        return -ca.mtimes(self.tendon_matrix, slope)

    def tension_jacobian(self) -> ca.SX:
        return ca.jacobian(ca.vertcat(ca.SX(0, 1), *[law.tension() for law in self.laws]), self.q)

    def parameter_jacobian(self) -> ca.SX:
        stacked = self.arguments.parameter_symbols()
        if stacked.numel() == 0:
            raise FormulationError(
                "parameter_jacobian needs run-time parameters, and the scene keeps none",
                where=f"{self.system.name}: model.quantities",
                hint='name some under [parameters], for example rest_length = "all"',
            )
        return below_zeros(self._by(stacked))
