"""Rigid bodies: rods that share points, directly or through others, move as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["find_bodies", "is_flat"]

Position = tuple[float, float, float]


def find_bodies(rods: Sequence[tuple[Position, Position]]) -> list[list[Position]]:
    """Return the points of each rigid body, bodies and points in the order of the rods."""
    parent: dict[Position, Position] = {}

    def root(point: Position) -> Position:
        parent.setdefault(point, point)
        while parent[point] != point:
            parent[point] = parent[parent[point]]
            point = parent[point]
        return point

    for first, second in rods:
        parent[root(second)] = root(first)
    bodies: dict[Position, list[Position]] = {}
    for point in list(parent):
        bodies.setdefault(root(point), []).append(point)
    return list(bodies.values())


def is_flat(points: NDArray[np.float64]) -> bool:
    """Return whether more than three points (n, 3) lie in a plane, or three on a line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    dimension = int(np.sum(spread > 1e-9 * spread[0]))
    return dimension < min(3, len(points) - 1)
