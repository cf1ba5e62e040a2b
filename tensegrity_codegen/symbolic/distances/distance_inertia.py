"""Inertia in node distances: diagonal, in closed form, and external forces as forces of pairs (S&K 3, 4).

With H the mass matrix of the nodes, w = H 1 its row sums, W their sum and J = w^T / W:

    H = D^T H_delta D + J^T W J,   H_delta = diag(w_i w_j / W - m_e / 6)

over all pairs; m_e is the own mass of a uniform bar on the pair (i, j), if any. Anchored nodes are the limit
of infinite mass: a pair of a free node i and one of n anchored nodes has w_i / n - m_e / 6, a pair of free
nodes has -m_e / 6, and there is no J.
"""

from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.distances.pair_coordinates import PairCoordinates
from tensegrity_codegen.symbolic.inertia import Inertia

Scalar = Any
Vector = list[Scalar]


def build_distance_inertia(layout: PairCoordinates, inertia: Inertia) -> ca.SX:
    """Return diag(H_delta, M) over the coordinates of all pairs, sparse (n_coordinates, n_coordinates)."""
    weight, values, seen = inertia.weight_mass(), [], set()
    total = sum(weight, ca.SX(0.0))
    for pair, column in layout.places:
        i, j = (int(node) for node in layout.pairs.ends[pair])
        graph, key = layout.graphs[column], (min(i, j), max(i, j))
        if (key, column) in seen:  # a second member on the same two nodes
            values.append(ca.SX(0.0))
            continue
        seen.add((key, column))
        held = int(graph.anchored.sum())
        if not held:
            share = weight[i] * weight[j] / total
        elif graph.anchored[i] or graph.anchored[j]:
            share = weight[j if graph.anchored[i] else i] / held
        else:
            share = ca.SX(0.0)
        values.append(share - inertia.coupling.get(key, 0.0))
    values += [layout.mass(centre) for centre in layout.centres]
    return ca.sparsify(ca.diag(ca.vertcat(*values)))


def build_inverse_inertia(layout: PairCoordinates, inertia: Inertia) -> ca.SX:
    """Return diag(D H^-1 D^T, M^-1), sparse (n_coordinates, n_coordinates) [1/kg] (S&K, Theorem 3)."""
    inertia.check()
    n_axes, n_nodes = len(layout.axes), len(inertia.diagonal)
    inverse = ca.SX(n_nodes * n_axes, n_nodes * n_axes)
    for column, axis in enumerate(layout.axes):
        for nodes in inertia.groups(axis):
            places = [node * n_axes + column for node in nodes]
            inverse[places, places] = inertia.inverse(nodes)
    difference = ca.sparsify(ca.DM(layout.difference_map()))
    block = ca.mtimes(ca.mtimes(difference, inverse), difference.T)
    masses = [1.0 / layout.mass(centre) for centre in layout.centres]
    return ca.diagcat(block, *masses) if masses else block


def spread_force(layout: PairCoordinates, load: list[Vector]) -> list[Scalar]:
    """Return forces of pairs f with D^T f = g - J^T (sum of g), n_differences [N], for loads g on nodes.

    They run along the spanning forest: the step to a node carries what acts on all nodes behind it.
    """
    result = [ca.SX(0.0)] * layout.n_differences
    for column, graph in enumerate(layout.graphs):
        rest = [vector[column] for vector in load]
        for nodes in graph.floating:
            total = sum((rest[node] for node in nodes), ca.SX(0.0))
            mass = sum((layout.weight[node] for node in nodes), ca.SX(0.0))
            for node in nodes:
                rest[node] = rest[node] - layout.weight[node] * (total / mass)
        for step in reversed(graph.steps):
            place = layout.index[step.pair, column]
            result[place] = rest[step.node] if step.sign > 0 else -rest[step.node]
            rest[step.parent] = rest[step.parent] + rest[step.node]
    return result
