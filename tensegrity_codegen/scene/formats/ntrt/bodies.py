"""Rigid bodies: rods that share points, directly or through others, move as one; what keeps their shape."""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Position = tuple[float, float, float]
Pair = tuple[Position, Position]

# Parts of a bar's direction that the bars before it leave free, for three rounds of choosing.
_INDEPENDENT = (0.1, 1e-3, 1e-6)


def find_bodies(rods: Sequence[Pair], points: Iterable[Position] = ()) -> list[list[Position]]:
    """Return the points of each rigid body, bodies and points in the order of the rods, then of `points`."""
    parent: dict[Position, Position] = {}

    def root(point: Position) -> Position:
        parent.setdefault(point, point)
        while parent[point] != point:
            parent[point] = parent[parent[point]]
            point = parent[point]
        return point

    for first, second in rods:
        parent[root(second)] = root(first)
    for point in points:
        root(point)
    bodies: dict[Position, list[Position]] = {}
    for point in list(parent):
        bodies.setdefault(root(point), []).append(point)
    return list(bodies.values())


def is_flat(points: NDArray[np.float64]) -> bool:
    """Return whether more than three points (n, 3) lie in a plane, or three on a line."""
    return find_dimension(points) < min(3, len(points) - 1)


def find_dimension(points: NDArray[np.float64]) -> int:
    """Return the dimension of what points (n, 3) span: 0 a point, 1 a line, 2 a plane, 3 space."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return int(np.sum(spread > 1e-9 * spread[0]))


def find_rigid_pairs(points: Sequence[Position], rods: Sequence[Pair]) -> list[Pair]:
    """Return pairs of `points` that bars of fixed length can join, so that none follows from the others.

    Rods come first, then other pairs, until the body keeps its shape to first order (a flat one: in its
    plane) or no pair is left. A rod that is not among them follows from the others.
    """
    row = {point: number for number, point in enumerate(points)}
    place = np.array(points, dtype=np.float64)
    joined = {frozenset(rod) for rod in rods}
    others = [pair for pair in itertools.combinations(points, 2) if frozenset(pair) not in joined]
    dimension = find_dimension(place)
    most = dimension * len(points) - dimension * (dimension + 1) // 2
    basis = np.zeros((0, 3 * len(points)))
    found: dict[Pair, None] = {}
    for least, pair in itertools.product(_INDEPENDENT, (*rods, *others)):
        if len(found) == most:
            break
        if pair in found:
            continue
        direction = _direction(place, row[pair[0]], row[pair[1]])
        for _ in range(2):  # twice is enough
            direction = direction - basis.T @ (basis @ direction)
        size = float(np.linalg.norm(direction))
        if size > least:
            basis = np.vstack([basis, direction / size])
            found[pair] = None
    return list(found)


def _direction(place: NDArray[np.float64], i: int, j: int) -> NDArray[np.float64]:
    """Return the unit change of all coordinates (3 n,) that lengthens the pair most."""
    arm = place[i] - place[j]
    direction = np.zeros(place.shape)
    direction[i], direction[j] = arm, -arm
    unit: NDArray[np.float64] = (direction / np.linalg.norm(direction)).ravel()
    return unit
