"""Length and force density of one member along a motion, derivative by derivative.

Relative derivatives e_n = l^(n) / l of the length and those of the force density s = t / l, by Leibniz:

e_n   = (d . d)^(n) / (2 d . d) - sum over 0 < i < n of C(n, i) e_i e_(n-i) / 2
s^(n) = mu e_n + c e_(n+1) - sum over i < n of C(n, i) s^(i) e_(n-i)  while it pulls, else 0
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import comb
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.geometry import dot
from tensegrity_codegen.symbolic.members.member import Member

Scalar = Any
Vector = list[Scalar]


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


def half_square(n: int, first: int, product: Callable[[int, int], Scalar]) -> Scalar:
    """Return sum over first <= i <= n - first of C(n, i) product(i, n - i) / 2; the product is symmetric."""
    total = ca.SX(0.0)
    for i in range(first, n // 2 + 1):
        weight = comb(n, i) if 2 * i < n else comb(n, i) / 2
        total = total + weight * product(i, n - i)
    return total
