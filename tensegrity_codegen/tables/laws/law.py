"""The interface of member laws: tension, derivatives, energy, switches; for numbers and expressions.

A law says how the tension t of a member at rest follows from its elongation x = l - rho. It scales with the
spring constant mu = k + EA / rho at rest length:

    t = mu y(x)        y: effective elongation [m], y(0) = 0, y'(0) = 1

The functions take NumPy arrays as well as CasADi expressions: `where(condition, a, b)` is `np.where` for the
former and `ca.if_else` for the latter. Slack and damping are the same for all laws, see `MemberLaw`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray

Scalar = Any  # a number, an array or an expression
Where = Callable[[Any, Any, Any], Any]
Columns = Mapping[str, FloatArray]  # one value a member, NaN if none is given


def compute_spring_constant(spring_constant: Any, axial_stiffness: Any, rest_length: Any) -> Any:
    """Return mu = k + EA / rho [N/m], the slope of a law at rest length (S&K 2; SCS uses EA)."""
    return spring_constant + axial_stiffness / rest_length


@dataclass(frozen=True)
class LawParameter:
    """A value of a member that a law has beyond rest length, stiffness and damping."""

    name: str
    unit: str
    sentence: str


@dataclass(frozen=True)
class LawCheck:
    """Members that break a rule of their law: which, the scene's key, the fault, the allowed values."""

    is_broken: BoolArray
    key: str
    problem: str
    allowed: str


class Law:
    """A member law; subclasses override its differences from a linear spring.

    A member follows the law whose parameters it has; the first of them must not be zero. Members without any
    are linear springs.
    """

    name = "linear"
    parameters: tuple[LawParameter, ...] = ()
    keys: tuple[tuple[str, ...], ...] = ()  # keys of a scene; those of one group replace each other
    optional_keys: tuple[tuple[str, ...], ...] = ()  # which may be left out, for 0
    has_switch = True  # whether the slope jumps at a place, see `switch`
    # Internal states of a member with memory: NAME_STATE with rates, and NAME_FLAG_WORD, which events of the
    # kind `set_at` set; see `rates`, `margins` and structure/memory.py.
    states: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    set_at = ""

    @property
    def is_linear(self) -> bool:
        """Whether the tension is mu x; other laws are not part of mixed forms."""
        return not self.parameters

    def effective_elongation(self, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return y [m] at the elongation x [m]."""
        return x

    def slope(self, mu: Scalar, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return dt/dx = mu y' [N/m]."""
        return mu

    def energy(self, mu: Scalar, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return the strain energy, the integral of mu y from 0 to x [J]."""
        return 0.5 * mu * x * x

    def slope_by_rest_length(self, member: Mapping[str, Any], length: Scalar, where: Where) -> Scalar:
        """Return dt/drho = -mu y' - (EA / rho^2) y [N/m] at a constant length; member: all its values."""
        rest_length, axial = member["rest_length"], member["axial_stiffness"]
        if self.is_linear:
            return -(member["spring_constant"] + axial / (rest_length * rest_length) * length)
        x, mu = length - rest_length, member["spring_constant"] + axial / rest_length
        y = self.effective_elongation(x, member, where)
        return -(self.slope(mu, x, member, where) + axial / (rest_length * rest_length) * y)

    def largest_slope(self, values: Mapping[str, Any], where: Where) -> Any:
        """Return the largest y' of all elongations."""
        return 1.0

    def switch(self, x: Scalar, values: Mapping[str, Any]) -> Scalar:
        """Return a length [m] whose sign changes where the slope jumps; only for laws with a switch."""
        raise NotImplementedError

    # Members with memory: the functions above take the names of `states` and `flags` among their values.

    def at_rest(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values for the law at rest, without flags of events and independent of time."""
        return values

    def limit_slack(self, x: Scalar, values: Mapping[str, Any], where: Where) -> Scalar:
        """Return x [m], or where a cable is slack the elongation from which it was."""
        raise NotImplementedError

    def settle(self, x: Scalar, values: Mapping[str, Any], where: Where) -> tuple[Scalar, ...]:
        """Return the states at the elongation x [m], reached from those of `values` on a straight way."""
        raise NotImplementedError

    def rates(
        self, motion: tuple[Scalar, Scalar], values: Mapping[str, Any], where: Where, slack: bool
    ) -> tuple[Scalar, ...]:
        """Return the rates of the states [m/s] at x and x'; slack: of a cable."""
        raise NotImplementedError

    def margins(
        self, motion: tuple[Scalar, Scalar], values: Mapping[str, Any], where: Where, slack: bool
    ) -> list[Scalar]:
        """Return the margins at x and x', whose flags are 0 while they are positive; slack: of a cable."""
        raise NotImplementedError

    def find_rest_length(self, length: FloatArray, tension: FloatArray, given: Columns) -> FloatArray:
        """Return the rest lengths [m] at which members of `length` [m] have `tension` [N].

        given: the scene's values; the stiffness that a member does not have is 0. Not positive or not finite
        if there is none.
        """
        with np.errstate(all="ignore"):
            by_spring = length - tension / given["spring_constant"]
            by_axial = given["axial_stiffness"] * length / (given["axial_stiffness"] + tension)
        result: FloatArray = np.where(given["axial_stiffness"] > 0, by_axial, by_spring)
        return result

    def find_parameters(self, given: Columns, mu: FloatArray) -> dict[str, FloatArray]:
        """Return the parameters that the scene's keys stand for, 0 if a member has none."""
        return {}

    def check(self, member: Mapping[str, Any], tension_only: BoolArray) -> list[LawCheck]:
        """Return the rules of the law that members break; member: arrays of all values, by name."""
        return []
