"""The interface of a force on nodes: values, energy stored and lost, internal states, margins.

Between two surfaces that overlap: N = k d^p max(0, 1 + a d') where d > 0.
Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440. (k d^p - N) d' = -a k d^p d'^2 is lost at
impacts, where 1 + a d' > 0.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca

from tensegrity_codegen.symbolic.geometry import Scalar, Vector
from tensegrity_codegen.symbolic.memory import Memory


class NodeForce(Memory):
    """A force on some nodes, as expressions of the state (q, q', z) and of the arguments."""

    @abstractmethod
    def forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it, over the modelled axes [N]."""

    def static_forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it at rest, minus the gradient of `stored_energy` [N].

        What it remembers follows the nodes along this force: the derivative of z is that of the positions.
        None if equilibria do not know the force: see structure/collision.py.
        """
        return {}

    def body_moments(self) -> Mapping[int, list[Vector]]:
        """Return first corner of a body -> moments on it that `forces` has as forces on corners [N m]."""
        return {}

    def static_stiffness(self) -> Mapping[int, ca.SX]:
        """Return node -> Hessian of `stored_energy` with constant z, (n_axes, n_axes) [N/m]."""
        return {}


class NormalLaw(Protocol):
    """The numbers k, p and a."""

    @property
    def stiffness(self) -> Scalar:
        """k [N/m^p]."""

    @property
    def exponent(self) -> float:
        """p, 1.0 or 1.5."""

    @property
    def dissipation(self) -> Scalar:
        """a [s/m]."""


@dataclass
class NormalForce:
    """Force, energy, power and margin of one contact; depth: d [m], depth_rate: d' [m/s]."""

    law: NormalLaw
    depth: Scalar
    depth_rate: Scalar

    @cached_property
    def impact_factor(self) -> Scalar:
        """1 + a d'."""
        return 1.0 + self.law.dissipation * self.depth_rate

    @cached_property
    def elastic_force(self) -> Scalar:
        """The force k d^p without dissipation, in contact [N]."""
        root = 1.0 if self.law.exponent == 1.0 else ca.sqrt(ca.fabs(self.depth))
        return ca.if_else(self.depth > 0, self.law.stiffness * self.depth * root, 0)

    @cached_property
    def force(self) -> Scalar:
        """N [N]."""
        if not isinstance(self.law.dissipation, ca.SX) and not self.law.dissipation:
            return self.elastic_force
        return ca.if_else(self.impact_factor > 0, self.elastic_force * self.impact_factor, 0)

    def static_stiffness(self) -> Scalar:
        """Return dN/dd at rest, p k d^(p-1) in contact [N/m]."""
        p = self.law.exponent
        root = 1.0 if p == 1.0 else ca.sqrt(ca.fabs(self.depth))
        return ca.if_else(self.depth > 0, p * self.law.stiffness * root, 0)

    def energy(self) -> Scalar:
        """Return the energy of the compressed surfaces [J]."""
        return self.elastic_force * self.depth / (self.law.exponent + 1.0)

    def power(self) -> Scalar:
        """Return minus the loss of impacts [W]."""
        return (self.elastic_force - self.force) * self.depth_rate

    def margin(self) -> Scalar:
        """Return a length that is positive where the surfaces press each other."""
        return ca.fmin(self.depth, self.depth * self.impact_factor)
