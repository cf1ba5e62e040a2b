"""Rigid bars as constraints between node coordinates, and the projections back onto them.

g_b = (d_b . d_b - l_b^2) / 2 = 0,  J = dg/dq: +d_b at node i, -d_b at node j
S = J H^-1 J^T: diagonal where no two rigid bars share a node (class 1) or a bar with mass joins them,
else sparse and positive definite; its LDL^T keeps the pattern of the graph in which bars are vertices.
"""

from functools import cached_property
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.geometry import dot, member_vector
from tensegrity_codegen.symbolic.scatter import CoordinateMap

Scalar = Any
Vector = list[Scalar]

NEWTON_STEPS = 3  # of the projection of positions, where it has no closed form; each squares the error


class BarConstraints:
    """The constraints of some bars at one place.

    structure: the structure; members: indices of the rigid bars; map: its free coordinates; inverse_mass:
    H^-1, sparse (n_coordinates, n_coordinates) [1/kg].
    """

    def __init__(
        self, structure: Structure, members: list[int], coordinate_map: CoordinateMap, inverse_mass: ca.SX
    ) -> None:
        self.structure = structure
        self.members = members
        self.map = coordinate_map
        self.inverse_mass = inverse_mass
        self.ends = [(int(i), int(j)) for i, j in structure.connectivity[members]]

    @cached_property
    def is_uniform(self) -> bool:
        """Whether each bar stands alone and is as heavy along every axis: then scaling it is a projection."""
        weights = [self._weights(b) for b in range(len(self.members))]
        return self.is_diagonal and all(ca.is_equal(row[0], w, 2) for row in weights for w in row)

    @property
    def is_diagonal(self) -> bool:
        """Whether S is diagonal: each multiplier is a closed form of its own."""
        return bool(self.matrix(self.jacobian(self._unit_vectors())).sparsity().is_diag())

    def vectors(self, position: list[Vector]) -> list[Vector]:
        """Return the vectors d_b at these node positions [m]."""
        return [member_vector(position[i], position[j]) for i, j in self.ends]

    def jacobian(self, vectors: list[Vector]) -> ca.SX:
        """Return J, sparse (n_bars, n_coordinates) [m]."""
        return self.map.member_columns(vectors, self.ends).T

    def matrix(self, jacobian: ca.SX) -> ca.SX:
        """Return S = J H^-1 J^T, sparse (n_bars, n_bars) [m2/kg]."""
        return ca.mtimes(ca.mtimes(jacobian, self.inverse_mass), jacobian.T)

    def solve(self, matrix: ca.SX, right: ca.SX) -> ca.SX:
        """Return S^-1 b: a division each where S is diagonal, else by LDL^T in the order of least fill."""
        if matrix.sparsity().is_diag():
            return right / ca.diag(matrix)
        factor, transposed, order = ca.ldl(matrix)
        return ca.ldl_solve(ca.densify(right), factor, transposed, order)

    def move(self, jacobian: ca.SX, by: ca.SX) -> ca.SX:
        """Return H^-1 J^T s, the motion that impulses s along the bars make, (n_coordinates, 1)."""
        return ca.densify(ca.mtimes(self.inverse_mass, ca.mtimes(jacobian.T, by)))

    def project_position(self, coordinate: ca.SX, fixed: list[Vector], lengths: list[Scalar]) -> ca.SX:
        """Return the coordinates nearest in the metric H at which every bar has its length, (n, 1) [m].

        fixed: positions of all nodes, used where they are anchored. In closed form where bars stand alone,
        by a fixed number of Newton steps elsewhere.
        """
        if self.is_uniform:
            return self._scale(coordinate, fixed, lengths)
        for _ in range(NEWTON_STEPS):
            vectors = self.vectors(self.map.place(coordinate, fixed))
            jacobian = self.jacobian(vectors)
            gap = [0.5 * (dot(d, d) - kept * kept) for d, kept in zip(vectors, lengths, strict=True)]
            change = self.solve(self.matrix(jacobian), ca.vertcat(*gap))
            coordinate = coordinate - self.move(jacobian, change)
        return coordinate

    def project_velocity(self, position: list[Vector], velocity: ca.SX, rates: list[Scalar]) -> ca.SX:
        """Return the velocities nearest in the metric H at which d_b . d_b' = rates_b, (n, 1) [m/s]."""
        jacobian = self.jacobian(self.vectors(position))
        gap = ca.mtimes(jacobian, velocity) - ca.vertcat(*rates)
        return velocity - self.move(jacobian, self.solve(self.matrix(jacobian), gap))

    def _scale(self, coordinate: ca.SX, fixed: list[Vector], lengths: list[Scalar]) -> ca.SX:
        """Return the coordinates with every bar scaled to its length, its ends moved as their masses ask."""
        vectors = self.vectors(self.map.place(coordinate, fixed))
        excess = [1.0 - kept / ca.sqrt(dot(d, d)) for d, kept in zip(vectors, lengths, strict=True)]
        by = [e / self._weights(b)[0] for b, e in enumerate(excess)]
        return coordinate - self.move(self.jacobian(vectors), ca.vertcat(*by))

    def _weights(self, b: int) -> list[Scalar]:
        """Return u^T H^-1 u along each axis, with u = +1 at node i and -1 at node j [1/kg]."""
        (i, j), result = self.ends[b], []
        for axis in self.structure.axes:
            places = [(self.map.index.get((node, axis)), sign) for node, sign in ((i, 1.0), (j, -1.0))]
            free = [(place, sign) for place, sign in places if place is not None]
            terms = [p * q * self.inverse_mass[k, m] for k, p in free for m, q in free]
            result.append(ca.sum1(ca.vertcat(*terms)) if terms else ca.SX(0.0))
        return result

    def _unit_vectors(self) -> list[Vector]:
        return [[ca.SX(1.0) for _ in self.structure.axes] for _ in self.members]
