"""Pairs of nodes as a graph, axis by axis: what is a coordinate, how nodes follow from the pairs.

A pair (i, j) stands for the component r_i - r_j along the axis. It is a coordinate unless both nodes are
anchored there. A spanning forest of the moving pairs leads from roots to every other node: anchored nodes
are roots; a part of the structure that no anchor holds has one root of its own and floats.
"""

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure


@dataclass(frozen=True)
class Pairs:
    """Pairs of nodes in the order of the coordinates: actuated members first, in the order of the inputs.

    ends: (n_pairs, 2) nodes (i, j) of r_i - r_j; member: the member on each pair, -1 where there is none;
    pair_of_member: the pair of each member.
    """

    ends: NDArray[np.int64]
    member: NDArray[np.int64]
    pair_of_member: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ends)


def list_pairs(structure: Structure, which: str) -> Pairs:
    """Return the pairs that are members ("connected"), or these and then all others, i < j ("full")."""
    actuated = [e for item in structure.inputs for e in item.rest_length_gain]
    members = list(dict.fromkeys([*actuated, *range(structure.n_members)]))
    ends = [(int(i), int(j)) for i, j in structure.connectivity[members]]
    if which == "full":
        joined = {frozenset(pair) for pair in ends}
        n = structure.n_nodes
        others = ((i, j) for i in range(n) for j in range(i + 1, n))
        ends += [pair for pair in others if frozenset(pair) not in joined]
    pair_of_member = np.empty(structure.n_members, dtype=np.int64)
    pair_of_member[members] = np.arange(structure.n_members)
    member = np.full(len(ends), -1, dtype=np.int64)
    member[: len(members)] = members
    return Pairs(np.array(ends, dtype=np.int64).reshape(-1, 2), member, pair_of_member)


@dataclass(frozen=True)
class TreeStep:
    """One step of the spanning forest: r_node = r_parent + sign (r_i - r_j) of the pair."""

    node: int
    parent: int
    pair: int
    sign: int


@dataclass(frozen=True)
class AxisGraph:
    """The graph of the pairs along one axis; anchored: (n_nodes,) nodes that are held along it."""

    ends: NDArray[np.int64]
    anchored: NDArray[np.bool_]

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Pairs with at least one free end: the coordinates."""
        return np.flatnonzero(~self.anchored[self.ends].all(axis=1))

    @cached_property
    def steps(self) -> tuple[TreeStep, ...]:
        """Spanning forest, breadth first from the anchored nodes and then from one node a floating part."""
        return self._forest[0]

    @cached_property
    def closing(self) -> NDArray[np.int64]:
        """Moving pairs outside the forest: each closes one cycle."""
        in_forest = [step.pair for step in self.steps]
        return np.setdiff1d(self.moving, np.array(in_forest, dtype=np.int64))

    @cached_property
    def root(self) -> NDArray[np.int64]:
        """(n_nodes,): the root from which each node is reached, itself for a root."""
        return self._forest[1]

    @cached_property
    def floating(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of each part that no anchor holds along this axis, by their lowest node."""
        roots = [int(root) for root in np.unique(self.root) if not self.anchored[root]]
        return tuple(tuple(int(node) for node in np.flatnonzero(self.root == root)) for root in roots)

    @cached_property
    def incidence(self) -> NDArray[np.float64]:
        """(n_moving, n_nodes): +1 at i, -1 at j of each moving pair."""
        result = np.zeros((len(self.moving), len(self.anchored)))
        rows = np.arange(len(self.moving))
        result[rows, self.ends[self.moving, 0]] = 1.0
        result[rows, self.ends[self.moving, 1]] = -1.0
        return result

    @cached_property
    def _forest(self) -> tuple[tuple[TreeStep, ...], NDArray[np.int64]]:
        root = np.where(self.anchored, np.arange(len(self.anchored)), -1)
        queue = deque(int(node) for node in np.flatnonzero(self.anchored))
        steps = list(self._grow(queue, root))
        for node in range(len(root)):
            if root[node] < 0:
                root[node] = node
                steps += self._grow(deque([node]), root)
        return tuple(steps), root

    def _grow(self, queue: deque[int], root: NDArray[np.int64]) -> list[TreeStep]:
        steps = []
        while queue:
            parent = queue.popleft()
            for node, pair, sign in self._neighbours[parent]:
                if root[node] < 0:
                    root[node] = root[parent]
                    steps.append(TreeStep(node, parent, pair, sign))
                    queue.append(node)
        return steps

    @cached_property
    def _neighbours(self) -> list[list[tuple[int, int, int]]]:
        """Node -> (other node, pair, sign) with r_other = r_node + sign (r_i - r_j), over moving pairs."""
        result: list[list[tuple[int, int, int]]] = [[] for _ in self.anchored]
        for pair in self.moving:
            i, j = (int(node) for node in self.ends[pair])
            result[i].append((j, int(pair), -1))
            result[j].append((i, int(pair), 1))
        return result
