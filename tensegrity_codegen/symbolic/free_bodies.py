"""Free rigid bodies in the coordinates of their corners: frames, accelerations and projections.

With the tetrahedron of structure/free_bodies.py, of corners p and principal axes u (of J3, J2, J1)

u_1 = (p_4 - b) / (h - z),  u_2 = (p_3 - p_2) / sqrt(3) B,  u_3 = (p_1 - (p_2 + p_3) / 2) / (3 A / 2)
b = (p_1 + p_2 + p_3) / 3,  c = b - z u_1                                  and the same of velocities
omega_i = (J_j u_j' . u_k - J_k u_k' . u_j) / (J_j + J_k),  (i, j, k) in order: the angular momentum over I
c'' = F / m,  I omega' = U^T M - omega x I omega,  u'' = U (omega'^ + omega^ omega^)

which is the motion that six multipliers of the edges would give. A force F at the place a of the frame adds
(sum over i of a_i D_ik) F to corner k, where u_i = sum over k of D_ik p_k.
"""

from collections.abc import Callable, Mapping
from functools import cached_property

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.free_bodies import FreeBody
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, add_vectors, combine, dot
from tensegrity_codegen.system.arrays import FloatArray

PAIRS = ((1, 2), (2, 0), (0, 1))  # (j, k) of each i
SMALL = 1e-15  # of the size of a body: a component of a place below it counts as zero


class BodyFrame:
    """One body at positions and velocities of its corners, as expressions.

    mass [kg], inertia: principal ones, ascending [kg m2]: numbers, or symbols where they can change, with the
    corners where they are.
    """

    def __init__(
        self, body: FreeBody, mass: Scalar, inertia: Vector, position: list[Vector], velocity: list[Vector]
    ) -> None:
        self.body, self.mass = body, mass
        self.principal, self._corner, _, _ = body.tetrahedron
        low, middle, high = inertia  # about the axes of J1, J2, J3
        self._inertia = [high, middle, low]
        self._moments = [
            0.5 * (middle + low - high),
            0.5 * (low + high - middle),
            0.5 * (middle + high - low),
        ]
        self.corners = [position[k] for k in body.corner]
        self.centre, self.axes = self._split(self.corners)
        self.corner_rates = [velocity[k] for k in body.corner]
        self.centre_rate, self.axis_rates = self._split(self.corner_rates)

    def _split(self, corner: list[Vector]) -> tuple[Vector, list[Vector]]:
        """Return the combinations of corners for the centre of mass and the principal axes."""
        p1, p2, p3, p4 = corner
        z, height = float(self._corner[0, 0]), float(self._corner[3, 0])
        span = 2.0 * float(self._corner[2, 1])
        rise = 1.5 * float(self._corner[0, 2])
        both = [x + y for x, y in zip(p2, p3, strict=True)]
        base = [(x + y) / 3.0 for x, y in zip(p1, both, strict=True)]
        axes = [
            [(x - y) / (height - z) for x, y in zip(p4, base, strict=True)],
            [(x - y) / span for x, y in zip(p3, p2, strict=True)],
            [(x - y / 2.0) / rise for x, y in zip(p1, both, strict=True)],
        ]
        return [x - z * u for x, u in zip(base, axes[0], strict=True)], axes

    def frame_axes(self) -> list[Vector]:
        """Return the unit vectors of the body's own frame."""
        return [combine(list(enumerate(row)), self.axes) for row in self._clean(self.principal)]

    def _clean(self, table: FloatArray) -> list[list[float]]:
        """Return rows without numbers that are rounding."""
        return [[x if abs(x) > SMALL else 0.0 for x in row] for row in table.tolist()]

    def arm(self, local: FloatArray) -> list[tuple[int, float]]:
        """Return the components along the principal axes of the way from the centre to a place [m]."""
        parts = (local - self.body.centre) @ self.principal
        size = float(np.abs(self._corner).max())
        return [(i, x) for i, x in enumerate(parts.tolist()) if abs(x) > SMALL * size]

    def place(self, local: FloatArray) -> tuple[Vector, Vector]:
        """Return position and velocity of a place of the body's frame [m, m/s]."""
        arm = self.arm(local)
        places = ((self.centre, self.axes), (self.centre_rate, self.axis_rates))
        position, velocity = (combine([(3, 1), *arm], [*axes, origin]) for origin, axes in places)
        return position, velocity

    @cached_property
    def spin(self) -> Vector:
        """Angular velocity along the principal axes [rad/s]."""
        u, w, moments = self.axes, self.axis_rates, self._moments
        return [
            (moments[j] * dot(w[j], u[k]) - moments[k] * dot(w[k], u[j])) * (1.0 / self._inertia[i])
            for i, (j, k) in enumerate(PAIRS)
        ]

    def kinetic_energy(self) -> Scalar:
        """Return m c'^2 / 2 + sum of J_i u_i'^2 / 2 [J]."""
        terms = [self.mass * dot(self.centre_rate, self.centre_rate)]
        terms += [
            moment * dot(rate, rate) for moment, rate in zip(self._moments, self.axis_rates, strict=True)
        ]
        return 0.5 * sum(terms[1:], terms[0])

    def angular_velocity(self) -> Vector:
        """Return omega in the body's own frame [rad/s]."""
        spin = [[x] for x in self.spin]
        return [combine(list(enumerate(row)), spin)[0] for row in self._clean(self.principal)]

    def components(self, vector: Vector) -> Vector:
        """Return the components of a vector of the world along the principal axes."""
        return [dot(axis, vector) for axis in self.axes]

    def rate_of(self, arm: Vector) -> Vector:
        """Return omega x a of a vector with these components along the principal axes, in the world."""
        return combine(list(enumerate(arm)), self.axis_rates)

    def couple(self, arm: Vector, force: Vector) -> dict[int, Vector]:
        """Return the forces on corners of a force at the place `arm` less that force at the origin [N]."""
        columns = (self.principal.T @ self.body.axis_weights).T.tolist()
        weights = [sum(w * a for w, a in zip(column, arm, strict=True)) for column in columns]
        return {
            node: [weight * f for f in force] for node, weight in zip(self.body.corner, weights, strict=True)
        }

    def accelerate(self, force: Vector, moment: Vector) -> list[Vector]:
        """Return the accelerations of the corners by a force and a moment about the centre, in the world."""
        inertia, w, m = self._inertia, self.spin, self.components(moment)
        rate = [
            (m[i] - (inertia[k] - inertia[j]) * w[j] * w[k]) * (1.0 / inertia[i])
            for i, (j, k) in enumerate(PAIRS)
        ]
        square = [x * x for x in w]
        turn: list[list[Scalar]] = [[None] * 3 for _ in range(3)]  # omega'^ + omega^ omega^
        for i, (j, k) in enumerate(PAIRS):
            turn[i][i] = -(square[j] + square[k])
            turn[j][k], turn[k][j] = w[j] * w[k] - rate[i], w[j] * w[k] + rate[i]
        bent = [combine([(row, turn[row][i]) for row in range(3)], self.axes) for i in range(3)]
        return self._spread([f * (1.0 / self.mass) for f in force], bent)

    def _spread(self, centre: Vector, axes: list[Vector]) -> list[Vector]:
        """Return the vectors of the corners that `_split` takes apart."""
        z, height = float(self._corner[0, 0]), float(self._corner[3, 0])
        low, middle, high = axes
        base = [x + z * u for x, u in zip(centre, low, strict=True)]
        rise = [float(self._corner[0, 2]) * u for u in high]
        side = [float(self._corner[2, 1]) * u for u in middle]
        foot = [x - y / 2.0 for x, y in zip(base, rise, strict=True)]
        return [
            [x + y for x, y in zip(base, rise, strict=True)],
            [x - y for x, y in zip(foot, side, strict=True)],
            [x + y for x, y in zip(foot, side, strict=True)],
            [x + height * u for x, u in zip(centre, low, strict=True)],
        ]

    def straighten(self) -> list[Vector]:
        """Return the corners with the axes at right angles, near those that are nearest by masses [m].

        In two steps: a unit of length is missed by u_a (1 - u_a . u_a) / 2, a right angle by the share of
        u_a . u_b that each moment leaves to the other axis. As changes, which are small: products with
        constants would round places the same way at each step.
        """
        axes, changes, moments = self.axes, [], self._moments
        for _ in range(2):
            table = [[dot(a, b) for b in axes] for a in axes]
            for i, (j, k) in enumerate(PAIRS):
                angle = table[j][k] * (-1.0 / self._inertia[i])
                table[i][i] = 0.5 - 0.5 * table[i][i]
                table[j][k], table[k][j] = moments[k] * angle, moments[j] * angle
            changes.append([combine(list(enumerate(row)), axes) for row in table])
            axes = [add_vectors(pair) for pair in zip(axes, changes[-1], strict=True)]
        moved = self._spread([ca.SX(0.0)] * 3, [add_vectors(pair) for pair in zip(*changes, strict=True)])
        return [add_vectors(pair) for pair in zip(self.corners, moved, strict=True)]

    def straighten_velocity(self) -> list[Vector]:
        """Return the velocities of the corners that keep the edges, of equal momenta [m/s].

        As changes, which are small: products with constants would round the spin the same way at each step.
        """
        u, w, moments = self.axes, self.axis_rates, self._moments
        change = [[(-dot(a, b), a)] for a, b in zip(u, w, strict=True)]
        for i, (j, k) in enumerate(PAIRS):
            bend = (dot(w[j], u[k]) + dot(w[k], u[j])) * (-1.0 / self._inertia[i])
            change[j].append((moments[k] * bend, u[k]))
            change[k].append((moments[j] * bend, u[j]))
        moved = self._spread(
            [ca.SX(0.0)] * 3, [add_vectors([[x * c for c in v] for x, v in row]) for row in change]
        )
        return [add_vectors(pair) for pair in zip(self.corner_rates, moved, strict=True)]


def build_body_quantities(frames: list[BodyFrame]) -> Mapping[str, Callable[[], ca.SX]]:
    """Return the builders of positions, axes and their rates of bodies, none without bodies."""

    def stack(vectors: Callable[[BodyFrame], list[Scalar]]) -> Callable[[], ca.SX]:
        return lambda: ca.horzcat(*[ca.vertcat(*vectors(frame)) for frame in frames])

    def rotation(frame: BodyFrame) -> Vector:
        axes = frame.frame_axes()
        return [axis[row] for row in range(3) for axis in axes]

    if not frames:
        return {}
    return {
        "body_position": stack(lambda frame: frame.centre),
        "body_velocity": stack(lambda frame: frame.centre_rate),
        "body_axes": stack(rotation),
        "body_angular_velocity": stack(BodyFrame.angular_velocity),
    }
