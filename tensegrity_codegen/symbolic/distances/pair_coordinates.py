"""Coordinates (delta, r_c): differences of node positions over pairs, and centres of mass (S&K 3).

uvec123: all x components of the pairs, then all y, then all z; uvec321: pair by pair. Behind them, for each
axis and each part of the structure that no anchor holds along it, the component of its centre of mass.
Components between two nodes that are both anchored along an axis are constants and no coordinates.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.distances.pair_graph import AxisGraph, list_pairs

Scalar = Any
Vector = list[Scalar]


@dataclass(frozen=True)
class Centre:
    """The component along one axis (its column) of the centre of mass of the floating part `nodes`."""

    column: int
    nodes: tuple[int, ...]


class PairCoordinates:
    """Where each component lies in the coordinate vector, and node vectors from coordinates and back.

    structure: the structure; which: "connected" or "full" pairs; order: "uvec123" or "uvec321"; weight:
    n_nodes masses [kg] that each node has in the centre of mass.
    """

    def __init__(self, structure: Structure, which: str, order: str, weight: list[Scalar]) -> None:
        self.structure = structure
        self.axes = structure.axes
        self.weight = weight
        self.pairs = list_pairs(structure, which)
        self.graphs = [AxisGraph(self.pairs.ends, structure.node_anchored[:, axis]) for axis in self.axes]
        places = [(int(pair), column) for column, graph in enumerate(self.graphs) for pair in graph.moving]
        if order == "uvec321":
            places.sort()
        self.places = tuple(places)
        self.index = {place: position for position, place in enumerate(self.places)}
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

        origin: what the vectors are counted from, as of `find_origin`; zero if not given. Sums along the
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
        for place, centre in enumerate(self.centres, start=self.n_differences):
            column, total = centre.column, self.mass(centre)
            base = vector[place] if origin is None else vector[place] - origin[column]
            mean = sum((self.weight[k] / total * result[k][column] for k in centre.nodes), ca.SX(0.0))
            for node in centre.nodes:
                result[node][column] = (result[node][column] - mean) + base
        return result

    def find_origin(self, vector: ca.SX, fixed: list[Vector]) -> Vector:
        """Return a point of the structure: along each axis its first anchored node, else its first centre."""
        first = {centre.column: place for place, centre in reversed([*enumerate(self.centres)])}
        held = [np.flatnonzero(graph.anchored) for graph in self.graphs]
        return [
            fixed[nodes[0]][column] if nodes.size else vector[self.n_differences + first[column]]
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
                apart = fixed[graph.root[i]][column] - fixed[graph.root[j]][column]
                between = node[i] - node[j]
                result[self.index[int(pair), column]] = between if apart.is_zero() else between + apart
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

    def difference_map(self) -> NDArray[np.float64]:
        """Return D (n_differences, n_nodes n_axes), nodes running slower than axes; anchored columns too."""
        result = np.zeros((self.n_differences, self.structure.n_nodes * len(self.axes)))
        for row, (pair, column) in enumerate(self.places):
            i, j = self.pairs.ends[pair]
            result[row, i * len(self.axes) + column] = 1.0
            result[row, j * len(self.axes) + column] = -1.0
        return result
