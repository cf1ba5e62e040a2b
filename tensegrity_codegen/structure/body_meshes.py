"""Surfaces of rigid bodies for pictures: triangles whose corners move with the nodes that carry a body."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.structure.free_bodies import BodyPart, FreeBody
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.body_places import CORNERS

SIDES, RINGS = 20, 5  # of round parts: around, and from the pole of a ball to its equator
LONGEST = 12  # bands of a cylinder, at most
THIN = 0.012  # radius of lines of bodies without parts, over the distance of their farthest point


@dataclass(frozen=True)
class BodyMesh:
    """Triangles on the surfaces of several bodies.

    first (n,): index of the first of the four nodes that carry each vertex; place, normal (n, 4): their
    weights in its position and in its unit normal; triangle (m, 3): vertices, counter-clockwise from outside.
    """

    first: IntArray
    place: FloatArray
    normal: FloatArray
    triangle: IntArray

    def compute_places(self, position: FloatArray) -> FloatArray:
        """Return the vertices (n, 3) [m] at positions of nodes (n_nodes, 3) [m]."""
        corner = position[self.first[:, None] + np.arange(CORNERS)]
        places: FloatArray = np.einsum("vk,vkx->vx", self.place, corner)
        return places


def build_mesh(bodies: Sequence[FreeBody]) -> BodyMesh:
    """Return the surfaces of the parts of bodies, without parts those of lines from centres to points."""
    first, places, normals, triangles, count = [], [], [], [], 0
    for body in bodies:
        for part in body.parts or _line_to_points(body):
            along, across, faces = _SURFACES[part.kind](part.size)
            spots, directions = part.position + along @ part.axes.T, across @ part.axes.T
            first.append(np.full(len(spots), body.corner[0]))
            places.append(body.weights(spots))
            normals.append(directions @ body.axis_weights)
            triangles.append(faces + count)
            count += len(spots)
    if not count:
        return BodyMesh(
            np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros((0, 3), int)
        )
    joined = (np.concatenate(arrays) for arrays in (first, places, normals, triangles))
    return BodyMesh(*joined)


def _line_to_points(body: FreeBody) -> list[BodyPart]:
    """Return capsules from the centre of a body to its points, and the balls about these."""
    way = body.point_local - body.centre
    length = np.linalg.norm(way, axis=1)
    radius = THIN * float(length.max(initial=0.0))
    balls = zip(body.point_local, body.point_radius, strict=True)
    parts = [BodyPart("ball", (float(size),), place, np.eye(3)) for place, size in balls if size > 0]
    for step, size in zip(way, length.tolist(), strict=True):
        if size > 0:
            parts.append(
                BodyPart("capsule", (radius, size), body.centre + step / 2, frame_along(step / size))
            )
    return parts


def frame_along(direction: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) whose third column is the direction: about y, then about z."""
    pitch = np.arctan2(np.hypot(direction[0], direction[1]), direction[2])
    yaw = np.arctan2(direction[1], direction[0])
    (c, s), (cy, sy) = (np.cos(pitch), np.sin(pitch)), (np.cos(yaw), np.sin(yaw))
    return np.array([[cy * c, -sy, cy * s], [sy * c, cy, sy * s], [-s, 0.0, c]])


def _revolve(profile: Sequence[Sequence[float]]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the surface of a profile that turns about z: rows of radius, height, and normal of both."""
    rows = np.array(profile)
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def turn(radius: FloatArray, height: FloatArray) -> FloatArray:
        flat = radius[:, None, None] * around
        return np.concatenate([flat, np.broadcast_to(height[:, None, None], (*flat.shape[:2], 1))], axis=2)

    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = []
    for level in range(len(rows) - 1):
        low, high = level * SIDES, (level + 1) * SIDES
        if (rows[level, :2] != rows[level + 1, :2]).any():
            if rows[level, 0] > 0:
                faces.append(np.stack([low + k, low + after, high + after], axis=1))
            if rows[level + 1, 0] > 0:
                faces.append(np.stack([low + k, high + after, high + k], axis=1))
    spots, normals = turn(rows[:, 0], rows[:, 1]), turn(rows[:, 2], rows[:, 3])
    return spots.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(faces)


def _arc(radius: float, height: float, start: int, end: int) -> list[list[float]]:
    """Return the profile of a part of a ball about (0, height), between numbers of rings from the equator."""
    angle = np.pi / 2.0 * np.arange(start, end + 1) / RINGS
    c, s = np.cos(angle), np.sin(angle)
    c[np.abs(np.arange(start, end + 1)) == RINGS] = 0.0
    return [[radius * x, height + radius * y, x, y] for x, y in zip(c.tolist(), s.tolist(), strict=True)]


def _side(radius: float, length: float) -> list[list[float]]:
    """Return the profile of a mantle, in bands that are short enough to be nearer or farther as a whole."""
    bands = int(np.clip(length / (4.0 * radius), 1, LONGEST))
    heights = np.linspace(-length / 2.0, length / 2.0, bands + 1).tolist()
    return [[radius, height, 1.0, 0.0] for height in heights]


def _cylinder(radius: float, length: float, inner: float = 0.0) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the surface of a cylinder or tube about z."""
    low, high = -length / 2.0, length / 2.0
    rows = [[inner, low, 0, -1], [radius, low, 0, -1], *_side(radius, length)]
    rows += [[radius, high, 0, 1], [inner, high, 0, 1]]
    return _revolve(rows + ([[inner, high, -1, 0], [inner, low, -1, 0]] if inner else []))


def _box(size: Sequence[float]) -> tuple[FloatArray, FloatArray, IntArray]:
    spots, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            square = np.zeros((4, 3))
            square[:, axis], normal = sign, sign * np.eye(3)[axis]
            square[:, a], square[:, b] = [-1, sign, 1, -sign], [-1, -sign, 1, sign]
            spots.append(square * np.array(size) / 2.0)
            normals.append(np.tile(normal, (4, 1)))
    faces = 4 * np.arange(6)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return np.concatenate(spots), np.concatenate(normals), faces.reshape(-1, 3)


_SURFACES: Mapping[str, Callable[[Sequence[float]], tuple[FloatArray, FloatArray, IntArray]]] = {
    "ball": lambda size: _revolve(_arc(size[0], 0.0, -RINGS, RINGS)),
    "box": _box,
    "cylinder": lambda size: _cylinder(*size),
    "tube": lambda size: _cylinder(size[0], size[2], size[1]),
    "capsule": lambda size: _revolve(
        [*_arc(size[0], -size[1] / 2.0, -RINGS, 0), *_side(*size), *_arc(size[0], size[1] / 2.0, 0, RINGS)]
    ),
}
