"""Plastic members: an elastic spring in series with a slider that hardens, kinematically or isotropically.

t = mu (x - q),  X = (1 - b) Hp q,  R = Fy + b Hp a,  Hp = h mu / (1 - h)
|t - X| <= R;  q' = s mu x' / (mu + Hp) s and a' = |q'| while s (t - X) = R and s x' > 0,  s = 1 or -1

q: plastic elongation, a: accumulated |q'|, both [m]; e: `yield_elongation` Fy / mu [m]; h: `hardening`, the
slope of flow over that before it; b: `isotropic`, the share of the hardening that widens the elastic range
in place of moving it. All here is over mu, so that r = Hp / mu = h / (1 - h).

While a member flows, a - s q is constant and t - X = s R, hence q = (1 - h) (x - s (e + b r (a - s q))) and
the tension follows from x alone: integration errors of q do not come into it. A member in motion flows where
`pulled` or `pushed`, which events set, say so. At rest it is taken along a straight way from q and a to x,
which is the return mapping (Simo and Hughes, Computational Inelasticity, 1998, 1.4).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.tables.laws.law import (
    Columns,
    Law,
    LawCheck,
    LawParameter,
    Where,
    compute_spring_constant,
)

Scalar = Any
Values = Mapping[str, Any]

MARGIN_TIME = 1.0  # margins of unloading are rates of length times this [s]


class Plastic(Law):
    """An elastic-plastic member; see the module."""

    name = "plastic"
    parameters = (
        LawParameter("yield_elongation", "m", "Elongation at which plastic flow begins."),
        LawParameter("hardening", "1", "Slope of the law in plastic flow over that before it."),
        LawParameter("isotropic", "1", "Share of the hardening that widens the elastic range."),
    )
    keys = (("yield_elongation", "yield_force"),)
    optional_keys = (("hardening",), ("isotropic",))
    has_switch = False
    states = ("plastic", "accumulated")
    flags = ("pulled", "pushed")
    set_at = "yield"

    def effective_elongation(self, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return t / mu [m] at the elongation x [m]; at rest where `values` have no flags."""
        h, side = values["hardening"], self._side
        pulled, pushed = (h * x + (1.0 - h) * s * side(values, s) for s in (1.0, -1.0))
        return self._pick(x, values, where, pulled, pushed, x - values.get("plastic", 0.0))

    def slope(self, mu: Scalar, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return dt/dx, mu or h mu [N/m]."""
        h = values["hardening"]
        return mu * self._pick(x, values, where, h, h, 1.0)

    def energy(self, mu: Scalar, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return the energy at rest, with the dissipation of flow from the stated q and a on [J].

        mu ((x - q)^2 + r (1 - b) q^2 + r b a^2) / 2 behind the flow, and Fy |dq|: its derivative is t.
        """
        q, a = self.settle(x, self.at_rest(values), where)
        r, b, old = self._ratio(values), values["isotropic"], values.get("accumulated", 0.0)
        stored = (x - q) * (x - q) + r * ((1.0 - b) * q * q + b * a * a)
        return mu * (0.5 * stored + values["yield_elongation"] * (a - old))

    def largest_slope(self, values: Values, where: Where) -> Any:
        """Return 1: plastic flow is softer."""
        return 1.0

    def at_rest(self, values: Values) -> Values:
        """Return the values without the flags of a motion."""
        return {name: value for name, value in values.items() if name not in self.flags}

    def limit_slack(self, x: Scalar, values: Values, where: Where) -> Scalar:
        """Return x, or where a cable is slack the elongation at which it went slack, on a straight way [m].

        That is q; or, where it yields before, t = X - R = 0 in flow: (e + b r (a + q)) / r.
        """
        r, b, q = self._ratio(values), values["isotropic"], values["plastic"]
        yields_first = (1.0 - b) * r * q > self._radius(values)
        min_slack = where(yields_first, self._side(values, -1.0) / where(r > 0.0, r, 1.0), q)
        return where(x > min_slack, x, min_slack)

    def settle(self, x: Scalar, values: Values, where: Where) -> tuple[Scalar, Scalar]:
        """Return q and a [m] at the elongation x [m], behind the flow from those of `values` on."""
        q, a, h = values.get("plastic", 0.0), values.get("accumulated", 0.0), values["hardening"]
        pulled, pushed = ((1.0 - h) * (x - s * self._side(values, s)) for s in (1.0, -1.0))
        still = q
        if "pulled" in values:  # before the first event of a motion it may be beyond its limit
            still = self._pick(x, self.at_rest(values), where, pulled, pushed, q)
        state = self._pick(x, values, where, pulled, pushed, still)
        return state, a + where(state > q, state - q, q - state)

    def rates(
        self, motion: tuple[Scalar, Scalar], values: Values, where: Where, slack: bool
    ) -> tuple[Scalar, Scalar]:
        """Return q' and a' [m/s] at the rate x' [m/s]."""
        flow = (1.0 - values["hardening"]) * motion[1]
        pulled, pushed = (where(values[name] > 0.5, flow, 0.0) for name in self.flags)
        return pulled + pushed, pulled - pushed

    def margins(
        self, motion: tuple[Scalar, Scalar], values: Values, where: Where, slack: bool
    ) -> list[Scalar]:
        """Return the margins of a member against flow, pulled and pushed [m], positive without flow.

        motion: x and x'; slack: whether it is without force where slack. R - (t - X) and R + (t - X) over mu
        before flow, then -x' and x' times a time; a cable that goes slack does not flow.
        """
        x, rate = motion
        r, b, q, limit = self._ratio(values), values["isotropic"], values["plastic"], self._radius(values)
        y = self.effective_elongation(x, values, where)
        pull = where(x > q, x - q, 0.0) if slack else x - q
        push, back = -MARGIN_TIME * rate, MARGIN_TIME * rate
        if slack:
            back = where(back > -y, back, -y)
        force = pull - (1.0 - b) * r * q
        return [
            where(values["pulled"] > 0.5, push, limit - force),
            where(values["pushed"] > 0.5, back, limit + force),
        ]

    def find_rest_length(self, length: FloatArray, tension: FloatArray, given: Columns) -> FloatArray:
        """Return the rest lengths [m] without plastic flow; NaN for a tension beyond the yield force."""
        rest_length = super().find_rest_length(length, tension, given)
        stiffness = {key: given[key] for key in ("spring_constant", "axial_stiffness")}
        with np.errstate(all="ignore"):
            mu = compute_spring_constant(**stiffness, rest_length=rest_length)
            limit = self.find_parameters(given, mu)["yield_elongation"] * mu
        return np.where(np.abs(tension) > limit, np.nan, rest_length)

    def find_parameters(self, given: Columns, mu: FloatArray) -> dict[str, FloatArray]:
        """Return yield_elongation, Fy / mu of a force Fy, and hardening and isotropic."""
        e = given["yield_elongation"]
        with np.errstate(all="ignore"):
            e = np.where(np.isnan(e), given["yield_force"] / mu, e)
        return {"yield_elongation": e, "hardening": given["hardening"], "isotropic": given["isotropic"]}

    def check(self, member: Columns, tension_only: BoolArray) -> list[LawCheck]:
        """Return the members whose parameters are out of range."""
        e, h, b = (member[parameter.name] for parameter in self.parameters)
        return [
            LawCheck(~(e > 0), "yield_elongation", "a yield elongation that is not positive", "above 0"),
            LawCheck(~((h >= 0) & (h < 1)), "hardening", "hardening out of range", "0 up to below 1"),
            LawCheck(~((b >= 0) & (b <= 1)), "isotropic", "a share out of range", "0 to 1"),
        ]

    def _ratio(self, values: Values) -> Scalar:
        """Return r = Hp / mu."""
        return values["hardening"] / (1.0 - values["hardening"])

    def _radius(self, values: Values) -> Scalar:
        """Return R / mu [m]."""
        spread = values["isotropic"] * self._ratio(values)
        return values["yield_elongation"] + spread * values.get("accumulated", 0.0)

    def _side(self, values: Values, s: float) -> Scalar:
        """Return (R - s b Hp q) / mu [m], constant while a member flows along s."""
        spread = values["isotropic"] * self._ratio(values)
        return self._radius(values) - s * spread * values.get("plastic", 0.0)

    def _pick(
        self, x: Scalar, values: Values, where: Where, pulled: Scalar, pushed: Scalar, still: Scalar
    ) -> Scalar:
        """Return the one that holds: by the flags of a motion, or at rest by t - X of no flow."""
        if "pulled" in values:
            is_pulled, is_pushed = (values[name] > 0.5 for name in self.flags)
        else:
            q, limit = values.get("plastic", 0.0), self._radius(values)
            force = x - q - (1.0 - values["isotropic"]) * self._ratio(values) * q
            is_pulled, is_pushed = force > limit, force < -limit
        return where(is_pulled, pulled, where(is_pushed, pushed, still))
