"""Shape parameters: functions of node positions that describe the shape of a structure.

Positions are (n_nodes, 3) [m]; angles are in degrees. The base of a function is a set of three or more nodes;
its normal is that of the plane of least squares, on the side of the top.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Shape",
    "build_edge_distance",
    "build_height",
    "build_rotation",
    "build_tilt",
    "build_twist",
    "compute_normal",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Shape = Callable[[FloatArray], FloatArray]

TINY = 1e-9  # angle [rad] below which its series is used


def compute_normal(points: FloatArray, towards: FloatArray) -> FloatArray:
    """Return the unit normal of the plane of least squares of points (n, 3), on the side of a vector."""
    local = points - points.mean(axis=0)
    normal: FloatArray = np.linalg.svd(local)[2][-1]
    return normal if normal @ towards >= 0 else -normal


def build_height(top: IntArray, base: IntArray) -> Shape:
    """Return the function for the distance of the centre of `top` from the plane of `base` [m]."""

    def height(position: FloatArray) -> FloatArray:
        between = position[top].mean(axis=0) - position[base].mean(axis=0)
        return np.array([compute_normal(position[base], between) @ between])

    return height


def build_twist(top: IntArray, base: IntArray) -> Shape:
    """Return the function for the angle from `base` to `top` about the base's normal [deg], node by node.

    Of each pair of nodes, the angle between their radii about the centres of their sets, in the plane of
    the base; the pairs count by the product of their radii.
    """

    def twist(position: FloatArray) -> FloatArray:
        lower, upper = (position[nodes] - position[nodes].mean(axis=0) for nodes in (base, top))
        between = position[top].mean(axis=0) - position[base].mean(axis=0)
        normal = compute_normal(position[base], between)
        turned = float(np.cross(lower, upper).sum(axis=0) @ normal)
        along = float((lower * upper).sum() - (lower @ normal) @ (upper @ normal))
        return np.array([np.degrees(np.arctan2(turned, along))])

    return twist


def build_tilt(top: IntArray, base: IntArray) -> Shape:
    """Return the function for the two angles by which the plane of `top` leans against that of `base` [deg].

    The normal of the top leans by the first angle towards the first node of the base (seen from the base's
    centre), and by the second one a right angle further, anticlockwise about the base's normal.
    """

    def tilt(position: FloatArray) -> FloatArray:
        centre = position[base].mean(axis=0)
        between = position[top].mean(axis=0) - centre
        normal, leaning = (compute_normal(position[nodes], between) for nodes in (base, top))
        first = position[base[0]] - centre
        first = first - normal * (first @ normal)
        first /= np.linalg.norm(first)
        part = np.array([leaning @ first, leaning @ np.cross(normal, first)])
        size = float(np.linalg.norm(part))
        angle = float(np.arctan2(size, leaning @ normal))
        return np.degrees(part * (angle / size if size > TINY else 1.0))

    return tilt


def build_rotation(nodes: IntArray, start: FloatArray, base: IntArray | None = None) -> Shape:
    """Return the function for the rotation vector of `nodes` since the start [deg], in the scene's axes.

    The rotation of least squares (W. Kabsch, "A solution for the best rotation to relate two sets of
    vectors", Acta Crystallographica A 32, 1976); with a base, relative to the rotation of the base.
    """

    def rotation(position: FloatArray) -> FloatArray:
        turned = _find_rotation(start[nodes], position[nodes])
        if base is not None:
            turned = _find_rotation(start[base], position[base]).T @ turned
        return np.degrees(_rotation_vector(turned))

    return rotation


def build_edge_distance(
    weight: FloatArray, edge: tuple[int, int], up: FloatArray, start: FloatArray
) -> Shape:
    """Return the function for the horizontal distance of the centre of mass past a line of two nodes [m].

    weight: (n_nodes,), parts of the mass, sum 1. up: (3,) unit vector. Negative on the side of the start.
    """

    def distance(position: FloatArray) -> FloatArray:
        first, second = position[edge[0]], position[edge[1]]
        outward = np.cross(second - first, up)
        return np.array([(weight @ (position - first)) @ outward / np.linalg.norm(outward)])

    sign = -1.0 if distance(start)[0] > 0 else 1.0
    return lambda position: sign * distance(position)


def _find_rotation(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the rotation matrix (3, 3) that takes points (n, 3) nearest to others."""
    covariance = (before - before.mean(axis=0)).T @ (after - after.mean(axis=0))
    left, _, right = np.linalg.svd(covariance)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation: FloatArray = (right.T * handed) @ left.T
    return rotation


def _rotation_vector(matrix: FloatArray) -> FloatArray:
    """Return the rotation vector [rad] of a rotation matrix."""
    skew = (
        np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
    )
    sine, cosine = float(np.linalg.norm(skew)), (float(np.trace(matrix)) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    return skew * (angle / sine if sine > TINY else 1.0)
