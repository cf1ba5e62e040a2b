"""Cables through rings: straight segments with one tension in all, or with friction at the rings.

l = sum of l_s over the strands, t = mu (l - rho) + c l' as of any cable, and each strand pulls the nodes at
its ends together with t. With a = dl/dq, summed up from the directions of the strands,

K = (dt/dl) a a^T + sum over strands of (t / l_s) (I - u_s u_s^T)

so that every two strands share a block of the first part.

Friction: the rest length that slides from one strand into the next, with

T_k = a_k - c rho_k',  a_k = t_k + d_k,  t_k = mu_k max(0, l_k - rho_k),  rho_k' = v_(k-1) - v_k
v_k = 0 while 1 / E_k <= T_(k+1) / T_k <= E_k,  E_k = exp(mu theta_k),  else the ratio is at that limit

k: strands of a cable, and the ring behind each; v_k: rate of the rest length that slides through it, the
rate of an internal state s_k, so that rho_k = rho_k(0) + s_(k-1) - s_k and the sum is kept; theta_k: angle
that the cable turns (Euler 1769, capstan). d = c l' t / sqrt(t^2 + (c l')^2) is the damping, which never
exceeds the elastic tension: forces are continuous where strands go slack. c acts on rho' too; where a strand
gives material away less of it as it goes slack, so that a slack strand gives freely. So the flows follow from
the state, without jumps: events are kinks, and while a cable slips its tensions are exactly at the limit.

The equations are solved exactly, strand by strand. chi_k(x), the flow v_k at which T_k = x, is piecewise
linear and rises; with phi_k(x), the flow at which T_(k+1) = x,

phi_k(x) = max(0, chi_k(x / E_k)) + min(0, chi_k(x E_k)),  chi_(k+1)(x) = phi_k(x) + (x - a_(k+1)) / c

so phi_k(x) is chi_k at that point from x / E_k to x E_k which is next to its root, and zero if the root
lies there. Each ring adds two corners, each strand one at a. The last strand has chi(T) = 0 (no flow); going
back, T_k is the root of chi_k where its ring sticks, or at the limit of its neighbour.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import combinations, pairwise
from math import expm1, radians
from typing import Any

import casadi as ca

from tensegrity_codegen.structure.sliding import SlidingCable
from tensegrity_codegen.symbolic.geometry import MIN_LENGTH, MIN_SQUARE, Scalar, Vector, dot
from tensegrity_codegen.symbolic.members.member import Member, MemberBlocks, stiffness_block
from tensegrity_codegen.symbolic.members.member_law import MemberLaw, build_law
from tensegrity_codegen.symbolic.memory import Memory

Pairs = dict[tuple[int, int], MemberBlocks]


@dataclass(frozen=True)
class Strand(Member):
    """A straight part of a cable: vector and rate of its own, tension and law of the whole cable."""

    cable_law: MemberLaw | None = None

    @cached_property
    def law(self) -> MemberLaw:
        """The law of the cable, at its whole length."""
        assert self.cable_law is not None
        return self.cable_law

    @cached_property
    def divisor(self) -> Scalar:
        """Length [m], 0 if the ends of a strand that pulls coincide: its pull has no direction there."""
        return self.length - ca.if_else(self.law.rest_length < self.law.length, MIN_LENGTH, 0)

    @cached_property
    def density(self) -> Scalar:
        """Tension of the cable with damping over the length of the strand [N/m]."""
        return self.law.tension() / self.divisor

    @cached_property
    def static_density(self) -> Scalar:
        """Tension of the cable without damping over the length of the strand [N/m]."""
        return self.law.static_tension() / self.divisor


@dataclass(frozen=True)
class RingCable(Member):
    """A cable through rings; its vector goes from its last node to its first one.

    parts: vector and rate of each strand.
    """

    parts: tuple[tuple[Vector, Vector], ...] = ()

    @property
    def plain_length(self) -> Scalar:
        """Sum of the lengths of the strands [m], exactly."""
        return sum((strand.plain_length for strand in self._geometry), ca.SX(0.0))

    @cached_property
    def length(self) -> Scalar:
        """Sum of the lengths of the strands [m]."""
        return sum((strand.length for strand in self._geometry), ca.SX(0.0))

    @cached_property
    def rate(self) -> Scalar:
        """Sum of the rates of the lengths of the strands [m/s]."""
        return sum((strand.rate for strand in self._geometry), ca.SX(0.0))

    @cached_property
    def law(self) -> MemberLaw:
        """Law at the whole length, its rate and the rest length."""
        return build_law(self.length, self.rate, self.values, self.tension_only)

    @cached_property
    def strands(self) -> tuple[Member, ...]:
        """The straight parts, from the first node to the last."""
        return tuple(self._strand(vector, rate, self.law) for vector, rate in self.parts)

    @cached_property
    def _geometry(self) -> tuple[Member, ...]:
        """The strands before there is a law: lengths and rates."""
        return tuple(Member(vector, rate, self.values, self.tension_only) for vector, rate in self.parts)

    def _strand(self, vector: Vector, rate: Vector, law: MemberLaw) -> Strand:
        return Strand(vector, rate, self.values, self.tension_only, cable_law=law)

    # Blocks of pairs of strands

    def material_block(self) -> Pairs:  # type: ignore[override]
        """Return the parts of (dt/dl) a a^T without damping [N/m]."""
        return self._outer(self.law.static_tension_by_length())

    def geometric_block(self) -> Pairs:  # type: ignore[override]
        """Return the geometric stiffness of each strand without damping [N/m]."""
        return self._turning([strand.static_density for strand in self.strands])

    def tangent_block(self) -> Pairs:  # type: ignore[override]
        """Return the sum of both [N/m]."""
        return _add(self.material_block(), self.geometric_block())

    def rate_block(self) -> Pairs:  # type: ignore[override]
        """Return the parts of c a a^T while it pulls [N s/m]."""
        return self._outer(self.law.tension_by_rate())

    def position_block(self) -> Pairs:  # type: ignore[override]
        """Return the parts of -d(force)/dq, damping included [N/m]."""
        block = _add(
            self._outer(self.law.tension_by_length()),
            self._turning([strand.density for strand in self.strands]),
        )
        if not self.is_damped:
            return block
        gradients = [strand.rate_gradient() for strand in self.strands]
        return _add(block, self._outer(self.law.tension_by_rate(), gradients))

    def _outer(self, scale: Scalar, columns: list[Vector] | None = None) -> Pairs:
        """Return scale u_s w_t^T for all strands s and t; w: given columns, or the directions u."""
        rows = [strand.direction() for strand in self.strands]
        columns = rows if columns is None else columns
        return {
            (s, t): MemberBlocks.outer(row, column, scale)
            for s, row in enumerate(rows)
            for t, column in enumerate(columns)
        }

    def _turning(self, densities: list[Scalar]) -> Pairs:
        """Return (t / l_s) (I - u_s u_s^T) of each strand."""
        strands = enumerate(zip(self.strands, densities, strict=True))
        return {
            (s, s): stiffness_block(strand.vector, strand.length, strand.square, ca.SX(0.0), density)
            for s, (strand, density) in strands
        }


def _add(pairs: Pairs, addends: Mapping[tuple[int, int], MemberBlocks]) -> Pairs:
    """Return the sum of blocks; pairs: has those of all strands."""
    return {key: block.plus(addends[key]) if key in addends else block for key, block in pairs.items()}


SLACK_STRAIN = 1e-4  # of a strand, below which it has less damping on material that it gives away
SLACK_MARGIN = 1e-6  # of the rest length of a strand: margin of a ring between slack ones
SURE = 1.0 - 1e-6  # times what a ring holds: less by more than any rounding
HELD = 1.0 - 1e-10  # of the limit, up to which equilibria go, so that their rings stick for sure
MIN_DAMPING = 1e-3  # of it, when slack


@dataclass(frozen=True)
class SlidingStrand(Member):
    """A strand of a cable with friction at rings.

    slide: rate of its rest length by slip [m/s], 0 unless the cable moves, as RingSlip has it.
    """

    slide: Scalar = 0.0
    moves: Scalar = 1.0

    @cached_property
    def stretch(self) -> Scalar:
        """Tension without damping and slip, times the rest length [N m]."""
        return self.law.axial_stiffness / 2.0 * (self.extension + ca.fabs(self.extension))

    @property
    def elastic(self) -> Scalar:
        """Tension without damping and slip [N]."""
        return self.stretch / self.law.rest_length

    @cached_property
    def stuck_density(self) -> Scalar:
        """Tension over the length as long as nothing slips [N/m]: (t + d) / l as one quotient."""
        push = self.law.damping * dot(self.vector, self.vector_rate) * self.law.rest_length
        size = (self.stretch * self.length) ** 2 + push * push
        root = ca.sqrt(ca.if_else(size > 0, size, 1))
        return self.stretch * (root + push) / (self.law.rest_length * root * self.length)

    @cached_property
    def giving(self) -> Scalar:
        """Damping on material that the strand gives away [N s/m]."""
        small = SLACK_STRAIN * self.axial_stiffness
        return self.law.damping * ((self.elastic + MIN_DAMPING * small) / (self.elastic + small))

    @cached_property
    def stuck_tension(self) -> Scalar:
        """Tension as long as nothing slips [N]."""
        return self.stuck_density * self.length

    @cached_property
    def lost(self) -> Scalar:
        """Part of the tension that slip takes [N]."""
        return ca.if_else(self.slide > 0, self.law.damping, self.giving) * self.slide

    @cached_property
    def tension(self) -> Scalar:
        """Tension [N]."""
        return self.stuck_tension - ca.if_else(self.moves, self.lost, 0)

    @cached_property
    def density(self) -> Scalar:
        """Tension over the length [N/m]."""
        return self.stuck_density - ca.if_else(self.moves, self.lost / self.length, 0)

    def damping_loss(self) -> Scalar:
        """Return the power of damping, (T - t) (l' - rho') [W]: none of material that only travels."""
        return (self.tension - self.elastic) * (self.rate - self.slide)

    def margin(self) -> Scalar:
        """Return l - rho [m]."""
        return self.law.extension


@dataclass(frozen=True)
class Flow:
    """chi of a strand, piecewise linear and rising; before: that of the strand before, ratio: E of the ring.

    It is evaluated strand by strand: sums of slopes, which grow with E of all rings, would cancel each other.
    """

    strand: SlidingStrand
    before: "Flow | None" = None
    ratio: Scalar = 1.0

    def at(self, x: Scalar) -> Scalar:
        """Return the value at a tension [m/s]."""
        excess = x - self.strand.stuck_tension
        slope = excess / ca.if_else(excess < 0, self.strand.law.damping, self.strand.giving)
        if self.before is None:
            return slope
        root, lower, upper = self.before.root, x / self.ratio, x * self.ratio
        onward = self.before.at(ca.fmin(ca.fmax(root, lower), upper))
        return slope + ca.if_else(ca.logic_and(lower <= root, root <= upper), 0, onward)

    @cached_property
    def corners(self) -> list[Scalar]:
        """Tensions at which the slope changes [N]."""
        corners = [self.strand.stuck_tension]
        if self.before is None:
            return corners
        root, ratio = self.before.root, self.ratio
        moved = [ca.if_else(corner > root, corner * ratio, corner / ratio) for corner in self.before.corners]
        return [*corners, root / ratio, root * ratio, *moved]

    @cached_property
    def most(self) -> Scalar:
        """A tension at which it is not negative [N]."""
        corner = 2.0 * self.strand.stuck_tension
        return corner if self.before is None else corner + self.before.most

    @cached_property
    def root(self) -> Scalar:
        """The tension at which it is zero [N], on the line between the corners next to it."""
        below, above = ca.SX(0.0), self.most
        low, high = self.at(below), self.at(above)
        for corner in self.corners:
            value = self.at(corner)
            is_below = ca.logic_and(value <= 0, corner >= below)
            is_above = ca.logic_and(value > 0, corner < above)
            below, low = ca.if_else(is_below, corner, below), ca.if_else(is_below, value, low)
            above, high = ca.if_else(is_above, corner, above), ca.if_else(is_above, value, high)
        rise = high - low
        return below - low * (above - below) / ca.if_else(rise > 0, rise, 1)


@dataclass(frozen=True)
class RingSlip:
    """The slip of one cable at all of its rings; strands: as if nothing slipped."""

    cable: SlidingCable
    strands: Sequence[SlidingStrand]

    @cached_property
    def ratios(self) -> list[Scalar]:
        """Largest ratio of the tensions at both sides of each ring, exp(mu theta)."""
        values = zip(pairwise(self.strands), self.cable.friction, self.cable.wrap_deg, strict=True)
        return [
            ca.exp(friction * (ca.SX(radians(wrap)) if wrap else _find_angle(before, after)))
            for (before, after), friction, wrap in values
        ]

    @cached_property
    def limits(self) -> list[tuple[Scalar, Scalar]]:
        """Less than (E - 1)^2 at each ring, without exponentials and roots: dividend and divisor."""
        values = zip(pairwise(self.strands), self.cable.friction, self.cable.wrap_deg, strict=True)
        return [
            (SURE * ca.SX(expm1(friction * radians(wrap))) ** 2, ca.SX(1.0))
            if wrap
            else _bound_limit(friction, *ends)
            for ends, friction, wrap in values
        ]

    @cached_property
    def moves(self) -> Scalar:
        """Whether a ring may slip; 0: all stick, as (a_(k+1) - a_k)^2 <= limit min(a_k, a_(k+1))^2 says."""
        pulls = [strand.stuck_tension for strand in self.strands]
        sticks = [
            (after - before) ** 2 * square <= limit * end**2
            for (before, after), (limit, square) in zip(pairwise(pulls), self.limits, strict=True)
            for end in (before, after)
        ]
        return ca.logic_not(reduce(ca.logic_and, sticks))

    @cached_property
    def solution(self) -> tuple[list[Scalar], list[Scalar]]:
        """Flow through each ring [m/s], and the margin by which it sticks [m]."""
        flow = Flow(self.strands[0])
        alone: list[Scalar] = []  # tension of each strand with all rings behind it stuck
        for ratio, strand in zip(self.ratios, self.strands[1:], strict=True):
            alone.append(flow.root)
            flow = Flow(strand, flow, ratio)
        tension, onward = flow.root, ca.SX(0.0)
        flows, margins = [], []
        for k in reversed(range(len(self.ratios))):
            ratio, free, strand = self.ratios[k], alone[k], self.strands[k + 1]
            missing = strand.stuck_tension - tension
            room = ca.fmin(ratio * tension - free, ratio * free - tension)
            taken = missing / ca.if_else(missing > 0, strand.law.damping, strand.giving)
            onward = ca.if_else(room >= 0, 0, onward + taken)
            flows.append(ca.if_else(self.moves, onward, 0))
            margins.append(self._find_margin(k, free, tension))
            tension = ca.fmin(ca.fmax(free, tension / ratio), tension * ratio)
        return flows[::-1], margins[::-1]

    def _find_margin(self, k: int, before: Scalar, after: Scalar) -> Scalar:
        """Return the margin of ring k [m]; before, behind: tensions unless all rings stick for sure [N].

        That is a length, room / mu, with a little of room / both: where both strands go slack it stays
        negative, as it is while they are.
        """
        law, ratio = self.strands[k].law, self.ratios[k]
        before = ca.if_else(self.moves, before, self.strands[k].stuck_tension)
        after = ca.if_else(self.moves, after, self.strands[k + 1].stuck_tension)
        room, total = ca.fmin(ratio * after - before, ratio * before - after), before + after
        margin = SLACK_MARGIN * law.rest_length
        ratio_margin = ca.if_else(total > 0, room / ca.if_else(total > 0, total, 1), -1)
        return room / law.mu + margin * ratio_margin

    def excess(self) -> list[Scalar]:
        """Return the excess of tensions at rest over the limit, behind each ring and before it [N]."""
        tensions = pairwise(strand.elastic for strand in self.strands)
        terms = [
            (after - HELD * ratio * before, before - HELD * ratio * after)
            for ratio, (before, after) in zip(self.ratios, tensions, strict=True)
        ]
        return [value for pair in terms for value in pair]

    def slide(self) -> list[SlidingStrand]:
        """Return the strands as they slip."""
        flows = [ca.SX(0.0), *self.solution[0], ca.SX(0.0)]
        joined = zip(self.strands, pairwise(flows), strict=True)
        return [replace(strand, slide=before - after, moves=self.moves) for strand, (before, after) in joined]


class RingFriction(Memory):
    """All cables of a structure with friction at rings."""

    def __init__(self, members: Sequence[Member], slips: Sequence[RingSlip]) -> None:
        self.members, self.slips = members, slips

    def stored_energy(self) -> Scalar:
        """Return 0: the stored energy of strands is their strain energy."""
        return ca.SX(0.0)

    def powers(self) -> Mapping[str, Scalar]:
        """Return minus the power of slip [W], -(T + t^2 / (2 EA)) rho' of all strands.

        That is v times the difference of T at both sides of a ring, and of t^2 / (2 EA), by which the
        material strains as it comes under the tension of the other side.
        """
        power = ca.SX(0.0)
        for slip in self.slips:
            for e in slip.cable.members:
                strand: Any = self.members[e]
                moved = strand.tension + strand.elastic**2 / (2.0 * strand.axial_stiffness)
                power = power - moved * strand.slide
        return {"friction": power}

    def internal_rates(self) -> Mapping[str, Scalar]:
        """Return the flows through all rings [m/s]."""
        return {
            name: flow
            for slip in self.slips
            for name, flow in zip(slip.cable.state_names, slip.solution[0], strict=True)
        }

    def builders(self) -> dict[str, Callable[[], ca.SX]]:
        """Return the builders of margins, and of the excess of tensions over their limits."""
        return {
            "ring_margin": lambda: ca.vertcat(
                *[margin for slip in self.slips for margin in slip.solution[1]]
            ),
            "ring_ratio": lambda: ca.vertcat(*[ratio for slip in self.slips for ratio in slip.ratios]),
            "ring_excess": lambda: ca.vertcat(*[excess for slip in self.slips for excess in slip.excess()]),
        }


def _bound_limit(friction: float, before: Member, after: Member) -> tuple[Scalar, Scalar]:
    """Return a bound below (E - 1)^2 at a ring: dividend and divisor.

    2 w + w^2 / 3 <= theta^2 with w = 1 - cos(theta), and y + 7 y^2 / 12 <= (exp(x) - 1)^2 with y = x^2: the
    first terms of series of positive ones.
    """
    length, square = before.length * after.length, friction**2
    turn = SURE * length - dot(before.vector, after.vector)
    return turn * (2.0 * square * length + (square / 3.0 + square**2 * (7.0 / 3.0)) * turn), length * length


def _find_angle(before: Member, after: Member) -> Scalar:
    """Return the angle between two strands [rad], 0 straight on and pi folded back; exact near both.

    The root of the area between them has the derivative 0 if it is 0.
    """
    pairs = list(zip(before.vector, after.vector, strict=True))
    square = sum(((x * w - y * v) ** 2 for (x, v), (y, w) in combinations(pairs, 2)), ca.SX(0.0))
    area = ca.if_else(square > 0, ca.sqrt(ca.if_else(square > 0, square, 1)), 0)
    return ca.atan2(area, dot(before.vector, after.vector) + MIN_SQUARE)
