"""Shape parameters: functions of node positions that describe the shape of a structure.

Positions are (n_nodes, 3) [m]; angles are in degrees. The base of a function is a set of three or more nodes;
its normal is that of the plane of least squares. At the start normals point to the side of the top, and they
keep that side: where the structure bends, the centre line may become perpendicular to them.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from tensegrity_codegen.system.arrays import FloatArray, IntArray

Shape = Callable[[FloatArray], FloatArray]

TINY = 1e-9  # angle [rad] below which its series is used


def _build_normal(nodes: IntArray, start: FloatArray, towards: FloatArray) -> Shape:
    """Return the function for the unit normal of the plane of least squares of `nodes`.

    It is on the side of a vector at the start, and turns with the nodes since then.
    """

    def compute(position: FloatArray, side: FloatArray) -> FloatArray:
        local = position[nodes] - position[nodes].mean(axis=0)
        normal: FloatArray = np.linalg.svd(local)[2][-1]
        return normal if normal @ side >= 0 else -normal

    first = compute(start, towards)
    return lambda position: compute(position, _find_rotation(start[nodes], position[nodes]).apply(first))


def build_height(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the distance of the centre of `top` from the plane of `base`, 0 or more [m]."""
    normal = _build_normal(base, start, _find_centre_line(top, base, start))
    return lambda position: np.abs([normal(position) @ _find_centre_line(top, base, position)])


def build_twist(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the angle from `base` to `top` about the base's normal [deg], node by node.

    Of each pair of nodes, the angle between their radii about the centres of their sets, in the plane of
    the base; the pairs count by the product of their radii.
    """
    compute_normal = _build_normal(base, start, _find_centre_line(top, base, start))

    def twist(position: FloatArray) -> FloatArray:
        lower, upper = (position[nodes] - position[nodes].mean(axis=0) for nodes in (base, top))
        normal = compute_normal(position)
        turned = float(np.cross(lower, upper).sum(axis=0) @ normal)
        along = float((lower * upper).sum() - (lower @ normal) @ (upper @ normal))
        return np.array([np.degrees(np.arctan2(turned, along))])

    return twist


def build_tilt(top: IntArray, base: IntArray, start: FloatArray) -> Shape:
    """Return the function for the two angles by which the plane of `top` leans against that of `base` [deg].

    The normal of the top leans by the first angle towards the first node of the base (seen from the base's
    centre), and by the second one a right angle further, anticlockwise about the base's normal.
    """
    line = _find_centre_line(top, base, start)
    base_normal = _build_normal(base, start, line)
    # Of two sets in one plane the centre line is perpendicular to both normals: these are on the same side.
    top_normal = _build_normal(top, start, line + TINY * float(np.abs(start).max()) * base_normal(start))

    def tilt(position: FloatArray) -> FloatArray:
        normal, leaning = base_normal(position), top_normal(position)
        first = position[base[0]] - position[base].mean(axis=0)
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
            turned = _find_rotation(start[base], position[base]).inv() * turned
        return np.asarray(turned.as_rotvec(degrees=True))

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


def _find_centre_line(top: IntArray, base: IntArray, position: FloatArray) -> FloatArray:
    """Return the vector (3,) from the centre of `base` to that of `top` [m]."""
    line: FloatArray = position[top].mean(axis=0) - position[base].mean(axis=0)
    return line


def _find_rotation(before: FloatArray, after: FloatArray) -> Rotation:
    """Return the rotation that takes points (n, 3) nearest to others, about their centres."""
    found, _ = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))
    return found
