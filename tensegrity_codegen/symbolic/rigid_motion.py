"""The motion with rigid bars as a series in time from one state: multipliers and tensions, derived.

H q'' = f - J^T lambda is what all members pull, s d each, with s = lambda for the bars. Derived n times

H q^(n+2) = sum over members of +-(s d)^(n),  (s d)^(n) = sum over i of C(n, i) s^(i) d^(n-i)
S lambda^(n) = J H^-1 (that without lambda^(n)) + sum over 0 < i < n + 2 of C(n+2, i) d^(i) . d^(n+2-i) / 2

the second since (d . d)^(n+2) = 0 for every bar: one solution with the same S for each derivative.
"""

from functools import partial
from math import comb
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.bar_constraints import BarConstraints
from tensegrity_codegen.symbolic.geometry import dot
from tensegrity_codegen.symbolic.members.member_series import MemberSeries, half_square
from tensegrity_codegen.symbolic.node_coordinates import NodeCoordinates

Scalar = Any
Vector = list[Scalar]


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
            still = [[ca.SX(0.0) for _ in place] for place in self.nodes.arguments.position]
            self._vectors[n] = self.nodes.differences(self.nodes.map.place(self.motion(n - 2), still))
        return self._vectors[n]

    def _free_motion(self, n: int) -> ca.SX:
        """Return q^(n+2) without lambda^(n)."""
        if n not in self._free:
            still = [[ca.SX(0.0) for _ in place] for place in self.nodes.arguments.position]
            pulls = [[self._pull(e, n)] for e in range(len(self.series))]
            self._free[n] = self.nodes.accelerate(self.nodes.members.add_pulls(still, pulls))
        return self._free[n]

    def _pull(self, e: int, n: int) -> Vector:
        """Return (s d)^(n), without lambda^(n) where it is a bar's."""
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
