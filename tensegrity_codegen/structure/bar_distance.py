"""Distances between the bars of a structure where it is stated, in closed form."""

import numpy as np

from tensegrity_codegen.structure.bodies import Bar, BodySystem
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

PARALLEL = 1e-12  # of the product of squared lengths, below which two lines count as parallel


def compute_bar_distance(subject: Structure | BodySystem) -> tuple[tuple[tuple[str, str], ...], FloatArray]:
    """Return the names of the pairs of bars and the distances [m] of their surfaces, bars with round ends.

    The pairs are those of `bar_pairs`; the distance of bars that overlap is negative.
    """
    pairs = subject.bar_pairs
    if isinstance(subject, Structure):
        name, position = subject.member_name, subject.node_position
        ends, radius = subject.connectivity[pairs], subject.radius[pairs]
    else:
        position = compute_node_position(subject)
        name = tuple(body.name for body in subject.bodies)
        radii = [body.radius if isinstance(body, Bar) else 0.0 for body in subject.bodies]
        ends = np.array([[subject.bar_ends(int(k)) for k in pair] for pair in pairs], dtype=np.int64)
        ends, radius = ends.reshape(-1, 2, 2), np.array(radii)[pairs]
    end = position[ends]
    distance = compute_segment_distance(end[:, 0, 0], end[:, 0, 1], end[:, 1, 0], end[:, 1, 1])
    return tuple((name[i], name[j]) for i, j in pairs.tolist()), distance - radius.sum(axis=1)


def compute_segment_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances of segments a-b and c-d, each (n, 3) [m], (n,) [m].

    The least of the distances of each end to the other segment, and of the two lines where the feet of their
    common perpendicular are inside both segments.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    to_other = [_to_segment(point, c, d) for point in (a, b)] + [_to_segment(point, a, b) for point in (c, d)]
    distance: FloatArray = np.min(to_other, axis=0)
    determinant = uu * vv - uv * uv
    crossing = determinant > PARALLEL * uu * vv
    safe = np.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = crossing & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    gap = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.where(inside, np.minimum(gap, distance), distance)


def _to_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distances of points to segments, (n,)."""
    along = end - start
    square = np.einsum("ij,ij->i", along, along)
    fraction = np.einsum("ij,ij->i", point - start, along) / np.where(square > 0, square, 1.0)
    nearest = start + np.clip(fraction, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))
