"""The face of a force on nodes: its values, what it stores and loses, what it remembers, its margins."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

Scalar = Any
Vector = list[Scalar]


class NodeForce(ABC):
    """A force on some nodes, as expressions of the state (q, q', z) and of the arguments."""

    @abstractmethod
    def forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it, over the modelled axes [N]."""

    @abstractmethod
    def stored_energy(self) -> Scalar:
        """Return the energy that it can give back [J]."""

    @abstractmethod
    def powers(self) -> Mapping[str, Scalar]:
        """Return what it adds to the total energy, by "impact", "friction" and "belt" [W]."""

    def static_forces(self) -> Mapping[int, Vector]:
        """Return node -> force on it at rest, minus the gradient of `stored_energy` [N].

        What it remembers follows the nodes along this force: the derivative of z is that of the positions.
        None where equilibria do not know the force: see structure/collision.py.
        """
        return {}

    def static_stiffness(self) -> Mapping[int, ca.SX]:
        """Return node -> Hessian of `stored_energy` with constant z, (n_axes, n_axes) [N/m]."""
        return {}

    def internal_rate(self) -> list[Scalar]:
        """Return the rates z' of its internal states, in the order of their names."""
        return []

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return quantity name -> builder of what it offers, margins among them."""
        return {}
