"""Viscous members: a spring in series with a spring and a dashpot side by side, the standard linear solid.

t = mu (x - p) = k p + c p',  k = h mu / (1 - h),  c = T mu / (1 - h):  p' = ((1 - h) x - p) / T

p: `viscous` elongation of spring and dashpot [m]; h: `relaxed_fraction`, the stiffness after infinite time
over that at once; T: `relaxation_time` at a constant length [s] (Zener, Elasticity and Anelasticity of
Metals, 1948). A cable is slack while x <= p; then t = 0 and p' = -h p / T, which is the same line with p for
x. At rest, after infinite time, p = (1 - h) x and t = h mu x.
"""

from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.tables.laws.law import Columns, Law, LawCheck, LawParameter, Where

Scalar = Any
Values = Mapping[str, Any]


class Viscous(Law):
    """A member that relaxes; see the module."""

    name = "viscous"
    parameters = (
        LawParameter("relaxation_time", "s", "Time constant of the tension at a constant length."),
        LawParameter("relaxed_fraction", "1", "Stiffness after infinite time over that at once."),
    )
    keys = (("relaxation_time",), ("relaxed_fraction",))
    has_switch = False
    states = ("viscous",)

    def effective_elongation(self, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return t / mu [m] at the elongation x [m]; at rest where `values` have no state."""
        return x - values["viscous"] if "viscous" in values else values["relaxed_fraction"] * x

    def slope(self, mu: Scalar, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return dt/dx, mu in motion and h mu at rest [N/m]."""
        return mu if "viscous" in values else mu * values["relaxed_fraction"]

    def energy(self, mu: Scalar, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return the energy of both springs, mu ((x - p)^2 + h / (1 - h) p^2) / 2 [J]."""
        h, p = values["relaxed_fraction"], values.get("viscous", self.settle(x, values, where)[0])
        return 0.5 * mu * ((x - p) * (x - p) + h / (1.0 - h) * (p * p))

    def at_rest(self, values: Values) -> Values:
        """Return the values without the state of a motion."""
        return {name: value for name, value in values.items() if name not in self.states}

    def limit_slack(self, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return x, or where a cable is slack the elongation below which it is: p, or 0 at rest [m]."""
        min_slack = values.get("viscous", 0.0)
        return where(x > min_slack, x, min_slack)

    def settle(self, x: Scalar, values: Values, where: Where) -> tuple[Scalar]:
        """Return p [m] after infinite time at the elongation x [m]."""
        return ((1.0 - values["relaxed_fraction"]) * x,)

    def rates(
        self, motion: tuple[Scalar, Scalar], values: Values, where: Where, slack: bool
    ) -> tuple[Scalar]:
        """Return p' [m/s]."""
        x = self.limit_slack(motion[0], values, where) if slack else motion[0]
        return (((1.0 - values["relaxed_fraction"]) * x - values["viscous"]) / values["relaxation_time"],)

    def find_rest_length(self, length: FloatArray, tension: FloatArray, given: Columns) -> FloatArray:
        """Return the rest lengths [m] at which relaxed members have `tension` [N]."""
        return super().find_rest_length(length, tension / given["relaxed_fraction"], given)

    def find_parameters(self, given: Columns, mu: FloatArray) -> dict[str, FloatArray]:
        """Return both parameters, which are keys of the scene."""
        return {parameter.name: given[parameter.name] for parameter in self.parameters}

    def check(self, member: Columns, tension_only: BoolArray) -> list[LawCheck]:
        """Return the members whose parameters are out of range."""
        time, h = (member[parameter.name] for parameter in self.parameters)
        problem = "a fraction of the stiffness out of range"
        return [
            LawCheck(~(time > 0), "relaxation_time", "a time that is not positive", "above 0"),
            LawCheck(~((h > 0) & (h < 1)), "relaxed_fraction", problem, "above 0 and below 1"),
        ]
