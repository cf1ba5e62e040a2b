"""A member at one place: tension and its partial derivatives from length, rate and rest length.

                  t > 0 pulls the ends together
    i  o---->----------------<----o  j        l = |r_i - r_j|
       -t d/l               +t d/l

mu = k + EA / rho          one of the two stiffnesses is zero (S&K 2; SCS uses EA)
t  = mu y(l - rho) + c l'  two-sided; y(x) = x for linear springs, see `laws`
t  = max(0, that) while l > rho, else 0: a cable never pushes, slack or damped; with memory while y > 0
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from tensegrity_codegen.symbolic.geometry import Scalar
from tensegrity_codegen.tables.laws import LAW_PARAMETERS, MEMBER_VALUES, find_law
from tensegrity_codegen.tables.laws.law import Law, compute_spring_constant


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
        parameter = self.law_parameter
        return find_law(lambda name: name in parameter and not parameter[name].is_zero())

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
        y = self._moving
        lower = y if self.law.states else self.extension
        if self.damping.is_zero():
            return lower
        # The quotient first, so that constants meet before the rate.
        return ca.fmin(lower, y + self.damping / self.mu * self.rate)

    def static_tension(self) -> Scalar:
        """Return mu y(l - rho) [N], zero when slack."""
        return self._if_taut(self.mu * self._effective)

    def undamped_tension(self) -> Scalar:
        """Return the tension of a motion without damping [N]: at rest the same but of viscous members."""
        if not self.law.states or self.law.flags:
            return self.static_tension()
        return self._if_taut(self.mu * self._moving, self._moving)

    def tension(self) -> Scalar:
        """Return the tension with damping [N], positive in tension, never negative in a cable."""
        return self._if_pulling(self._raw_tension())

    # The division stays outside the branch: CasADi moves a product into it, one branch for each component.

    def force_density(self) -> Scalar:
        """Return the tension with damping over the length [N/m], at length 0 not a number unless slack."""
        return self.tension() / self.length

    def energy(self) -> Scalar:
        """Return the strain energy [J], zero when slack; with memory also that of the memory."""
        if self.law.states:
            parameter, x = self.law_parameter, self.extension
            x = self.law.limit_slack(x, parameter, ca.if_else) if self.tension_only else x
            return self.law.energy(self.mu, x, parameter, ca.if_else)
        return self._if_taut(self.law.energy(self.mu, self.extension, self.law_parameter, ca.if_else))

    def static_tension_by_length(self) -> Scalar:
        """Return dt/dl without damping [N/m]."""
        return self._if_taut(self._slope)

    def tension_by_length(self) -> Scalar:
        """Return dt/dl at constant rate [N/m]."""
        return self._if_pulling(self.law.slope(self.mu, self.extension, self.law_parameter, ca.if_else))

    def tension_by_rate(self) -> Scalar:
        """Return dt/dl' [N s/m]."""
        return self._if_pulling(self.damping)

    def static_tension_by_rest_length(self) -> Scalar:
        """Return dt/drho at constant length without damping [N/m]."""
        return self._if_taut(self._slope_by_rest_length(self.law.at_rest(self.law_parameter)))

    def tension_by_rest_length(self) -> Scalar:
        """Return dt/drho at constant length and rate [N/m]."""
        return self._if_pulling(self._slope_by_rest_length(self.law_parameter))

    def switch(self) -> Scalar:
        """Return a length [m] whose sign changes where the slope of the law jumps, rest length apart."""
        return self.law.switch(self.extension, self.law_parameter)

    def largest_mu(self) -> Scalar:
        """Return the largest slope dt/dl of the law [N/m]."""
        if self.law.is_linear:
            return self.mu
        return self.mu * self.law.largest_slope(self.law_parameter, ca.if_else)

    def settled(self) -> tuple[Scalar, ...]:
        """Return the internal states behind what the member has done, see Law.settle."""
        x = self.extension
        if self.tension_only:
            x = self.law.limit_slack(x, self.law.at_rest(self.law_parameter), ca.if_else)
        return self.law.settle(x, self.law_parameter, ca.if_else)

    def memory_margins(self, rate: Scalar) -> list[Scalar]:
        """Return the margins of the memory [m], see Law.margins; rate: of the elongation [m/s]."""
        motion = (self.extension, rate)
        return self.law.margins(motion, self.law_parameter, ca.if_else, self.tension_only)

    @property
    def _effective(self) -> Scalar:
        """Effective elongation at rest."""
        at_rest = self.law.at_rest(self.law_parameter)
        return self.law.effective_elongation(self.extension, at_rest, ca.if_else)

    @property
    def _moving(self) -> Scalar:
        """Effective elongation in motion, where memory flows as its states say."""
        return self.law.effective_elongation(self.extension, self.law_parameter, ca.if_else)

    @property
    def _slope(self) -> Scalar:
        at_rest = self.law.at_rest(self.law_parameter)
        return self.law.slope(self.mu, self.extension, at_rest, ca.if_else)

    def _slope_by_rest_length(self, law_parameter: Mapping[str, Scalar]) -> Scalar:
        values = {
            "spring_constant": self.spring_constant,
            "axial_stiffness": self.axial_stiffness,
            "rest_length": self.rest_length,
            **law_parameter,
        }
        return self.law.slope_by_rest_length(values, self.length, ca.if_else)

    def _raw_tension(self) -> Scalar:
        return self.mu * self._moving + self.damping * self.rate

    def _if_taut(self, value: Scalar, effective: Scalar = None) -> Scalar:
        """Return the value, 0 of a slack cable; effective: elongation in motion, None: at rest."""
        if not self.tension_only:
            return value
        if self.law.states:
            return ca.if_else((self._effective if effective is None else effective) > 0, value, 0)
        return ca.if_else(self.rest_length < self.length, value, 0)

    def _if_pulling(self, value: Scalar) -> Scalar:
        if not self.tension_only or self.damping.is_zero():
            return self._if_taut(value, self._moving)
        taut = self._moving > 0 if self.law.states else self.rest_length < self.length
        return ca.if_else(ca.logic_and(taut, self._raw_tension() > 0), value, 0)


def build_law(length: Scalar, rate: Scalar, values: Mapping[str, Scalar], tension_only: bool) -> MemberLaw:
    """Return the law of a member, at a length [m] and its rate [m/s].

    values: those of MEMBER_VALUES, and the internal states of a law with memory, by their names there.
    """
    stiffness_values = {name: values[name] for name in MEMBER_VALUES if name not in LAW_PARAMETERS}
    parameters = {name: value for name, value in values.items() if name not in stiffness_values}
    return MemberLaw(
        length=length, rate=rate, tension_only=tension_only, law_parameter=parameters, **stiffness_values
    )
