"""Quantities of single members as expressions: the entries of every member, one after the other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES, MemberQuantity, check_values

Scalar = Any


@dataclass(frozen=True)
class HeldMember:
    """A rigid bar: its tension is a multiplier.

    member: its geometry; multiplier, kept_length: return the force density [N/m] and the length [m] that it
    keeps, when first needed; axial_stiffness: EA in the scene [N].
    """

    member: Member
    multiplier: Callable[[], Scalar]
    kept_length: Callable[[], Scalar]
    axial_stiffness: Scalar
    tension_only = False
    fmax = staticmethod(ca.fmax)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.member, name)

    @property
    def density(self) -> Scalar:
        """Force density [N/m]."""
        return self.multiplier()

    @property
    def extension(self) -> Scalar:
        """Length minus the length that it keeps [m]."""
        return self.member.length - self.kept_length()

    @property
    def tension(self) -> Scalar:
        """Tension [N]."""
        return self.density * self.member.length


def build_member_quantities(
    subject: Any, members: Callable[[], Sequence[Member | HeldMember]]
) -> dict[str, Callable[[], ca.SX]]:
    """Return the builders of all quantities of single members.

    subject: whose members they are; members: returns the members in their order, when first needed. Returns
    quantity name -> builder of its expression, (n_members, 1), or (n_axes, n_members) of vectors. Builders
    raise FormulationError where members lack a section or stiffness.
    """
    return {item.name: partial(_build, item, subject, members) for item in MEMBER_QUANTITIES}


def _build(
    quantity: MemberQuantity, subject: Any, members: Callable[[], Sequence[Member | HeldMember]]
) -> ca.SX:
    check_values(quantity, subject)
    columns = [ca.vertcat(*quantity.entries(member)) for member in members()]
    return ca.horzcat(*columns) if quantity.is_vector else ca.vertcat(ca.SX(0, 1), *columns)
