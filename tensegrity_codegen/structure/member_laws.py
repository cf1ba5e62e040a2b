"""Laws of the members of a structure or of a body system, as arrays."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.laws import LAW_PARAMETERS, LAWS, LINEAR, MEMBER_VALUES, find_law
from tensegrity_codegen.tables.laws.law import Law, compute_spring_constant

# Values that follow from the section of a member, by the names of the attributes.
SECTION_VALUES = ("section_area", "gyration_square")

MAX_REST_LENGTH_RATIO = 1e3  # rest length, over the length, up to which one is searched for
BISECTIONS = 100


class WithMemberLaws:
    """Values that follow from the member arrays of structures and body systems."""

    member_name: tuple[str, ...]
    tension_only: BoolArray
    rest_length: FloatArray
    spring_constant: FloatArray
    axial_stiffness: FloatArray
    law_parameter: Mapping[str, FloatArray]
    radius: FloatArray
    inner_radius: FloatArray | None

    def member_value(self, name: str) -> FloatArray:
        """Return a value of MEMBER_VALUES of all members, (n_members,); 0 if a law has none."""
        if name in LAW_PARAMETERS:
            return self.law_parameter.get(name, np.zeros(len(self.member_name)))
        values: FloatArray = getattr(self, name)
        return values

    def member_values(self) -> dict[str, FloatArray]:
        """Return all values that member laws take, by name, each (n_members,)."""
        return {name: self.member_value(name) for name in MEMBER_VALUES}

    @property
    def mu(self) -> FloatArray:
        """(n_members,): spring constants at rest length, mu = k + EA / rho [N/m]; 0 of rigid bars."""
        mu: FloatArray = compute_spring_constant(self.spring_constant, self.axial_stiffness, self.rest_length)
        return mu

    @property
    def section_area(self) -> FloatArray:
        """(n_members,): area of the round section, pi (R^2 - r^2) [m2]; 0 without a radius."""
        return np.asarray(np.pi * (self.radius**2 - self._inner_square))

    @property
    def gyration_square(self) -> FloatArray:
        """(n_members,): second moment of the section over its area, (R^2 + r^2) / 4 [m2]."""
        return np.asarray((self.radius**2 + self._inner_square) / 4)

    @property
    def flexural_rigidity(self) -> FloatArray:
        """(n_members,): E I [N m2], with E A = mu rho of the unstrained member; 0 without a radius."""
        return np.asarray(self.mu * self.rest_length * self.gyration_square)

    @property
    def _inner_square(self) -> FloatArray | float:
        return 0.0 if self.inner_radius is None else self.inner_radius**2

    @cached_property
    def members_of_law(self) -> tuple[tuple[Law, BoolArray], ...]:
        """Each law that members follow, with the (n_members,) mask of these."""
        masks = [
            (law, self.member_value(law.parameters[0].name) != 0)
            for law in LAWS
            if law.parameters and law.parameters[0].name in self.law_parameter
        ]
        is_linear = np.ones(len(self.member_name), dtype=np.bool_)
        for _, mask in masks:
            is_linear &= ~mask
        return ((LINEAR, is_linear), *((law, mask) for law, mask in masks if mask.any()))

    def law_of(self, e: int) -> Law:
        """Return the law of member e."""
        return find_law(lambda name: self.member_value(name)[e])

    @property
    def is_linear(self) -> BoolArray:
        """(n_members,): members whose tension is mu (l - rho) while they are taut."""
        return self.members_of_law[0][1]

    @property
    def is_mixed(self) -> BoolArray:
        """(n_members,): two-sided linear members, whose tensions are unknowns of the mixed form."""
        return ~self.tension_only & self.is_linear

    @property
    def has_switch(self) -> BoolArray:
        """(n_members,): members whose law has a slope that jumps at some elongation beside rest length."""
        return self._join_masks(lambda law: law.has_switch)

    @property
    def remembers(self) -> BoolArray:
        """(n_members,): members with memory, whose law has internal states."""
        return self._join_masks(lambda law: bool(law.states))

    @property
    def yields(self) -> BoolArray:
        """(n_members,): plastic members, whose memory events of their flow set."""
        return self._join_masks(lambda law: law.set_at == "yield")

    @property
    def relaxes(self) -> BoolArray:
        """(n_members,): viscous members, whose memory changes with time alone."""
        return self.remembers & ~self.yields

    def _join_masks(self, is_wanted: Callable[[Law], bool]) -> BoolArray:
        joined = np.zeros(len(self.member_name), dtype=np.bool_)
        for law, mask in self.members_of_law[1:]:
            joined |= mask & is_wanted(law)
        return joined

    def largest_slope(self) -> FloatArray:
        """Return the largest slope of each member's law over that at rest length, (n_members,)."""
        factor = np.ones(len(self.member_name))
        for law, mask in self.members_of_law[1:]:
            values = {name: values[mask] for name, values in self.member_values().items()}
            factor[mask] = law.largest_slope(values, np.where)
        return factor

    def compute_static_tension(self, length: FloatArray) -> FloatArray:
        """Return tensions without damping at these lengths [m], (n_members,) [N]; 0 of rigid bars."""
        extension = length - self.rest_length
        tension = self.mu * extension
        for law, mask in self.members_of_law[1:]:
            values = {name: values[mask] for name, values in self.member_values().items()}
            tension[mask] = self.mu[mask] * law.effective_elongation(extension[mask], values, np.where)
        result: FloatArray = np.where(self.tension_only & (extension <= 0), 0.0, tension)
        return result

    def find_rest_length(self, length: FloatArray, tension: FloatArray) -> FloatArray:
        """Return the rest lengths [m] at which members of these lengths have these tensions [N].

        Not positive or not finite where there is none. Laws that are not linear are solved by bisection: the
        tension of a member decreases with its rest length.
        """
        stiffness = {"spring_constant": self.spring_constant, "axial_stiffness": self.axial_stiffness}
        rest_length = LINEAR.find_rest_length(length, tension, stiffness)
        curved = ~self.is_linear
        if curved.any():
            rest_length = np.where(curved, self._bisect_rest_length(length, tension), rest_length)
        return rest_length

    def require_rest_length(self, length: FloatArray, tension: FloatArray, hint: str) -> FloatArray:
        """Return the rest lengths of find_rest_length; rigid members keep those that they have."""
        rigid = (self.spring_constant == 0) & (self.axial_stiffness == 0)
        rest_length = self.find_rest_length(length, tension)
        bad = ~(np.isfinite(rest_length) & (rest_length > 0)) & ~rigid
        if bad.any():
            e = int(np.argmax(bad))
            problem, location = "no rest length gives a member its tension", f"members.{self.member_name[e]}"
            allowed = "a tension that its law has at a positive rest length"
            value = f"{tension[e]:g} N"
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
        return np.where(rigid, self.rest_length, rest_length)

    def _bisect_rest_length(self, length: FloatArray, tension: FloatArray) -> FloatArray:
        low = np.where(tension > 0, 0.0, length)
        high = np.where(tension > 0, length, MAX_REST_LENGTH_RATIO * length)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            is_tighter = replace(self, rest_length=middle).compute_static_tension(length) > tension  # type: ignore[type-var]
            low, high = np.where(is_tighter, middle, low), np.where(is_tighter, high, middle)
        reached = replace(self, rest_length=high).compute_static_tension(length)  # type: ignore[type-var]
        scale = np.maximum(np.abs(tension), 1e-300)
        result: FloatArray = np.where(np.abs(reached - tension) <= 1e-6 * scale, high, np.nan)
        return result
