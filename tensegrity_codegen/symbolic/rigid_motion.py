"""Rigid bars as constraints between node coordinates: projections, and the motion as a series in time.

g_b = (d_b . d_b - l_b^2) / 2 = 0,  J = dg/dq: +d_b at node i, -d_b at node j
S = J H^-1 J^T: diagonal if no two rigid bars share a node (class 1) or a bar with mass joins them,
else sparse and positive definite; its LDL^T keeps the pattern of the graph in which bars are vertices.

The series is that of one state, with multipliers and tensions derived. H q'' = f - J^T lambda is what all
members pull, s d each, with s = lambda for the bars. Derived n times

H q^(n+2) = sum over members of +-(s d)^(n),  (s d)^(n) = sum over i of C(n, i) s^(i) d^(n-i)
S lambda^(n) = J H^-1 (that without lambda^(n)) + sum over 0 < i < n + 2 of C(n+2, i) d^(i) . d^(n+2-i) / 2

the second since (d . d)^(n+2) = 0 for every bar: one solution with the same S for each derivative.

Relative derivatives e_n = l^(n) / l of the length and those of the force density s = t / l, by Leibniz:

e_n   = (d . d)^(n) / (2 d . d) - sum over 0 < i < n of C(n, i) e_i e_(n-i) / 2
s^(n) = mu e_n + c e_(n+1) - sum over i < n of C(n, i) s^(i) e_(n-i)  while it pulls, else 0
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from math import comb

import casadi as ca

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.geometry import Scalar, Vector, dot, member_vector
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.node_coordinates import NodeCoordinates
from tensegrity_codegen.symbolic.scatter import CoordinateMap


@dataclass(frozen=True)
class MemberSeries:
    """Derivatives of one member, each built once, when first needed.

    member: the member; vector: n -> d^(n) [m/s^n]; keeps_length: whether (d . d)^(n) = 0 from n = 2 on.
    """

    member: Member
    vector: Callable[[int], Vector]
    keeps_length: bool
    _lengths: dict[int, Scalar] = field(default_factory=dict)
    _densities: dict[int, Scalar] = field(default_factory=dict)

    def relative_length(self, n: int) -> Scalar:
        """Return e_n, the derivative of the length over the length [1/s^n]; e_0 = 1."""
        if n not in self._lengths:
            self._lengths[n] = self._find_length(n) if n else ca.SX(1.0)
        return self._lengths[n]

    def density(self, n: int) -> Scalar:
        """Return s^(n), the derivative of the force density [N/(m s^n)]."""
        if n not in self._densities:
            self._densities[n] = self._find_density(n) if n else self.member.density
        return self._densities[n]

    def _find_length(self, n: int) -> Scalar:
        total = ca.SX(0.0)
        if n < 2 or not self.keeps_length:
            change = half_square(n, 0, lambda i, j: dot(self.vector(i), self.vector(j)))
            total = change / self.member.square
        return total - half_square(n, 1, lambda i, j: self.relative_length(i) * self.relative_length(j))

    def _find_density(self, n: int) -> Scalar:
        law = self.member.law
        total = (law.tension_by_length() - self.density(0)) * self.relative_length(n)
        for i in range(1, n):
            total = total - comb(n, i) * self.density(i) * self.relative_length(n - i)
        if self.member.is_damped:
            total = total + law.tension_by_rate() * self.relative_length(n + 1)
        return total


def half_square(n: int, start: int, product: Callable[[int, int], Scalar]) -> Scalar:
    """Return sum over first <= i <= n - first of C(n, i) product(i, n - i) / 2; the product is symmetric."""
    total = ca.SX(0.0)
    for i in range(start, n // 2 + 1):
        weight = comb(n, i) if 2 * i < n else comb(n, i) / 2
        total = total + weight * product(i, n - i)
    return total


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
            gap = [0.5 * (dot(d, d) - length * length) for d, length in zip(vectors, lengths, strict=True)]
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
        excess = [1.0 - length / ca.sqrt(dot(d, d)) for d, length in zip(vectors, lengths, strict=True)]
        by = [e / self._weights(b)[0] for b, e in enumerate(excess)]
        return coordinate - self.move(self.jacobian(vectors), ca.vertcat(*by))

    def _weights(self, b: int) -> list[Scalar]:
        """Return u^T H^-1 u along each axis, with u = +1 at node i and -1 at node j [1/kg]."""
        (i, j), result = self.ends[b], []
        for axis in self.structure.axes:
            entries = [(self.map.index.get((node, axis)), sign) for node, sign in ((i, 1.0), (j, -1.0))]
            free = [(index, sign) for index, sign in entries if index is not None]
            terms = [p * q * self.inverse_mass[k, m] for k, p in free for m, q in free]
            result.append(ca.sum1(ca.vertcat(*terms)) if terms else ca.SX(0.0))
        return result

    def _unit_vectors(self) -> list[Vector]:
        return [[ca.SX(1.0) for _ in self.structure.axes] for _ in self.members]


class RigidMotion:
    """Derivatives along the motion in which some bars keep their lengths, built when first needed.

    nodes: the structure in node coordinates, with no stiffness in these bars; constraints: the bars.
    """

    def __init__(self, nodes: NodeCoordinates, constraints: BarConstraints) -> None:
        self.nodes = nodes
        self.constraints = constraints
        self.place = {e: b for b, e in enumerate(constraints.members)}
        members = nodes.members
        self.jacobian = constraints.jacobian([members.vectors[e] for e in self.place])
        self.matrix = constraints.matrix(self.jacobian)
        self.series = [
            MemberSeries(member, partial(self._vector, e), e in self.place)
            for e, member in enumerate(members.members)
        ]
        self._vectors = {0: members.vectors, 1: members.vector_rates}
        self._free: dict[int, ca.SX] = {0: nodes.free_acceleration()}
        self._multipliers: dict[int, ca.SX] = {}

    def multipliers(self, n: int = 0) -> ca.SX:
        """Return lambda^(n), (n_bars, 1) [N/(m s^n)]."""
        if n not in self._multipliers:
            turns = [half_square(n + 2, 1, partial(self._dot, e)) for e in self.place]
            right = ca.mtimes(self.jacobian, self._free_motion(n)) + ca.vertcat(*turns)
            self._multipliers[n] = self.constraints.solve(self.matrix, right)
        return self._multipliers[n]

    def tensions(self, n: int = 0) -> list[Scalar]:
        """Return the n-th derivative of the bars' tensions lambda l [N/s^n]."""
        return [self._tension(e, b, n) for e, b in self.place.items()]

    def _tension(self, e: int, b: int, n: int) -> Scalar:
        density, series = ca.SX(0.0), self.series[e]
        for i in range(n + 1):
            density = density + comb(n, i) * self.multipliers(i)[b] * series.relative_length(n - i)
        return density * series.member.length

    def motion(self, n: int = 0) -> ca.SX:
        """Return q^(n+2), (n_coordinates, 1) [m/s^(n+2)]."""
        return self._free_motion(n) - self.constraints.move(self.jacobian, self.multipliers(n))

    def vectors(self, n: int) -> list[Vector]:
        """Return d^(n) of all members [m/s^n]."""
        if n not in self._vectors:
            still = [[ca.SX(0.0) for _ in position] for position in self.nodes.arguments.position]
            self._vectors[n] = self.nodes.differences(self.nodes.map.place(self.motion(n - 2), still))
        return self._vectors[n]

    def _free_motion(self, n: int) -> ca.SX:
        """Return q^(n+2) without lambda^(n)."""
        if n not in self._free:
            still = [[ca.SX(0.0) for _ in position] for position in self.nodes.arguments.position]
            pulls = [[self._pull(e, n)] for e in range(len(self.series))]
            self._free[n] = self.nodes.accelerate(self.nodes.members.add_pulls(still, pulls))
        return self._free[n]

    def _pull(self, e: int, n: int) -> Vector:
        """Return (s d)^(n), without lambda^(n) if it is a bar's."""
        result = [ca.SX(0.0) for _ in self.nodes.structure.axes]
        for i in range(n if e in self.place else n + 1):
            density = self.multipliers(i)[self.place[e]] if e in self.place else self.series[e].density(i)
            scaled = comb(n, i) * density
            result = [r + scaled * d for r, d in zip(result, self.vectors(n - i)[e], strict=True)]
        return result

    def _vector(self, e: int, n: int) -> Vector:
        return self.vectors(n)[e]

    def _dot(self, e: int, i: int, j: int) -> Scalar:
        return dot(self.vectors(i)[e], self.vectors(j)[e])
