"""Bases of the constraints L^T delta = const that components of one axis obey (S&K 4).

delta = D r leaves L^T delta free of the free nodes when the columns of L span the null space of D_f^T, D_f
being the columns of D at the free nodes. Any basis serves, as only the product L lambda enters the dynamics:

cycles       one fundamental cycle of a spanning forest for each pair outside it, entries -1, 0, +1
orthonormal  the left singular vectors of D_f beyond its rank, as S&K take them; dense
"""

import numpy as np

from tensegrity_codegen.symbolic.distances.pair_graph import AxisGraph
from tensegrity_codegen.system.arrays import FloatArray


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
