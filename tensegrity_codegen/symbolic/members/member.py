"""One member: all that follows from its vector, the rate of it and the values of its law.

The symmetric blocks that it adds to matrices share their off-diagonal expressions: nothing is computed twice.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from tensegrity_codegen.symbolic.geometry import MIN_SQUARE, Scalar, Vector, dot, member_length
from tensegrity_codegen.symbolic.members.member_law import MemberLaw, build_law
from tensegrity_codegen.tables.laws import MEMBER_VALUES


@dataclass(frozen=True)
class MemberBlocks:
    """Entries of one member's (n_axes, n_axes) block, row by row."""

    entries: tuple[tuple[Scalar, ...], ...]

    @classmethod
    def outer(cls, a: Vector, b: Vector, scale: Scalar) -> "MemberBlocks":
        """Return scale a b^T; symmetric entries are shared when a is b."""
        scaled = [scale * x for x in a]
        rows = [[x * y for y in b] for x in scaled]
        if a is b:
            rows = [[rows[min(r, c)][max(r, c)] for c in range(len(b))] for r in range(len(a))]
        return cls(tuple(tuple(row) for row in rows))

    def plus(self, addend: "MemberBlocks") -> "MemberBlocks":
        """Return the sum of two blocks."""
        return MemberBlocks(
            tuple(
                tuple(x + y for x, y in zip(row, other_row, strict=True))
                for row, other_row in zip(self.entries, addend.entries, strict=True)
            )
        )


def stiffness_block(
    vector: Vector, length: Scalar, square: Scalar, slope: Scalar, density: Scalar
) -> MemberBlocks:
    """Return one member's stiffness block, slope d d^T / l^2 + density (I - d d^T / l^2) [N/m].

    square: l^2 [m2]; slope = dt/dl and density = t/l [N/m]: the material and the geometric part (S&K 5, the
    same as mu [(1 - rho/l) I + (rho/l^3) d d^T]); either may be zero. Over one axis d / l is exactly 1 or -1,
    and nothing is left of the geometric part.
    """
    if len(vector) == 1:
        return _sum([vector[0] / length], slope - density, density)
    return _sum(vector, (slope - density) / square, density)


def tangent_block(
    vector: Vector, length: Scalar, square: Scalar, slope: Scalar, tension: Scalar
) -> MemberBlocks:
    """Return the block of both parts [N/m], from the tension [N]: one quotient serves all entries."""
    if len(vector) == 1:
        return stiffness_block(vector, length, square, slope, tension / length)
    inverse = length / square  # CasADi would make quotients again of products with 1 / length
    density = tension * inverse
    return _sum(vector, (slope - density) * (inverse * inverse), density)


def _sum(vector: Vector, along: Scalar, density: Scalar) -> MemberBlocks:
    """Return along d d^T + density I."""
    size, zero = range(len(vector)), ca.SX(0.0)
    identity = MemberBlocks(tuple(tuple(density if r == c else zero for c in size) for r in size))
    return identity.plus(MemberBlocks.outer(vector, vector, along))


@dataclass(frozen=True)
class Member:
    """Expressions of one member; every intermediate is built once, when first needed.

    vector, vector_rate: d_e [m] and d_e' [m/s] over the modelled axes; values: those of MEMBER_VALUES, and
    the internal states of a law with memory; section: those of SECTION_VALUES; least_square: what a member
    that pulls only adds to the square of its length [m2].
    """

    vector: Vector
    vector_rate: Vector
    values: Mapping[str, Scalar]
    tension_only: bool
    section: Mapping[str, Scalar] = field(default_factory=dict)
    least_square: Scalar = MIN_SQUARE
    fmax = staticmethod(ca.fmax)

    @property
    def section_area(self) -> Scalar:
        """Area of the section [m2]."""
        return self.section["section_area"]

    @property
    def gyration_square(self) -> Scalar:
        """Second moment of the section over its area [m2]."""
        return self.section["gyration_square"]

    @property
    def axial_stiffness(self) -> Scalar:
        """Axial stiffness EA = mu rho [N]."""
        return self.law.mu * self.law.rest_length

    @property
    def tension(self) -> Scalar:
        """Tension with damping [N]."""
        return self.law.tension()

    @property
    def extension(self) -> Scalar:
        """Extension l - rho [m]."""
        return self.law.extension

    @property
    def plain_length(self) -> Scalar:
        """Length l_e [m], exactly 0 if the ends coincide."""
        return member_length(self.vector)

    @cached_property
    def length(self) -> Scalar:
        """Length l_e [m], of a cable never 0, see MIN_SQUARE."""
        return ca.sqrt(self.square)

    @cached_property
    def square(self) -> Scalar:
        """Square of that length [m2]."""
        square = dot(self.vector, self.vector)
        return square + self.least_square if self.tension_only else square

    @property
    def is_damped(self) -> bool:
        """Whether the member has damping."""
        return not self.values["damping"].is_zero()

    @cached_property
    def rate(self) -> Scalar:
        """Rate of the length [m/s]; 0 without damping and memory, where nothing depends on it."""
        if not self.is_damped and not self.remembers:
            return ca.SX(0.0)
        return dot(self.vector, self.vector_rate) / self.length

    @property
    def remembers(self) -> bool:
        """Whether its law has internal states."""
        return any(name not in MEMBER_VALUES for name in self.values)

    @cached_property
    def law(self) -> MemberLaw:
        """Law at the present length, rate and rest length."""
        return build_law(self.length, self.rate, self.values, self.tension_only)

    def damping_loss(self) -> Scalar:
        """Return the power that damping takes, (t - t_undamped) l' [W]."""
        return (self.law.tension() - self.law.undamped_tension()) * self.rate

    def margin(self) -> Scalar:
        """Return the length [m] while which is positive a cable pulls."""
        return self.law.margin()

    @property
    def strands(self) -> "tuple[Member, ...]":
        """Its straight parts: here itself."""
        return (self,)

    @cached_property
    def density(self) -> Scalar:
        """Force density t_e / l_e with damping [N/m]."""
        return self.law.force_density()

    @cached_property
    def static_density(self) -> Scalar:
        """Force density t_e / l_e without damping [N/m]."""
        return self.law.static_tension() / self.law.length

    def pull(self, density: Scalar) -> Vector:
        """Return the force on node j, minus that on node i, of a force density [N]."""
        return [density * component for component in self.vector]

    def direction(self) -> Vector:
        """Return d / l, one component an axis."""
        return [component / self.length for component in self.vector]

    def rest_pull(self) -> Vector:
        """Return the change of the force on node i by one more metre of rest length, -(dt/drho) d / l [N/m].

        The product comes before the quotient, so that a constant slope does not meet a constant mass.
        """
        slope = self.law.tension_by_rest_length()
        return [-(slope * component) / self.length for component in self.vector]

    def static_rest_pull(self) -> Vector:
        """Return the same without damping [N/m]: no mass follows, and one quotient serves all components."""
        density = -self.law.static_tension_by_rest_length() / self.length
        return [density * component for component in self.vector]

    @property
    def tension_by_rest_length(self) -> Scalar:
        """Derivative dt/drho of the tension with damping, at constant length and rate [N/m]."""
        return self.law.tension_by_rest_length()

    def tension_gradient(self) -> Vector:
        """Return dt/dd, damping included, one component an axis [N/m]."""
        density = self.law.tension_by_length() / self.length
        gradient = [density * component for component in self.vector]
        if not self.is_damped:
            return gradient
        by_rate = self.law.tension_by_rate()
        return [
            total + by_rate * rate_term
            for total, rate_term in zip(gradient, self.rate_gradient(), strict=True)
        ]

    def rate_gradient(self) -> Vector:
        """Return dl'/dd = d'/l - (l'/l^2) d: the rate of l = d . d' / l depends on the member vector."""
        turning = self.rate / (self.length * self.length)
        return [
            rate / self.length - turning * component
            for rate, component in zip(self.vector_rate, self.vector, strict=True)
        ]

    def material_block(self) -> MemberBlocks:
        """Return the material stiffness without damping, (n_axes, n_axes) [N/m]."""
        return stiffness_block(
            self.vector, self.length, self.square, self.law.static_tension_by_length(), ca.SX(0.0)
        )

    def geometric_block(self) -> MemberBlocks:
        """Return the geometric stiffness without damping, (n_axes, n_axes) [N/m]."""
        return stiffness_block(self.vector, self.length, self.square, ca.SX(0.0), self.static_density)

    def tangent_block(self) -> MemberBlocks:
        """Return the sum of both, (n_axes, n_axes) [N/m]."""
        slope, tension = self.law.static_tension_by_length(), self.law.static_tension()
        return tangent_block(self.vector, self.length, self.square, slope, tension)

    def rate_block(self) -> MemberBlocks:
        """Return c d d^T / l^2 while it pulls, (n_axes, n_axes) [N s/m]."""
        scale = self.law.tension_by_rate() / (self.length * self.length)
        return MemberBlocks.outer(self.vector, self.vector, scale)

    def position_block(self) -> MemberBlocks:
        """Return -d(force)/d(vector), damping included, (n_axes, n_axes) [N/m]."""
        law, d = self.law, self.vector
        block = tangent_block(d, self.length, self.square, law.tension_by_length(), law.tension())
        if not self.is_damped:
            return block
        return block.plus(MemberBlocks.outer(d, self.rate_gradient(), law.tension_by_rate() / self.length))
