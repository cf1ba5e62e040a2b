"""Bilinear members: two slopes, with a switch at a stated elongation.

y(x) = x                        before the switch
y(x) = s + q (x - s)            beyond it, (x - s) s > 0

s: `switch_elongation` [m], positive in tension, negative in compression; q: `stiffness_ratio`, the second
slope over the first, below or above 1. Tension and energy are continuous, the slope jumps at x = s.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.laws.law import Columns, Law, LawCheck, LawParameter, Where

Scalar = Any


class Bilinear(Law):
    """Two slopes; see the module."""

    name = "bilinear"
    parameters = (
        LawParameter("switch_elongation", "m", "Elongation at which the slope switches."),
        LawParameter("stiffness_ratio", "1", "Slope beyond the switch over the slope before it."),
    )
    keys = (("switch_elongation", "switch_force"), ("stiffness_ratio",))

    def effective_elongation(self, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return y [m] at the elongation x [m]."""
        return x + (values["stiffness_ratio"] - 1.0) * self._beyond(x, values, where)

    def slope(self, mu: Scalar, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return dt/dx = mu y' [N/m]; at the switch that before it."""
        is_beyond = self._is_beyond(x, values)
        return mu * (1.0 + where(is_beyond, values["stiffness_ratio"] - 1.0, 0.0))

    def energy(self, mu: Scalar, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return mu (x^2 + (q - 1) b^2) / 2 [J] with b = x - s beyond the switch, else 0."""
        beyond = self._beyond(x, values, where)
        return 0.5 * mu * (x * x + (values["stiffness_ratio"] - 1.0) * beyond * beyond)

    def largest_slope(self, values: Mapping[str, Any], where: Where) -> Any:
        """Return the larger of 1 and q."""
        return where(values["stiffness_ratio"] > 1.0, values["stiffness_ratio"], 1.0)

    def switch(self, x: Scalar, values: Mapping[str, Any]) -> Scalar:
        """Return x - s [m]."""
        return x - values["switch_elongation"]

    def find_rest_length(self, length: FloatArray, tension: FloatArray, given: Columns) -> FloatArray:
        """Return the rest lengths [m] at which members of `length` [m] have `tension` [N].

        Before the switch as of linear springs. Beyond it with k: q x = t / k + (q - 1) s, rho = l - x; with
        EA and s: (q EA + t) x = t l + (q - 1) EA s; with EA and the force F of the switch:
        rho = q EA l / (q EA + t + (q - 1) F).
        """
        k, axial, force = given["spring_constant"], given["axial_stiffness"], given["switch_force"]
        s, q, is_axial = given["switch_elongation"], given["stiffness_ratio"], given["axial_stiffness"] > 0
        linear = super().find_rest_length(length, tension, given)
        with np.errstate(all="ignore"):
            at = np.where(np.isnan(s), force / k, s)
            by_spring = length - (tension / k + (q - 1.0) * at) / q
            by_elongation = length - (tension * length + (q - 1.0) * axial * s) / (q * axial + tension)
            by_force = q * axial * length / (q * axial + tension + (q - 1.0) * force)
            by_axial = np.where(np.isnan(s), by_force, by_elongation)
            is_beyond = np.where(np.isnan(s), (tension - force) * force > 0, (length - linear - s) * s > 0)
        return np.where(is_beyond, np.where(is_axial, by_axial, by_spring), linear)

    def find_parameters(self, given: Columns, mu: FloatArray) -> dict[str, FloatArray]:
        """Return switch_elongation, F / mu of a force F, and stiffness_ratio."""
        s = given["switch_elongation"]
        with np.errstate(all="ignore"):
            at = np.where(np.isnan(s), given["switch_force"] / mu, s)
        return {"switch_elongation": at, "stiffness_ratio": given["stiffness_ratio"]}

    def check(self, member: Mapping[str, Any], tension_only: NDArray[np.bool_]) -> list[LawCheck]:
        """Return the members with a negative ratio, and the cables with a switch where they are slack."""
        at, ratio = member["switch_elongation"], member["stiffness_ratio"]
        cable = "a cable that is slack where its law switches"
        return [
            LawCheck(ratio < 0, "stiffness_ratio", "a negative ratio of stiffnesses", "0 or more"),
            LawCheck(tension_only & (at < 0), "switch_elongation", cable, "more than 0"),
        ]

    def _is_beyond(self, x: Scalar, values: Mapping[str, Any]) -> Scalar:
        return (x - values["switch_elongation"]) * values["switch_elongation"] > 0

    def _beyond(self, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        return where(self._is_beyond(x, values), x - values["switch_elongation"], 0.0)
