"""Quantities of members and nodes as expressions: the entries of each, one after the other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from tensegrity_codegen.symbolic.geometry import Scalar, Vector
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES, MemberQuantity, check_values
from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES, NodeQuantity


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
    raise FormulationError if members lack a section or stiffness.
    """
    return {quantity.name: partial(_build, quantity, subject, members) for quantity in MEMBER_QUANTITIES}


def _build(
    quantity: MemberQuantity, subject: Any, members: Callable[[], Sequence[Member | HeldMember]]
) -> ca.SX:
    check_values(quantity, subject)
    columns = [ca.vertcat(*quantity.entries(member)) for member in members()]
    return ca.horzcat(*columns) if quantity.is_vector else ca.vertcat(ca.SX(0, 1), *columns)


Values = Mapping[str, Callable[[], Sequence[Any]]]
Stack = Callable[[list[Vector]], ca.SX]


class Node:
    """One node: its values in a formulation, by the names of `BARS_IN`, each built when first needed."""

    def __init__(self, values: Values, number: int) -> None:
        self._values = values
        self._number = number

    def __getattr__(self, name: str) -> Any:
        return self._values[name]()[self._number]


def build_node_quantities(
    values: Values, n_nodes: int, stacks: Mapping[str, Stack] | None = None, *, has_states: bool = False
) -> dict[str, Callable[[], ca.SX]]:
    """Return the builders of all quantities of nodes that a formulation can offer.

    values: name among `BARS_IN` -> function that returns this value of all nodes.
    n_nodes: number of nodes.
    stacks: "n_coordinates", "n_anchored_coordinates" -> function that takes these components of a vector a
        node.
    has_states: whether to offer positions and velocities, if they are no coordinates.
    Returns quantity name -> builder of its expression: (n_axes, n_nodes), or a column.
    """
    builders: dict[str, Stack] = {"n_nodes": stack_nodes, **(stacks or {})}
    nodes = [Node(values, k) for k in range(n_nodes)]

    def build(quantity: NodeQuantity) -> ca.SX:
        result = builders[quantity.components]([quantity.entries(node) for node in nodes])
        return result.T if quantity.row.shape == ("n_nodes",) else result

    return {
        quantity.name: partial(build, quantity)
        for quantity in NODE_QUANTITIES
        if quantity.components in builders
        and values.keys() >= set(quantity.uses)
        and (has_states or not quantity.is_state)
    }


def stack_nodes(vectors: Sequence[Vector]) -> ca.SX:
    """Return one vector a node as the columns of a matrix, (n_axes, n_nodes)."""
    return ca.horzcat(*[ca.vertcat(*vector) for vector in vectors])
