"""Bonds of the kind node_edge: a structure is moved until its nodes meet edges of another, and joined there.

After NTRTsim (Apache-2.0), src/yamlbuilder/TensegrityModel, addNodeEdgePairs: the second structure is turned
until the planes through the first three points of both sides agree, moved until the centroids of all points
agree, and turned in that plane until the first points lie in one direction; an edge counts as its middle.
Each edge is then replaced by two pairs that lead from its ends to the node, and pairs between nodes of the
bond are removed; rods stay.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tensegrity_codegen.scene.formats.ntrt.file import parse_pair
from tensegrity_codegen.scene.formats.ntrt.structure import NtrtNode, NtrtPair, NtrtStructure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, StructureError

IsRod = Callable[[NtrtPair, str], bool]  # of a pair and the name of the structure that owns it

_FEWEST = 3
_OPPOSITE = 1e-5  # unit vectors a and b count as opposite below this |a + b|, as in the toolkit
_ON_A_LINE = 1e-9  # sine of the angle at the first of three points


@dataclass
class _Bond:
    """What the pairs of one bond state: nodes, the edges they meet, and the points of both structures."""

    nodes: list[NtrtNode] = field(default_factory=list)
    edges: list[tuple[NtrtNode, NtrtNode]] = field(default_factory=list)
    points: tuple[list[FloatArray], list[FloatArray]] = field(default_factory=lambda: ([], []))


def bond_nodes_to_edges(
    sides: tuple[NtrtStructure, NtrtStructure], pairs: Any, is_rod: IsRod, where: str
) -> list[tuple[NtrtNode, NtrtNode, str]]:
    """Move the second of `sides` to the first, remove the pairs that the bond replaces, return the new ones.

    pairs: list of [node, "node/node"] or ["node/node", node], the first of each in the first structure.
    A new pair is (node, node, place in the file). Raises InvalidValueError, UnknownNameError or
    StructureError that names the place.
    """
    if not isinstance(pairs, list) or len(pairs) < _FEWEST:
        raise InvalidValueError(
            "a node_edge bond of fewer than three pairs",
            where=where,
            given=len(pairs) if isinstance(pairs, list) else None,
            allowed="a list of three or more [node, node/node]",
        )
    bond = _read(sides, pairs, where)
    _move(sides[1], np.array(bond.points[0]), np.array(bond.points[1]), where)
    _remove_pairs(sides, bond, is_rod, where)
    return [
        new
        for number, (node, (first, second)) in enumerate(zip(bond.nodes, bond.edges, strict=True))
        for new in ((first, node, f"{where}[{number}]"), (node, second, f"{where}[{number}]"))
    ]


def _read(sides: tuple[NtrtStructure, NtrtStructure], pairs: Sequence[Any], where: str) -> _Bond:
    bond = _Bond()
    for number, value in enumerate(pairs):
        place = f"{where}[{number}]"
        names = parse_pair(value, place)
        if sum("/" in name for name in names) != 1:
            problem = "not a bond of a node and an edge"
            allowed = "one node and one edge: [node, node/node] or [node/node, node]"
            raise InvalidValueError(problem, where=place, given=f"{names[0]}, {names[1]}", allowed=allowed)
        for structure, name, points in zip(sides, names, bond.points, strict=True):
            ends = [structure.find_node(part, place) for part in name.split("/", 1)]
            points.append(np.mean([node.position for node in ends], axis=0))
            if len(ends) == 1:
                bond.nodes.append(ends[0])
            else:
                bond.edges.append((ends[0], ends[1]))
    return bond


def _move(child: NtrtStructure, target: FloatArray, points: FloatArray, where: str) -> None:
    """Move `child` so that its `points` (n, 3) come to lie at `target` (n, 3), as the toolkit does it."""
    normals = [_normal(side, where) for side in (points, target)]
    first = _turn(normals[0], normals[1], points[1] - points[0])
    middle, center = points.mean(axis=0), target.mean(axis=0)
    arms = (first @ (points[0] - middle), target[0] - center)
    if not all(np.linalg.norm(arm) > 0 for arm in arms):
        problem = "the first point of the bond is the centroid of all its points, so no direction is stated"
        allowed = "a first pair away from the centroid"
        raise StructureError(problem, where=where, allowed=allowed, hint="put another pair first")
    turn = _turn(arms[0], arms[1], normals[1]) @ first
    child.transform(lambda point: center + turn @ (point - middle))


def _normal(points: FloatArray, where: str) -> FloatArray:
    """Return the unit normal of the plane through the first three points."""
    one, other = points[1] - points[0], points[2] - points[0]
    normal: FloatArray = np.cross(one, other)
    length = float(np.linalg.norm(normal))
    if not length > _ON_A_LINE * float(np.linalg.norm(one) * np.linalg.norm(other)):
        problem = "the first three points of the bond lie on a line, so no plane is stated"
        allowed = "three points that span a triangle, in both structures"
        raise StructureError(problem, where=where, allowed=allowed, hint="put another pair first")
    return normal / length


def _turn(start: FloatArray, end: FloatArray, fallback: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that turns `start` into the direction of `end`.

    fallback: the axis where the two are opposite.
    """
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    angle = math.atan2(float(np.linalg.norm(axis)), float(a @ b))
    if np.linalg.norm(a + b) < _OPPOSITE:
        axis, angle = fallback, math.pi
    length = float(np.linalg.norm(axis))
    if length == 0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned: FloatArray = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return turned


def _remove_pairs(sides: tuple[NtrtStructure, NtrtStructure], bond: _Bond, is_rod: IsRod, where: str) -> None:
    """Remove the edges of the bond and the cables between its nodes from both structures."""
    edges = {_places(ends) for ends in bond.edges}
    nodes = {_place(node) for node in bond.nodes}
    for structure in (item for side in sides for item in side.walk()):
        kept = []
        for pair in structure.pairs:
            ends = _places(pair.ends)
            if ends not in edges and not ends <= nodes:
                kept.append(pair)
            elif is_rod(pair, structure.name):
                if ends in edges:
                    raise StructureError(
                        "the edge of a node_edge bond is a rod",
                        where=where,
                        given=f"{pair.ends[0].path}/{pair.ends[1].path}",
                        allowed="edges that are cables: the bond replaces each by two",
                    )
                kept.append(pair)
        structure.pairs[:] = kept


def _place(node: NtrtNode) -> tuple[float, ...]:
    return tuple(node.position.tolist())


def _places(ends: tuple[NtrtNode, NtrtNode]) -> frozenset[tuple[float, ...]]:
    return frozenset(_place(node) for node in ends)
