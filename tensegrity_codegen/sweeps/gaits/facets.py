"""Facets on which a structure can stand, its symmetries, and the way from facet to facet over an edge."""

from itertools import permutations
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray

TOLERANCE = 0.1  # of the size: how far nodes of a structure that its weight deforms are from symmetric
LEVEL = 0.02  # of the size: largest difference of heights of the nodes that it stands on
Facet = tuple[int, ...]
Step = tuple[Facet, Facet]  # from one facet to the next


class Facets:
    """Triangles of the convex hull of a structure at rest, and the permutations of its nodes by symmetry.

    facet: nodes of each triangle, in rising order; symmetry (n_nodes,): node k takes the place of node
    symmetry[s][k]; mirror images are among them, and the first one leaves all nodes where they are.
    """

    def __init__(self, structure: Structure, winches: list[int]) -> None:
        """winches: members that have one; symmetries leave them among each other."""
        self.position, self._ends = structure.node_position, structure.connectivity
        self.size = float(np.ptp(self.position, axis=0).max())
        self.facet = tuple(_sort(row) for row in scipy.spatial.ConvexHull(self.position).simplices)
        self._member = {frozenset(ends): e for e, ends in enumerate(self._ends.tolist())}
        is_wound = np.isin(np.arange(len(self._ends)), winches)
        self._kind = np.stack([structure.mu, structure.rest_length, structure.tension_only, is_wound], axis=1)
        self.symmetry = tuple(self._find_symmetries())

    def find_standing(self, position: FloatArray) -> Facet | None:
        """Return the facet of the three lowest of the nodes (n_nodes, 3), None where it leans on others."""
        lowest = _sort(position[:, 2].argsort()[:3])
        is_level = np.ptp(position[list(lowest), 2]) < LEVEL * self.size
        return lowest if lowest in self.facet and is_level else None

    def list_next(self, facet: Facet) -> list[Facet]:
        """Return the facets beyond the three edges of a facet."""
        return [one for one in self.facet if len(set(one) & set(facet)) == 2]

    def turn_over(self, position: FloatArray, step: Step) -> FloatArray:
        """Return the positions (n_nodes, 3) after a rigid roll from one facet over an edge to the next."""
        facet, target = map(set, step)
        first, second = sorted(facet & target)
        (behind,), (ahead,) = facet - target, target - facet
        origin, axis = position[first], position[second] - position[first]
        axis = axis / np.linalg.norm(axis)
        back, front = (_find_across(position[k] - origin, axis) for k in (behind, ahead))
        # The angle from the node ahead to where the ground goes on beyond the edge
        angle = np.arctan2(np.cross(front, -back) @ axis, -(front @ back))
        turn = scipy.spatial.transform.Rotation.from_rotvec(angle * axis)
        turned: FloatArray = origin + turn.apply(position - origin)
        return turned

    def find_symmetry(self, step: Step, other: Step) -> IntArray | None:
        """Return a symmetry that takes one roll into another, None where there is none."""
        for row in self.symmetry:
            if all(_sort(row[list(own)]) == wanted for own, wanted in zip(step, other, strict=True)):
                return row
        return None

    def map_members(self, symmetry: IntArray) -> list[int]:
        """Return the member whose place each member takes."""
        return [self._member[frozenset(ends)] for ends in symmetry[self._ends].tolist()]

    def _find_symmetries(self) -> list[IntArray]:
        """Lay the structure with its first facet on each facet in six ways; keep those that fit."""
        found = [np.arange(len(self.position))]
        origin, axes = self._find_frame(self.facet[0])
        own = (self.position - origin) @ axes.T
        for nodes in (order for facet in self.facet for order in permutations(facet)):
            origin, axes = self._find_frame(nodes)
            distance = np.linalg.norm((own @ axes + origin)[:, None] - self.position, axis=2)
            row = distance.argmin(axis=1)
            is_near = distance.min(axis=1).max() < TOLERANCE * self.size and len(set(row)) == len(row)
            ends = [frozenset(pair) for pair in row[self._ends].tolist()]
            if not is_near or (row == found[0]).all() or not all(pair in self._member for pair in ends):
                continue
            if np.allclose(self._kind[self.map_members(row)], self._kind, rtol=1e-3):
                found.append(row)
        return found

    def _find_frame(self, nodes: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return centre and axes (3, 3), one a row: along the first edge, to the third node, outwards."""
        a, b, c = self.position[list(nodes)]
        along = (b - a) / np.linalg.norm(b - a)
        aside = _find_across(c - a, along)
        aside = aside / np.linalg.norm(aside)
        outwards = np.cross(along, aside)
        outwards = outwards * np.sign(outwards @ (a - self.position.mean(axis=0)))
        return (a + b + c) / 3, np.stack([along, aside, outwards])


def _sort(nodes: Any) -> Facet:
    return tuple(sorted(int(k) for k in nodes))


def _find_across(vector: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the part of a vector across a unit vector."""
    return vector - (vector @ axis) * axis
