"""Constraints between differences over all axes: basis, residual, multipliers, saddle matrix (S&K 4, 7)."""

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.symbolic.distances.pair_coordinates import PairCoordinates
from tensegrity_codegen.symbolic.distances.pair_graph import AxisGraph
from tensegrity_codegen.system.arrays import FloatArray

# Bases of the constraints L^T delta = const that components of one axis obey (S&K 4).
#
# delta = D r leaves L^T delta free of the free nodes when the columns of L span the null space of D_f^T, D_f
# being the columns of D at the free nodes. Any basis serves, as only the product L lambda enters the
# dynamics:
#
# cycles       one fundamental cycle of a spanning forest for each pair outside it, entries -1, 0, +1
# orthonormal  the left singular vectors of D_f beyond its rank, as S&K take them; dense


def build_constraint_basis(graph: AxisGraph, kind: str) -> FloatArray:
    """Return L (n_moving, n_constraints) of one axis; kind: "cycles" or "orthonormal"."""
    return _fundamental_cycles(graph) if kind == "cycles" else _orthonormal(graph)


def _fundamental_cycles(graph: AxisGraph) -> FloatArray:
    """Each pair (i, j) outside the forest closes a cycle: delta_ij - path to i + path to j is constant."""
    row = {int(pair): index for index, pair in enumerate(graph.moving)}
    path = np.zeros((len(graph.anchored), len(row)))
    for step in graph.steps:
        path[step.node] = path[step.parent]
        path[step.node, row[step.pair]] += step.sign
    basis = np.zeros((len(row), len(graph.closing)))
    for column, pair in enumerate(graph.closing):
        i, j = graph.ends[pair]
        basis[:, column] = path[j] - path[i]
        basis[row[int(pair)], column] += 1.0
    return basis


def _orthonormal(graph: AxisGraph) -> FloatArray:
    free = graph.incidence[:, ~graph.anchored]
    left, _, _ = np.linalg.svd(free)
    # The rank is known exactly: one pair of the forest for each node that is no root.
    return np.asarray(left[:, len(graph.steps) :])


class DistanceConstraints:
    """Constraints L^T q = const of the coordinates q of `layout`; kind: "cycles" or "orthonormal" basis."""

    def __init__(self, layout: PairCoordinates, kind: str) -> None:
        self.layout = layout
        self.kind = kind

    @cached_property
    def axis_bases(self) -> list[NDArray[np.float64]]:
        """L of each axis, (n_moving, n_constraints) over the moving pairs of its graph."""
        return [build_constraint_basis(graph, self.kind) for graph in self.layout.graphs]

    @cached_property
    def basis(self) -> ca.DM:
        """L, sparse (n_coordinates, n_constraints), the constraints axis by axis."""
        rows, columns, values, start = [], [], [], 0
        for column, (graph, basis) in enumerate(zip(self.layout.graphs, self.axis_bases, strict=True)):
            for r, c in zip(*np.nonzero(basis), strict=True):
                rows.append(self.layout.index[int(graph.moving[r]), column])
                columns.append(start + int(c))
                values.append(float(basis[r, c]))
            start += basis.shape[1]
        return ca.DM.triplet(rows, columns, ca.DM(values), self.layout.n_coordinates, start)

    def residual(self, coordinate: ca.SX) -> ca.SX:
        """Return L^T q minus its value at the anchors, (n_constraints, 1) [m]."""
        constants = []
        for axis, graph, basis in zip(self.layout.axes, self.layout.graphs, self.axis_bases, strict=True):
            place = self.layout.structure.node_position[:, axis]
            held = np.zeros(
                len(place)
            )  # counted from one anchor: far from the origin too a length, not a place
            held[graph.anchored] = place[graph.anchored] - place[np.argmax(graph.anchored)]
            constants.append(basis.T @ (graph.incidence @ held))
        return ca.mtimes(self.basis.T, coordinate) - ca.DM(np.concatenate(constants))

    def multiplier(self, rest: ca.SX) -> ca.SX:
        """Return lambda with L lambda = rest, (n_constraints, 1), for a right side that has one.

        The pair that closes a cycle is in no other one, with the coefficient +1; an orthonormal basis is its
        own inverse.
        """
        if self.kind == "orthonormal":
            return ca.mtimes(self.basis.T, rest)
        places = [
            self.layout.index[int(pair), column]
            for column, graph in enumerate(self.layout.graphs)
            for pair in graph.closing
        ]
        return rest[places]

    def saddle_matrix(self, inertia: ca.SX) -> ca.SX:
        """Return [H_delta L; L^T 0], sparse, of the inertia (n_coordinates, n_coordinates)."""
        count = self.basis.shape[1]
        upper = ca.horzcat(inertia, ca.SX(self.basis))
        return ca.vertcat(upper, ca.horzcat(ca.SX(self.basis.T), ca.SX(count, count)))
