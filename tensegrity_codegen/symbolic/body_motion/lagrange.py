"""Lagrange's equations by differentiation of a kinetic energy T(q, q') that is quadratic in q'.

d/dt (dT/dq') - dT/dq = M(q) q'' + c(q, q'),   M = d2T/dq'2,   c = d(dT/dq')/dq q' - dT/dq  (SCS 7 to 9)
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca


@dataclass(frozen=True)
class Lagrangian:
    """A kinetic energy [J] over coordinates and velocities (n_coordinates, 1), all symbols of one graph."""

    kinetic_energy: ca.SX
    coordinate: ca.SX
    velocity: ca.SX

    @cached_property
    def momentum(self) -> ca.SX:
        """dT/dq', (n_coordinates, 1)."""
        return ca.gradient(self.kinetic_energy, self.velocity)

    @cached_property
    def mass_matrix(self) -> ca.SX:
        """M(q), symmetric, sparse (n_coordinates, n_coordinates)."""
        return ca.hessian(self.kinetic_energy, self.velocity)[0]

    @cached_property
    def coriolis_force(self) -> ca.SX:
        """c(q, q'), (n_coordinates, 1): quadratic in the velocities."""
        drift = ca.jtimes(self.momentum, self.coordinate, self.velocity)
        return drift - ca.gradient(self.kinetic_energy, self.coordinate)

    def solve(self, right: ca.SX) -> ca.SX:
        """Return M^-1 right, (n_coordinates, k); sparse LDL^T without pivoting, M is positive definite."""
        factor, transposed, order = self._factors
        return ca.ldl_solve(ca.densify(right), factor, transposed, order)

    @cached_property
    def _factors(self) -> tuple[ca.SX, ca.SX, list[int]]:
        factor, transposed, order = ca.ldl(self.mass_matrix)
        return factor, transposed, order
