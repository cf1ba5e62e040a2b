"""Cables through rings: straight strands from node to node, with one tension in all of them.

l = sum of l_s over the strands, t = mu (l - rho) + c l' as of any cable, and each strand pulls the nodes at
its ends together with t. With a = dl/dq, summed up from the directions of the strands,

K = (dt/dl) a a^T + sum over strands of (t / l_s) (I - u_s u_s^T)

so that every two strands share a block of the first part.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.geometry import LEAST_LENGTH
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.members.member_blocks import MemberBlocks, stiffness_block
from tensegrity_codegen.symbolic.members.member_law import MemberLaw, build_law

Scalar = Any
Vector = list[Scalar]
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
        """Length [m], 0 where the ends of a strand that pulls coincide: its pull has no direction there."""
        return self.length - ca.if_else(self.law.rest_length < self.law.length, LEAST_LENGTH, 0)

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


def _add(pairs: Pairs, others: Mapping[tuple[int, int], MemberBlocks]) -> Pairs:
    """Return the sum of blocks; pairs: has those of all strands."""
    return {key: block.plus(others[key]) if key in others else block for key, block in pairs.items()}
