"""Quantities of nodes as expressions: the entries of every node, and those of them that are wanted."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca

from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES, NodeQuantity

Vector = list[Any]
Values = Mapping[str, Callable[[], Sequence[Any]]]
Stack = Callable[[list[Vector]], ca.SX]


class Node:
    """One node: what a formulation knows of it, by the names of `BARS_IN`, each found when first needed."""

    def __init__(self, values: Values, number: int) -> None:
        self._values = values
        self._number = number

    def __getattr__(self, name: str) -> Any:
        return self._values[name]()[self._number]


def build_node_quantities(
    values: Values, n_nodes: int, parts: Mapping[str, Stack] | None = None, *, has_states: bool = False
) -> dict[str, Callable[[], ca.SX]]:
    """Return the builders of all quantities of nodes that a formulation can offer.

    values: what is known of nodes, by the names of `BARS_IN` -> function that returns it of all nodes.
    n_nodes: number of nodes.
    parts: "n_coordinates", "n_anchored_coordinates" -> function that takes these components of a vector a
        node.
    has_states: whether to offer positions and velocities, where they are no coordinates.
    Returns quantity name -> builder of its expression: (n_axes, n_nodes), or a column.
    """
    places: dict[str, Stack] = {"n_nodes": stack_nodes, **(parts or {})}
    nodes = [Node(values, k) for k in range(n_nodes)]

    def build(quantity: NodeQuantity) -> ca.SX:
        result = places[quantity.components]([quantity.entries(node) for node in nodes])
        return result.T if quantity.row.shape == ("n_nodes",) else result

    return {
        item.name: partial(build, item)
        for item in NODE_QUANTITIES
        if item.components in places and values.keys() >= set(item.uses) and (has_states or not item.is_state)
    }


def stack_nodes(vectors: Sequence[Vector]) -> ca.SX:
    """Return one vector a node as the columns of a matrix, (n_axes, n_nodes)."""
    return ca.horzcat(*[ca.vertcat(*vector) for vector in vectors])
