"""A member at one place: tension and its partial derivatives from length, rate and rest length.

                  t > 0 pulls the ends together
    i  o---->----------------<----o  j        l = |r_i - r_j|
       -t d/l               +t d/l

mu = k + EA / rho          one of the two stiffnesses is zero (S&K 2; SCS uses EA)
t  = mu y(l - rho) + c l'  two-sided; y(x) = x for linear springs, see `laws`
t  = max(0, that) while l > rho, else 0: a cable never pushes, slack or damped
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

from tensegrity_codegen.tables.laws import LAW_PARAMETERS, find_law
from tensegrity_codegen.tables.laws.law import Law, compute_spring_constant

Scalar = Any


@dataclass(frozen=True)
class MemberLaw:
    """One member's law at one place; all fields are scalar expressions in SI units."""

    length: Scalar
    rate: Scalar
    rest_length: Scalar
    spring_constant: Scalar
    axial_stiffness: Scalar
    damping: Scalar
    tension_only: bool
    law_parameter: Mapping[str, Scalar] = field(default_factory=dict)

    @cached_property
    def law(self) -> Law:
        """Return the law that the member follows."""
        given = self.law_parameter
        return find_law(lambda name: name in given and not given[name].is_zero())

    @property
    def mu(self) -> Scalar:
        """Return the spring constant mu = k + EA / rho [N/m]."""
        return compute_spring_constant(self.spring_constant, self.axial_stiffness, self.rest_length)

    @property
    def extension(self) -> Scalar:
        """Return l - rho [m]."""
        return self.length - self.rest_length

    def margin(self) -> Scalar:
        """Return l - rho [m], or y + c l' / mu if that is less: a cable pulls while it is positive."""
        if self.damping.is_zero():
            return self.extension
        # The quotient first, so that constants meet before the rate.
        return ca.fmin(self.extension, self._effective + self.damping / self.mu * self.rate)

    def static_tension(self) -> Scalar:
        """Return mu y(l - rho) [N], zero when slack."""
        return self._if_taut(self.mu * self._effective)

    def tension(self) -> Scalar:
        """Return the tension with damping [N], positive in tension, never negative in a cable."""
        return self._if_pulling(self._raw_tension())

    # The division stays outside the branch: CasADi moves a product into it, one branch for each component.

    def static_force_density(self) -> Scalar:
        """Return the static tension over the length [N/m], not a number where the ends coincide."""
        return self.static_tension() / self.length

    def force_density(self) -> Scalar:
        """Return the tension with damping over the length [N/m], not a number where the ends coincide."""
        return self.tension() / self.length

    def energy(self) -> Scalar:
        """Return the strain energy [J], zero when slack."""
        return self._if_taut(self.law.energy(self.mu, self.extension, self.law_parameter, ca.if_else))

    def static_tension_by_length(self) -> Scalar:
        """Return dt/dl without damping [N/m]."""
        return self._if_taut(self._slope)

    def tension_by_length(self) -> Scalar:
        """Return dt/dl at constant rate [N/m]."""
        return self._if_pulling(self._slope)

    def tension_by_rate(self) -> Scalar:
        """Return dt/dl' [N s/m]."""
        return self._if_pulling(self.damping)

    def static_tension_by_rest_length(self) -> Scalar:
        """Return dt/drho at constant length without damping [N/m]."""
        return self._if_taut(self._slope_by_rest_length)

    def tension_by_rest_length(self) -> Scalar:
        """Return dt/drho at constant length and rate [N/m]."""
        return self._if_pulling(self._slope_by_rest_length)

    def switch(self) -> Scalar:
        """Return a length [m] whose sign changes where the slope of the law jumps, rest length apart."""
        return self.law.switch(self.extension, self.law_parameter)

    def largest_mu(self) -> Scalar:
        """Return the largest slope dt/dl of the law [N/m]."""
        if self.law.is_linear:
            return self.mu
        return self.mu * self.law.largest_slope(self.law_parameter, ca.if_else)

    @property
    def _effective(self) -> Scalar:
        return self.law.effective_elongation(self.extension, self.law_parameter, ca.if_else)

    @property
    def _slope(self) -> Scalar:
        return self.law.slope(self.mu, self.extension, self.law_parameter, ca.if_else)

    @property
    def _slope_by_rest_length(self) -> Scalar:
        values = {
            "spring_constant": self.spring_constant,
            "axial_stiffness": self.axial_stiffness,
            "rest_length": self.rest_length,
            **self.law_parameter,
        }
        return self.law.slope_by_rest_length(values, self.length, ca.if_else)

    def _raw_tension(self) -> Scalar:
        return self.mu * self._effective + self.damping * self.rate

    def _if_taut(self, value: Scalar) -> Scalar:
        return ca.if_else(self.rest_length < self.length, value, 0) if self.tension_only else value

    def _if_pulling(self, value: Scalar) -> Scalar:
        if not self.tension_only or self.damping.is_zero():
            return self._if_taut(value)
        pulling = ca.logic_and(self.rest_length < self.length, self._raw_tension() > 0)
        return ca.if_else(pulling, value, 0)


def build_law(length: Scalar, rate: Scalar, values: Mapping[str, Scalar], tension_only: bool) -> MemberLaw:
    """Return the law of a member with these values of MEMBER_VALUES, at a length [m] and its rate [m/s]."""
    own = {name: value for name, value in values.items() if name in LAW_PARAMETERS}
    others = {name: value for name, value in values.items() if name not in LAW_PARAMETERS}
    return MemberLaw(length=length, rate=rate, tension_only=tension_only, law_parameter=own, **others)
