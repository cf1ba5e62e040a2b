"""Points of bodies from minimal coordinates: the same text for numbers and for symbols.

`trig` has sin and cos: the module math with numbers, casadi with symbols. A body whose anchor is a point of
another body finds that one first, whatever the order in which the scene names them.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from tensegrity_codegen.structure.bodies import Bar, BodySystem, FixedBody, RigidBody
from tensegrity_codegen.system.arrays import FloatArray

Scalar = Any
Vector = list[Scalar]


def euler_rotation(psi: Scalar, phi: Scalar, theta: Scalar, trig: Any = math) -> list[Vector]:
    """Return the 3-1-2 rotation R = R3(psi) R1(phi) R2(theta), body to inertial, row by row (SCS 3)."""
    c1, s1 = trig.cos(psi), trig.sin(psi)
    c2, s2 = trig.cos(phi), trig.sin(phi)
    c3, s3 = trig.cos(theta), trig.sin(theta)
    return [
        [c1 * c3 - s1 * s2 * s3, -s1 * c2, c1 * s3 + s1 * s2 * c3],
        [s1 * c3 + c1 * s2 * s3, c1 * c2, s1 * s3 - c1 * s2 * c3],
        [-c2 * s3, s2, c2 * c3],
    ]


def bar_direction(bar: Bar, polar: Scalar, azimuth: Scalar, trig: Any = math) -> Vector:
    """Return the unit vector from A to B in inertial axes, by the bar's chart."""
    angle = azimuth + bar.chart.offset if bar.chart.offset else azimuth
    across, along = trig.sin(polar), trig.cos(polar)
    if bar.chart.polar == "elevation":
        across, along = along, across
    result: Vector = [0.0, 0.0, 0.0]
    e1, e2, e3 = bar.chart.axes
    result[e1], result[e2], result[e3] = across * trig.cos(angle), across * trig.sin(angle), along
    return result


class Kinematics:
    """Directions, rotations and positions of a system without circles at `coordinate`, numbers or symbols."""

    def __init__(self, system: BodySystem, coordinate: Sequence[Scalar], trig: Any = math) -> None:
        self.system = system
        self._coordinate, self._trig = coordinate, trig
        self.direction = cache(self._direction)
        self.rotation = cache(self._rotation)
        self.centre = cache(self._centre)
        self.point = cache(self._point)

    def coordinate(self, body: int, label: int) -> Scalar:
        """Return one coordinate of a body; negative labels count from its last."""
        start = self.system.coordinate_start
        if label < 0:
            ends = (*start[1:], self.system.n_coordinates)
            return self._coordinate[ends[body] + label]
        return self._coordinate[start[body] + label]

    def margin(self, body: int) -> Scalar:
        """Return how far the angles of a body are from their pole: sine of that angle, zero at the pole."""
        solid = self.system.bodies[body]
        if isinstance(solid, Bar):
            polar = self.coordinate(body, -2)
            return self._trig.sin(polar) if solid.chart.polar == "declination" else self._trig.cos(polar)
        return self._trig.cos(self.coordinate(body, 1))

    def _direction(self, body: int) -> Vector:
        solid = self.system.bodies[body]
        assert isinstance(solid, Bar)
        return bar_direction(solid, self.coordinate(body, -2), self.coordinate(body, -1), self._trig)

    def _rotation(self, body: int) -> list[Vector]:
        psi, phi, theta = (self.coordinate(body, k) for k in range(3))
        return euler_rotation(psi, phi, theta, self._trig)

    def _centre(self, body: int) -> Vector:
        """Return the centre of mass of a moving body [m]."""
        solid = self.system.bodies[body]
        if isinstance(solid, RigidBody):
            return [self.coordinate(body, k) for k in (3, 4, 5)]
        assert isinstance(solid, Bar)
        if not solid.held:
            return [self.coordinate(body, k) for k in (0, 1, 2)]
        half = 0.5 * solid.length if solid.held == "A" else -0.5 * solid.length
        return _shift(self.point(solid.anchor), self.direction(body), half)

    def _point(self, node: int) -> Vector:
        """Return the position of a node [m]."""
        body = int(self.system.node_body[node])
        solid, local = self.system.bodies[body], [float(x) for x in self.system.node_local[node]]
        if isinstance(solid, FixedBody):
            return list(local)
        if isinstance(solid, RigidBody):
            return _rotate(self.centre(body), self.rotation(body), local)
        if not solid.held:
            return _shift(self.centre(body), self.direction(body), local[0])
        # From the held end, so that the held end itself is exactly the anchor.
        half = -0.5 * solid.length if solid.held == "A" else 0.5 * solid.length
        return _shift(self.point(solid.anchor), self.direction(body), local[0] - half)


def _shift(start: Vector, direction: Vector, distance: float) -> Vector:
    if distance == 0.0:
        return list(start)
    return [a + distance * u for a, u in zip(start, direction, strict=True)]


def _rotate(centre: Vector, rotation: list[Vector], local: Vector) -> Vector:
    result = list(centre)
    for row in range(3):
        for column, x in enumerate(local):
            if x:
                result[row] = result[row] + rotation[row][column] * x
    return result


def compute_node_position(system: BodySystem) -> FloatArray:
    """Return the positions of all nodes at the coordinates of the scene, (n_nodes, 3) [m]."""
    kinematics = Kinematics(system, [float(q) for q in system.coordinate])
    return np.array([kinematics.point(node) for node in range(system.n_nodes)], dtype=float).reshape(-1, 3)
