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
Columns = Mapping[str, FloatArray]  # one value a member, NaN where none is given


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
    """Members that break a rule of their law: which, the scene's key, what is wrong, what is allowed."""

    is_broken: BoolArray
    key: str
    problem: str
    allowed: str


class Law:
    """A member law; subclasses override what differs from a linear spring.

    A member follows the law whose parameters it has; the first of them must not be zero. Members without any
    are linear springs.
    """

    name = "linear"
    parameters: tuple[LawParameter, ...] = ()
    keys: tuple[tuple[str, ...], ...] = ()  # keys of a scene; those of one group replace each other

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
        """Return dt/drho [N/m] at a constant length; member: all values of the member."""
        rest = member["rest_length"]
        return -(member["spring_constant"] + member["axial_stiffness"] / (rest * rest) * length)

    def largest_slope(self, values: Mapping[str, Any], where: Where) -> Any:
        """Return the largest y' of all elongations."""
        return 1.0

    def switch(self, x: Scalar, values: Mapping[str, Any]) -> Scalar:
        """Return a length [m] whose sign changes where the slope jumps; only for laws with parameters."""
        raise NotImplementedError

    def find_rest_length(self, length: FloatArray, tension: FloatArray, given: Columns) -> FloatArray:
        """Return the rest lengths [m] at which members of `length` [m] have `tension` [N].

        given: the scene's values; the stiffness that a member does not have is 0. Not positive or not finite
        where there is none.
        """
        with np.errstate(all="ignore"):
            by_spring = length - tension / given["spring_constant"]
            by_axial = given["axial_stiffness"] * length / (given["axial_stiffness"] + tension)
        result: FloatArray = np.where(given["axial_stiffness"] > 0, by_axial, by_spring)
        return result

    def find_parameters(self, given: Columns, mu: FloatArray) -> dict[str, FloatArray]:
        """Return the parameters that the scene's keys stand for, 0 where a member has none."""
        return {}

    def check(self, member: Mapping[str, Any], tension_only: BoolArray) -> list[LawCheck]:
        """Return the rules of the law that members break; member: arrays of all values, by name."""
        return []
