"""Bodies in motion: run-time arguments as symbols, velocities and energies, Lagrange's equations.

bar    T = m |v_P|^2 / 2 + m s v_P . u' + (J + m s^2) |u'|^2 / 2, held at P, s from P to the middle along u
rigid  T = M |v|^2 / 2 + w . I w / 2, w in the body's frame

|u'|^2 = de'^2 + sin(de)^2 al'^2 is written as such: differentiation alone would leave terms that cancel.

Lagrange, for a kinetic energy T(q, q') that is quadratic in q':

d/dt (dT/dq') - dT/dq = M(q) q'' + c(q, q'),   M = d2T/dq'2,   c = d(dT/dq')/dq q' - dT/dq  (SCS 7 to 9)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.bodies import Bar, BodySystem, FixedBody, RigidBody
from tensegrity_codegen.structure.kinematics import Kinematics
from tensegrity_codegen.symbolic.arguments import ChangeableArguments
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot
from tensegrity_codegen.symbolic.model import ModelArgument
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.laws import LAW_PARAMETERS

_OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping")

_OF_COORDINATES = {
    "coordinate": ("m, rad", "Positions and angles of the bodies, body by body."),
    "velocity": ("m/s, rad/s", "Rates of the positions and angles of the bodies."),
}

# Parameters that a body system can keep changeable at run time.
BODY_PARAMETERS = (*_OF_MEMBERS, "node_load", "gravity")


class BodyArguments(ChangeableArguments):
    """Values of a body system, element by element: a symbol where it may change at run time, else a number.

    parameters: argument name -> indices of members or nodes that stay changeable. Raises FormulationError
    for an argument that no body system has.
    """

    def __init__(self, system: BodySystem, parameters: Mapping[str, tuple[int, ...]]) -> None:
        for name in parameters:
            if name not in BODY_PARAMETERS:
                raise FormulationError(
                    "formulation 'bodies' has no such run-time parameter",
                    where=f"{system.name}: parameters",
                    given=name,
                    allowed=", ".join(BODY_PARAMETERS),
                    hint=suggest(name, BODY_PARAMETERS),
                )
        super().__init__(parameters, 3)
        self.system = system
        self.coordinate = self._symbol("coordinate", system.n_coordinates)
        self.velocity = self._symbol("velocity", system.n_coordinates)
        self.input = self._symbol("input", len(system.inputs))
        self.rest_length = self._scalars("rest_length", system.member_value("rest_length"))
        self.spring_constant = self._scalars("spring_constant", system.member_value("spring_constant"))
        self.axial_stiffness = self._scalars("axial_stiffness", system.member_value("axial_stiffness"))
        self.damping = self._scalars("damping", system.member_value("damping"))
        self.law_parameter = {name: self._scalars(name, system.member_value(name)) for name in LAW_PARAMETERS}
        self.node_load = self._vectors("node_load", system.node_load)
        self.gravity = self._gravity(system.gravity)
        self._add_inputs()

    def member_values(self, e: int) -> dict[str, Scalar]:
        """Return the values of the law of tendon e, by the names of MEMBER_VALUES."""
        values = {name: getattr(self, name)[e] for name in _OF_MEMBERS}
        return values | {name: values[e] for name, values in self.law_parameter.items()}

    def _add_inputs(self) -> None:
        """Let inputs change rest lengths, and the forces on nodes that keep their direction."""
        for index, source in enumerate(self.system.inputs):
            for e, gain in source.rest_length_gain.items():
                self.rest_length[e] = self.rest_length[e] + gain * self.input[index]
            for node in source.targets if source.kind == "force" and source.frame == "inertial" else ():
                load = self.node_load[node]
                for axis, component in enumerate(source.direction):
                    load[axis] = load[axis] + self.input[index] * component

    def _argument(self, name: str) -> ModelArgument:
        system, symbol = self.system, self.symbols[name]
        if name == "gravity":
            return ModelArgument(symbol, np.array(system.gravity))
        if name in ("coordinate", "velocity"):
            unit, sentence = _OF_COORDINATES[name]
            return ModelArgument(symbol, np.array(getattr(system, name)), (), sentence, unit)
        if name == "input":
            names = tuple(source.name for source in system.inputs)
            sentence = "Rest-length changes, forces and torques of the actuated inputs."
            unit = "m, K, N or N m" if any(i.kind == "temperature" for i in system.inputs) else "m, N or N m"
            return ModelArgument(symbol, np.zeros(len(names)), names, sentence, unit)
        chosen = list(self.parameters[name])
        names = system.node_name if name == "node_load" else system.member_name
        return ModelArgument(symbol, getattr(system, name)[chosen], tuple(names[k] for k in chosen))


class BodyMotion:
    """Rates of one system; all vectors are lists of three scalars, in inertial axes unless said otherwise."""

    def __init__(self, arguments: BodyArguments) -> None:
        self.system, self.arguments = arguments.system, arguments
        q, v = arguments.coordinate, arguments.velocity
        self.place = Kinematics(self.system, [q[k] for k in range(q.numel())], ca)
        self._speed = Kinematics(self.system, [v[k] for k in range(v.numel())], ca)

    def rate(self, vector: Vector) -> Vector:
        """Return the time derivative of a vector that depends on the coordinates."""
        moved = ca.jtimes(ca.vertcat(*vector), self.arguments.coordinate, self.arguments.velocity)
        return [moved[row] for row in range(len(vector))]

    def angular_velocity(self, body: int) -> Vector:
        """Return w [rad/s]; of a bar by its convention `spin`."""
        spec = self.system.bodies[body]
        if isinstance(spec, FixedBody):
            return [ca.SX(0.0)] * 3
        if isinstance(spec, RigidBody):
            local = self._body_rate(body)
            return [dot(row, local) for row in self.place.rotation(body)]
        return self._bar_rate(spec, body)

    def relative_rotation(self, a: int, b: int) -> Scalar:
        """Return |w_a - w_b|^2 [rad2/s2]; against a fixed body without the sines and cosines that cancel."""
        base, second = self.system.bodies[a], self.system.bodies[b]
        if isinstance(second, FixedBody):
            return self._rotation_square(a)
        if isinstance(base, FixedBody):
            return self._rotation_square(b)
        pair = zip(self.angular_velocity(a), self.angular_velocity(b), strict=True)
        difference = [x - y for x, y in pair]
        return dot(difference, difference)

    def kinetic_energy(self) -> Scalar:
        """Return T [J] of all bodies."""
        total = ca.SX(0.0)
        for body, spec in enumerate(self.system.bodies):
            if isinstance(spec, Bar):
                total = total + self._bar_energy(spec, body)
            elif isinstance(spec, RigidBody):
                total = total + self._rigid_energy(spec, body)
        return total

    def _bar_energy(self, bar: Bar, body: int) -> Scalar:
        square = self._turning_square(bar, body)
        if not bar.held:
            speed = [self._speed.coordinate(body, k) for k in range(3)]
            return 0.5 * bar.mass * dot(speed, speed) + 0.5 * bar.inertia * square
        arm = 0.5 * bar.length if bar.held == "A" else -0.5 * bar.length
        about_end = 0.5 * (bar.inertia + bar.mass * arm * arm) * square
        if isinstance(self.system.bodies[int(self.system.node_body[bar.anchor])], FixedBody):
            return about_end
        speed, turning = self.rate(self.place.point(bar.anchor)), self.rate(self.place.direction(body))
        return about_end + 0.5 * bar.mass * dot(speed, speed) + bar.mass * arm * dot(speed, turning)

    def _rigid_energy(self, rigid: RigidBody, body: int) -> Scalar:
        speed, turning = [self._speed.coordinate(body, k) for k in (3, 4, 5)], self._body_rate(body)
        energy = 0.5 * rigid.mass * dot(speed, speed)
        for row in range(3):
            energy = energy + 0.5 * rigid.inertia[row][row] * turning[row] * turning[row]
            for column in range(row):
                energy = energy + rigid.inertia[row][column] * turning[row] * turning[column]
        return energy

    def _turning_square(self, bar: Bar, body: int) -> Scalar:
        """Return |u'|^2."""
        across = self.place.margin(body)
        polar, azimuth = self._speed.coordinate(body, -2), self._speed.coordinate(body, -1)
        return polar * polar + across * across * azimuth * azimuth

    def _rotation_square(self, body: int) -> Scalar:
        """Return |w|^2."""
        spec = self.system.bodies[body]
        if isinstance(spec, Bar):
            if spec.spin == "none":
                return self._turning_square(spec, body)
            polar, azimuth = self._speed.coordinate(body, -2), self._speed.coordinate(body, -1)
            return polar * polar + azimuth * azimuth
        if isinstance(spec, RigidBody):
            local = self._body_rate(body)
            return dot(local, local)
        return ca.SX(0.0)

    def _bar_rate(self, bar: Bar, body: int) -> Vector:
        """Return w = al' e3 + de' n, with n across u and e3, or without the part along u."""
        angle = self.place.coordinate(body, -1) + bar.chart.offset
        polar, azimuth = self._speed.coordinate(body, -2), self._speed.coordinate(body, -1)
        declination = polar if bar.chart.polar == "declination" else -polar
        e1, e2, e3 = bar.chart.axes
        result: Vector = [ca.SX(0.0)] * 3
        result[e1], result[e2], result[e3] = (
            -declination * ca.sin(angle),
            declination * ca.cos(angle),
            azimuth,
        )
        if bar.spin == "none":
            direction = self.place.direction(body)
            spin = azimuth * direction[e3]
            result = [w - spin * u for w, u in zip(result, direction, strict=True)]
        return result

    def _body_rate(self, body: int) -> Vector:
        """Return w of a rigid body in its own frame, from its 3-1-2 Euler angles."""
        phi, theta = self.place.coordinate(body, 1), self.place.coordinate(body, 2)
        psi_rate, phi_rate, theta_rate = (self._speed.coordinate(body, k) for k in range(3))
        across = psi_rate * ca.cos(phi)
        return [
            phi_rate * ca.cos(theta) - across * ca.sin(theta),
            theta_rate + psi_rate * ca.sin(phi),
            phi_rate * ca.sin(theta) + across * ca.cos(theta),
        ]


@dataclass(frozen=True)
class Lagrangian:
    """A kinetic energy [J] over coordinates and velocities (n_coordinates, 1), all symbols of one graph."""

    kinetic_energy: ca.SX
    coordinate: ca.SX
    velocity: ca.SX

    @cached_property
    def momentum(self) -> ca.SX:
        """dT/dq', (n_coordinates, 1)."""
        return ca.gradient(self.kinetic_energy, self.velocity)

    @cached_property
    def mass_matrix(self) -> ca.SX:
        """M(q), symmetric, sparse (n_coordinates, n_coordinates)."""
        return ca.hessian(self.kinetic_energy, self.velocity)[0]

    @cached_property
    def coriolis_force(self) -> ca.SX:
        """c(q, q'), (n_coordinates, 1): quadratic in the velocities."""
        drift = ca.jtimes(self.momentum, self.coordinate, self.velocity)
        return drift - ca.gradient(self.kinetic_energy, self.coordinate)

    def solve(self, right: ca.SX) -> ca.SX:
        """Return M^-1 right, (n_coordinates, k); sparse LDL^T without pivoting, M is positive definite."""
        factor, transposed, order = self._factors
        return ca.ldl_solve(ca.densify(right), factor, transposed, order)

    @cached_property
    def _factors(self) -> tuple[ca.SX, ca.SX, list[int]]:
        factor, transposed, order = ca.ldl(self.mass_matrix)
        return factor, transposed, order
