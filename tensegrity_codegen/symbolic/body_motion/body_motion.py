"""Velocities, angular velocities and energies of motion of bodies, from their kinematics.

bar    T = m |v_P|^2 / 2 + m s v_P . u' + (J + m s^2) |u'|^2 / 2, held at P, s from P to the middle along u
rigid  T = M |v|^2 / 2 + w . I w / 2, w in the body's frame

|u'|^2 = de'^2 + sin(de)^2 al'^2 is written as such: differentiation alone would leave terms that cancel.
"""

from typing import Any

import casadi as ca

from tensegrity_codegen.structure.bodies import Bar, FixedBody, RigidBody
from tensegrity_codegen.structure.kinematics import Kinematics
from tensegrity_codegen.symbolic.body_motion.body_arguments import BodyArguments
from tensegrity_codegen.symbolic.geometry import dot

Scalar = Any
Vector = list[Scalar]


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
        item = self.system.bodies[body]
        if isinstance(item, FixedBody):
            return [ca.SX(0.0)] * 3
        if isinstance(item, RigidBody):
            local = self._body_rate(body)
            return [dot(row, local) for row in self.place.rotation(body)]
        return self._bar_rate(item, body)

    def relative_rotation(self, a: int, b: int) -> Scalar:
        """Return |w_a - w_b|^2 [rad2/s2]; against a fixed body without the sines and cosines that cancel."""
        first, second = self.system.bodies[a], self.system.bodies[b]
        if isinstance(second, FixedBody):
            return self._rotation_square(a)
        if isinstance(first, FixedBody):
            return self._rotation_square(b)
        pair = zip(self.angular_velocity(a), self.angular_velocity(b), strict=True)
        difference = [x - y for x, y in pair]
        return dot(difference, difference)

    def kinetic_energy(self) -> Scalar:
        """Return T [J] of all bodies."""
        total = ca.SX(0.0)
        for body, item in enumerate(self.system.bodies):
            if isinstance(item, Bar):
                total = total + self._bar_energy(item, body)
            elif isinstance(item, RigidBody):
                total = total + self._rigid_energy(item, body)
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
        item = self.system.bodies[body]
        if isinstance(item, Bar):
            if item.spin == "none":
                return self._turning_square(item, body)
            polar, azimuth = self._speed.coordinate(body, -2), self._speed.coordinate(body, -1)
            return polar * polar + azimuth * azimuth
        if isinstance(item, RigidBody):
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
