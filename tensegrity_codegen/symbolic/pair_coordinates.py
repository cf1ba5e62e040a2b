"""Coordinates (delta, r_c): differences of node positions over pairs, and centres of mass (S&K 3).

uvec123: all x components of the pairs, then all y, then all z; uvec321: pair by pair. Behind them, for each
axis and each part of the structure that no anchor holds along it, the component of its centre of mass.
Components between two nodes that are both anchored along an axis are constants and no coordinates.

The pairs are a graph, axis by axis. A pair (i, j) stands for the component r_i - r_j along the axis. It is
a coordinate unless both nodes are anchored there. A spanning forest of the moving pairs leads from roots to
every other node: anchored nodes are roots; a part of the structure that no anchor holds has one root of its
own and floats.
"""

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.geometry import Scalar, Vector


@dataclass(frozen=True)
class Pairs:
    """Pairs of nodes in the order of the coordinates: actuated members first, in the order of the inputs.

    ends: (n_pairs, 2) nodes (i, j) of r_i - r_j; member: the member on each pair, -1 if there is none;
    pair_of_member: the pair of each member.
    """

    ends: NDArray[np.int64]
    member: NDArray[np.int64]
    pair_of_member: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ends)


def list_pairs(structure: Structure, selection: str) -> Pairs:
    """Return the pairs that are members ("connected"), or these and then all others, i < j ("full")."""
    actuated = [e for source in structure.inputs for e in source.rest_length_gain]
    members = list(dict.fromkeys([*actuated, *range(structure.n_members)]))
    ends = [(int(i), int(j)) for i, j in structure.connectivity[members]]
    if selection == "full":
        joined = {frozenset(pair) for pair in ends}
        n = structure.n_nodes
        all_pairs = ((i, j) for i in range(n) for j in range(i + 1, n))
        ends += [pair for pair in all_pairs if frozenset(pair) not in joined]
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


@dataclass(frozen=True)
class Centre:
    """The component along one axis (its column) of the centre of mass of the floating part `nodes`."""

    column: int
    nodes: tuple[int, ...]


class PairCoordinates:
    """Where each component lies in the coordinate vector, and node vectors from coordinates and back.

    structure: the structure; selection: "connected" or "full" pairs; order: "uvec123" or "uvec321"; weight:
    n_nodes masses [kg] that each node has in the centre of mass.
    """

    def __init__(self, structure: Structure, selection: str, order: str, weight: list[Scalar]) -> None:
        self.structure = structure
        self.axes = structure.axes
        self.weight = weight
        self.pairs = list_pairs(structure, selection)
        self.graphs = [AxisGraph(self.pairs.ends, structure.node_anchored[:, axis]) for axis in self.axes]
        pair_columns = [
            (int(pair), column) for column, graph in enumerate(self.graphs) for pair in graph.moving
        ]
        if order == "uvec321":
            pair_columns.sort()
        self.places = tuple(pair_columns)
        self.index = {pair_column: position for position, pair_column in enumerate(self.places)}
        self.centres = tuple(
            Centre(column, nodes) for column, graph in enumerate(self.graphs) for nodes in graph.floating
        )

    @property
    def n_differences(self) -> int:
        """Number of coordinates that are differences."""
        return len(self.places)

    @property
    def n_coordinates(self) -> int:
        """Number of all coordinates."""
        return len(self.places) + len(self.centres)

    def names(self) -> tuple[str, ...]:
        """Return C identifiers: `<node>_<node>_<axis>` and `centre_<axis>`, numbered where not unique."""
        node, ends = self.structure.node_name, self.pairs.ends
        letters = ["xyz"[axis] for axis in self.axes]
        names = [f"{node[ends[p][0]]}_{node[ends[p][1]]}_{letters[column]}" for p, column in self.places]
        if len(set(names)) < len(names):
            names = [f"pair{pair}_{letters[column]}" for pair, column in self.places]
        single = all(len(graph.floating) <= 1 for graph in self.graphs)
        for number, centre in enumerate(self.centres):
            names.append(f"centre{'' if single else number}_{letters[centre.column]}")
        return tuple(names) if len(set(names)) == len(names) else tuple(f"q{k}" for k in range(len(names)))

    def pair_vector(self, pair: int, vector: ca.SX, fixed: list[Vector]) -> Vector:
        """Return the components of one pair: coordinates, or differences of the `fixed` node vectors."""
        i, j = self.pairs.ends[pair]
        columns = range(len(self.axes))
        return [
            vector[self.index[pair, c]] if (pair, c) in self.index else fixed[i][c] - fixed[j][c]
            for c in columns
        ]

    def node_vectors(self, vector: ca.SX, fixed: list[Vector], origin: Vector | None = None) -> list[Vector]:
        """Return one vector a node from coordinates; `fixed` holds the components of anchored nodes.

        origin: of the vectors, as of `find_origin`; zero if not given. Sums along the
        spanning forest come first and the place of its root last, so that nothing but the result is large far
        from the origin: r = r_root + s, and r = r_c + (s - (sum of w s) / (sum of w)) in a floating part.
        """
        result: list[Vector] = [[ca.SX(0.0)] * len(self.axes) for _ in fixed]
        for column, graph in enumerate(self.graphs):
            start = ca.SX(0.0) if origin is None else origin[column]
            for node, value in enumerate(self._sum_steps(vector, column)):
                root = int(graph.root[node])
                base = fixed[root][column] - start if graph.anchored[root] else ca.SX(0.0)
                result[node][column] = value if base.is_zero() else base + value
        for position, centre in enumerate(self.centres, start=self.n_differences):
            column, total = centre.column, self.mass(centre)
            base = vector[position] if origin is None else vector[position] - origin[column]
            mean = sum((self.weight[k] / total * result[k][column] for k in centre.nodes), ca.SX(0.0))
            for node in centre.nodes:
                result[node][column] = (result[node][column] - mean) + base
        return result

    def find_origin(self, vector: ca.SX, fixed: list[Vector]) -> Vector:
        """Return a point of the structure: along each axis its first anchored node, else its first centre."""
        starts = {centre.column: position for position, centre in reversed([*enumerate(self.centres)])}
        held = [np.flatnonzero(graph.anchored) for graph in self.graphs]
        return [
            fixed[nodes[0]][column] if nodes.size else vector[self.n_differences + starts[column]]
            for column, nodes in enumerate(held)
        ]

    def _sum_steps(self, vector: ca.SX, column: int) -> list[Scalar]:
        """Return the component of each node along an axis from the root of its tree, zero at roots."""
        result: list[Scalar] = [ca.SX(0.0)] * self.structure.n_nodes
        for step in self.graphs[column].steps:
            difference, base = vector[self.index[step.pair, column]], result[step.parent]
            result[step.node] = base + difference if step.sign > 0 else base - difference
        return result

    def mass(self, centre: Centre) -> Scalar:
        """Return the mass of a floating part [kg]."""
        return sum((self.weight[node] for node in centre.nodes), ca.SX(0.0))

    def close_cycles(self, vector: ca.SX, fixed: list[Vector]) -> list[Scalar]:
        """Return the coordinates with pairs outside the spanning forest as sums along it; `fixed`: anchors.

        Wherever the constraints hold this changes nothing but rounding. Anchors enter by their differences
        alone: a sum that starts at the place of one would have the rounding of its distance from the origin.
        """
        ends, result = self.pairs.ends, [vector[k] for k in range(self.n_coordinates)]
        for column, graph in enumerate(self.graphs):
            node = self._sum_steps(vector, column)
            for pair in graph.closing:
                i, j = (int(end) for end in ends[pair])
                offset = fixed[graph.root[i]][column] - fixed[graph.root[j]][column]
                between = node[i] - node[j]
                result[self.index[int(pair), column]] = between if offset.is_zero() else between + offset
        return result

    def differences(self, vectors: list[Vector]) -> list[Scalar]:
        """Return D r, the components of all pairs, of one vector a node."""
        ends = self.pairs.ends
        return [vectors[ends[p][0]][column] - vectors[ends[p][1]][column] for p, column in self.places]

    def compute(self, values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates (n_coordinates,) of node vectors (n_nodes, 3) with weights (n_nodes,)."""
        ends, axes = self.pairs.ends, self.axes
        numbers = [
            values[ends[pair][0], axes[column]] - values[ends[pair][1], axes[column]]
            for pair, column in self.places
        ]
        for centre in self.centres:
            nodes = list(centre.nodes)
            numbers.append(np.average(values[nodes, axes[centre.column]], weights=weight[nodes]))
        return np.array(numbers, dtype=np.float64)

    def centre_map(self) -> ca.SX:
        """Return J_c (n_centres, n_nodes n_axes), sparse, columns as those of D."""
        result = ca.SX(len(self.centres), self.structure.n_nodes * len(self.axes))
        for row, centre in enumerate(self.centres):
            for node in centre.nodes:
                result[row, node * len(self.axes) + centre.column] = self.weight[node] / self.mass(centre)
        return result

    def difference_map(self) -> NDArray[np.float64]:
        """Return D (n_differences, n_nodes n_axes), nodes running slower than axes; anchored columns too."""
        result = np.zeros((self.n_differences, self.structure.n_nodes * len(self.axes)))
        for row, (pair, column) in enumerate(self.places):
            i, j = self.pairs.ends[pair]
            result[row, i * len(self.axes) + column] = 1.0
            result[row, j * len(self.axes) + column] = -1.0
        return result
