"""Inertia, constraints and member blocks of the formulation in node distances (S&K 3 to 7).

Inertia is diagonal, in closed form. With H the mass matrix of the nodes, w = H 1 its row sums, W their sum
and J = w^T / W:

    H = D^T H_delta D + J^T W J,   H_delta = diag(w_i w_j / W - m_e / 6)

over all pairs; m_e is the own mass of a uniform bar on the pair (i, j), if any. Anchored nodes are the limit
of infinite mass: a pair of a free node i and one of n anchored nodes has w_i / n - m_e / 6, a pair of free
nodes has -m_e / 6, and there is no J.

Blocks are Jacobians of member forces to member vectors and rest lengths, one block a member:

df/dd = -mu [(1 - rho/l) I + (rho/l^3) d d^T], df/drho = mu d / l, zero for a slack cable; damping adds its
parts. A component that is no coordinate, between two anchored nodes, has no row and no column.
"""

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.symbolic.geometry import Scalar, Vector
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.members.member import MemberBlocks
from tensegrity_codegen.symbolic.members.member_set import MemberSet
from tensegrity_codegen.symbolic.pair_coordinates import AxisGraph, PairCoordinates
from tensegrity_codegen.system.arrays import FloatArray


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
            product = weight[i] * weight[j] / total
        elif graph.anchored[i] or graph.anchored[j]:
            product = weight[j if graph.anchored[i] else i] / held
        else:
            product = ca.SX(0.0)
        values.append(product - inertia.coupling.get(key, 0.0))
    values += [layout.mass(centre) for centre in layout.centres]
    return ca.sparsify(ca.diag(ca.vertcat(*values)))


def build_inverse_inertia(layout: PairCoordinates, inertia: Inertia) -> ca.SX:
    """Return diag(D H^-1 D^T, M^-1), sparse (n_coordinates, n_coordinates) [1/kg] (S&K, Theorem 3)."""
    inertia.check()
    n_axes, n_nodes = len(layout.axes), len(inertia.diagonal)
    inverse = ca.SX(n_nodes * n_axes, n_nodes * n_axes)
    for column, axis in enumerate(layout.axes):
        for nodes in inertia.groups(axis):
            indices = [node * n_axes + column for node in nodes]
            inverse[indices, indices] = inertia.inverse(nodes)
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
        components = [vector[column] for vector in load]
        for nodes in graph.floating:
            total = sum((components[node] for node in nodes), ca.SX(0.0))
            mass = sum((layout.weight[node] for node in nodes), ca.SX(0.0))
            for node in nodes:
                components[node] = components[node] - layout.weight[node] * (total / mass)
        for step in reversed(graph.steps):
            index = layout.index[step.pair, column]
            result[index] = components[step.node] if step.sign > 0 else -components[step.node]
            components[step.parent] = components[step.parent] + components[step.node]
    return result


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
    basis, _, _ = np.linalg.svd(free)
    # The rank is known exactly: one pair of the forest for each node that is no root.
    return np.asarray(basis[:, len(graph.steps) :])


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
            position = self.layout.structure.node_position[:, axis]
            held = np.zeros(
                len(position)
            )  # counted from one anchor: far from the origin too a length, not a place
            held[graph.anchored] = position[graph.anchored] - position[np.argmax(graph.anchored)]
            constants.append(basis.T @ (graph.incidence @ held))
        return ca.mtimes(self.basis.T, coordinate) - ca.DM(np.concatenate(constants))

    def multiplier(self, residual: ca.SX) -> ca.SX:
        """Return lambda with L lambda = rest, (n_constraints, 1), for a right side that has one.

        The pair that closes a cycle is in no other one, with the coefficient +1; an orthonormal basis is its
        own inverse.
        """
        if self.kind == "orthonormal":
            return ca.mtimes(self.basis.T, residual)
        entries = [
            self.layout.index[int(pair), column]
            for column, graph in enumerate(self.layout.graphs)
            for pair in graph.closing
        ]
        return residual[entries]

    def saddle_matrix(self, inertia: ca.SX) -> ca.SX:
        """Return [H_delta L; L^T 0], sparse, of the inertia (n_coordinates, n_coordinates)."""
        count = self.basis.shape[1]
        upper = ca.horzcat(inertia, ca.SX(self.basis))
        return ca.vertcat(upper, ca.horzcat(ca.SX(self.basis.T), ca.SX(count, count)))


class DistanceBlocks:
    """Block-diagonal Jacobians of the forces of `members` over the coordinates of `layout`."""

    def __init__(self, layout: PairCoordinates, members: MemberSet) -> None:
        self.layout = layout
        self.members = members

    def places(self, e: int) -> list[tuple[int, int]]:
        """Return (coordinate, column of its axis) of the components of member e that are coordinates."""
        pair = int(self.layout.pairs.pair_of_member[e])
        columns = range(len(self.layout.axes))
        return [(self.layout.index[pair, c], c) for c in columns if (pair, c) in self.layout.index]

    def by_position(self) -> ca.SX:
        """Return df/ddelta, sparse (n_coordinates, n_coordinates) [N/m]."""
        return self._diagonal({e: member.position_block() for e, member in enumerate(self.members.members)})

    def by_velocity(self) -> ca.SX:
        """Return df/ddelta', sparse (n_coordinates, n_coordinates) [N s/m]."""
        return self._diagonal({e: self.members.members[e].rate_block() for e in self.members.damped})

    def by_rest_length(self) -> ca.SX:
        """Return df/drho = -(dt/drho) d / l, sparse (n_coordinates, n_members) [N/m]."""
        members = self.members
        entries = [
            (row, e, -members.laws[e].tension_by_rest_length() * members.vectors[e][r] / length)
            for e, length in enumerate(members.lengths)
            for row, r in self.places(e)
        ]
        return _sparse(entries, self.layout.n_coordinates, len(members.ends))

    def by_input(self) -> ca.SX:
        """Return df/du of rest-length inputs, sparse (n_coordinates, n_inputs) [N/m]."""
        columns, slope = [], self.by_rest_length()
        for source in self.layout.structure.inputs:
            changes = (gain * slope[:, e] for e, gain in source.rest_length_gain.items())
            columns.append(sum(changes, ca.SX(self.layout.n_coordinates, 1)))
        return ca.horzcat(*columns) if columns else ca.SX(self.layout.n_coordinates, 0)

    def _diagonal(self, blocks: dict[int, MemberBlocks]) -> ca.SX:
        entries = [
            (row, column, -block.entries[r][c])
            for e, block in blocks.items()
            for row, r in self.places(e)
            for column, c in self.places(e)
        ]
        return _sparse(entries, self.layout.n_coordinates, self.layout.n_coordinates)


def _sparse(entries: list[tuple[int, int, Scalar]], rows: int, columns: int) -> ca.SX:
    nonzero = [entry for entry in entries if not entry[2].is_zero()]
    stacked = ca.vertcat(*[value for _, _, value in nonzero]) if nonzero else ca.SX(0, 1)
    return ca.SX.triplet([r for r, _, _ in nonzero], [c for _, c, _ in nonzero], stacked, rows, columns)
