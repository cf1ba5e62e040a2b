"""Motors with a time constant: their values follow commands with a lag and a largest rate, as expressions.

u' = clip((command - u) / tau, -rate, rate), with u an internal state; the margin rate tau - |command - u| is
positive where the rate is not limited. The field is continuous: an event there is a kink.
"""

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.memory import Memory

Scalar = Any


class Motors(Memory):
    """All motors of a structure that have a time constant."""

    def __init__(self, arguments: SymbolicArguments) -> None:
        self.arguments = arguments
        self.lagging = arguments.structure.lagging_actuators

    def stored_energy(self) -> Scalar:
        """Return 0."""
        return ca.SX(0.0)

    def powers(self) -> Mapping[str, Scalar]:
        """Return none: what motors do to the energy is not counted."""
        return {}

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the rates of the motors [m/s]."""
        return self.arguments.motor_rate

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builder of the margins of all motors."""
        return {"motor_margin": lambda: ca.vertcat(*map(self._margin, self.lagging.values()))}

    def _margin(self, item: Actuator) -> Scalar:
        """Return how far a motor is below its largest rate, times its time constant [m]; 1 without one."""
        if not item.has_rate:
            return ca.SX(1.0)
        return item.rate * item.time_constant - ca.fabs(self.arguments.lag[item.name])
