"""The face of a force on nodes: its values, what it stores and loses, what it remembers, its margins."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.memory import Memory

Scalar = Any
Vector = list[Scalar]


class NodeForce(Memory):
    """A force on some nodes, as expressions of the state (q, q', z) and of the arguments."""

    @abstractmethod
    def forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it, over the modelled axes [N]."""

    def static_forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it at rest, minus the gradient of `stored_energy` [N].

        What it remembers follows the nodes along this force: the derivative of z is that of the positions.
        None where equilibria do not know the force: see structure/collision.py.
        """
        return {}

    def static_stiffness(self) -> Mapping[int, ca.SX]:
        """Return node -> Hessian of `stored_energy` with constant z, (n_axes, n_axes) [N/m]."""
        return {}
