"""Rigid bodies by the nodes that carry them: what results need to place points, axes and spins."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray, IntArray

CORNERS, EDGES = 4, 6  # of a body: the last nodes of a structure, body by body, and its last members


@dataclass(frozen=True)
class BodyPlace:
    """A rigid body by its four corners, which are nodes, and its points, nodes that move with them.

    name: of the body; corner: indices of the corners; centre: their weights in the centre of mass; axes:
    their weights in each unit vector of the frame, (3, 4) [1/m]; point: indices of the points; weights: of
    the corners in each point, (n_points, 4).
    """

    name: str
    corner: tuple[int, ...]
    centre: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]
    point: tuple[int, ...]
    weights: tuple[tuple[float, ...], ...]

    def attach(self, vectors: FloatArray) -> None:
        """Put the combinations of corners into the rows of points of (..., n_nodes, 3), in place."""
        if self.point:
            vectors[..., list(self.point), :] = np.array(self.weights) @ vectors[..., list(self.corner), :]

    def gather(self, forces: FloatArray) -> None:
        """Add the forces on points to those on corners of (..., n_nodes, 3), in place [N]."""
        if self.point:
            forces[..., list(self.corner), :] += np.array(self.weights).T @ forces[..., list(self.point), :]

    def touch(self, node: int, arm: FloatArray, position: FloatArray) -> FloatArray:
        """Return the weights of the corners, (4,), at a point and an arm (3,) [m] from it in the world."""
        own = self.frame(position).T @ arm
        return np.asarray(np.array(self.weights[self.point.index(node)]) + own @ np.array(self.axes))

    def frame(self, vectors: FloatArray) -> FloatArray:
        """Return the combinations of corners for the unit vectors, as columns (..., 3, 3)."""
        return np.swapaxes(np.array(self.axes) @ vectors[..., list(self.corner), :], -1, -2)


def show_nodes(names: Sequence[str], bodies: Sequence[BodyPlace]) -> Sequence[str]:
    """Return the names of nodes without corners."""
    return names[: len(names) - CORNERS * len(bodies)]


def show_members(names: Sequence[str], bodies: Sequence[BodyPlace]) -> Sequence[str]:
    """Return the names of members without edges."""
    return names[: len(names) - EDGES * len(bodies)]


def label_nodes(names: Sequence[str], bodies: Sequence[BodyPlace]) -> tuple[str, ...]:
    """Return the names of nodes for texts: a corner goes by the name of its body."""
    body = {node: entry.name for entry in bodies for node in entry.corner}
    return tuple(body.get(node, name) for node, name in enumerate(names))


def find_shown(count: int, bodies: Sequence[BodyPlace]) -> NDArray[np.bool_]:
    """Return which of `count` nodes texts show, (n_nodes,): corners only of bodies without points."""
    shown = np.ones(count, dtype=np.bool_)
    shown[[node for body in bodies if body.point for node in body.corner]] = False
    return shown


def list_node_motions(place: IntArray, bodies: Sequence[BodyPlace]) -> tuple[IntArray, IntArray, FloatArray]:
    """Return rows, columns and values of the matrix from coordinates to nodes, (3 n_nodes, n_coordinates).

    place (n_coordinates, 2): node and axis of each coordinate. Points of bodies move as their corners do.
    """
    count = np.arange(len(place))
    rows, columns, values = [3 * place[:, 0] + place[:, 1]], [count], [np.ones(len(place))]
    for body in bodies:
        index = np.array([np.flatnonzero(place[:, 0] == node) for node in body.corner])  # (4, 3)
        for node, weights in zip(body.point, body.weights, strict=True):
            chosen = np.flatnonzero(weights)
            rows.append(np.tile(3 * node + np.arange(3), len(chosen)))
            columns.append(index[chosen].ravel())
            values.append(np.repeat(np.array(weights)[chosen], 3))
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


def join_bodies(ends: IntArray, bodies: Sequence[BodyPlace]) -> IntArray:
    """Return pairs of nodes that move together: `ends` (n, 2), and the nodes of each body with its first."""
    links = [(body.corner[0], node) for body in bodies for node in (*body.corner[1:], *body.point)]
    return np.concatenate([ends, np.array(links, dtype=np.int64).reshape(-1, 2)])


def place_bodies(bodies: Sequence[BodyPlace], position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return centres of mass (..., n_bodies, 3) [m] and axes (..., n_bodies, 3, 3) at positions of nodes.

    position: (..., n_nodes, 3) [m]. The columns of axes are the unit vectors of each frame.
    """
    centre = [np.array(body.centre) @ position[..., list(body.corner), :] for body in bodies]
    return np.stack(centre, axis=-2), np.stack([body.frame(position) for body in bodies], axis=-3)


def compute_spins(bodies: Sequence[BodyPlace], position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the angular velocities in the frames, (..., n_bodies, 3) [rad/s], of motions of nodes.

    position, velocity: (..., n_nodes, 3) [m, m/s]. The spin is the axis of R^T R'.
    """
    spins = []
    for body in bodies:
        turn = np.swapaxes(body.frame(position), -1, -2) @ body.frame(velocity)
        pairs = ((2, 1), (0, 2), (1, 0))
        spins.append(np.stack([(turn[..., i, j] - turn[..., j, i]) / 2.0 for i, j in pairs], axis=-1))
    return np.stack(spins, axis=-2)
