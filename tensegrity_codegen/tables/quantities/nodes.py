"""Quantities of nodes: each record has all that is known of one.

A record has the row of the table of quantities, the entries of one node as a function of it, and what of the
node it uses. Formulations, emitters, the loops over tables and the documentation read it from here: to add a
quantity, add a record.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.tables.quantities.quantity import Quantity

Scalar = Any  # an expression

# The data of a node, each a vector over the modelled axes but the mass, and whether rigid bars, whose
# tensions are multipliers, are in it. A formulation has some of these, and offers the records that use no
# others.
BARS_IN = {
    "position": False,  # [m]
    "velocity": False,  # [m/s]
    "mass": False,  # that whose weight it carries: its own and half of each bar's [kg]
    "load": False,  # weight, loads and force inputs [N]
    "force": True,  # these and all members, with damping [N]
    "static_force": True,  # the same without damping [N]
    "spring_force": False,  # the same without damping and without rigid bars [N]
    "cable_force": False,  # weight, loads and cables, without two-sided members [N]
}


@dataclass(frozen=True)
class NodeQuantity:
    """One quantity with a result for each node, or for each of their free or anchored components.

    row: name, symbol, unit, shape and sentence. A shape (n_nodes, n_axes) or (n_nodes,) has entries of all
        nodes, (n_coordinates,) and (n_anchored_coordinates,) the free or the anchored components of a vector.
    entries: node -> its result, a list of one entry, or of one for each axis.
    uses: its data of the node, of BARS_IN.
    is_state: whether free node coordinates are the quantity itself, so that only other coordinates have it.
    """

    row: Quantity
    entries: Callable[[Any], list[Scalar]]
    uses: tuple[str, ...]
    is_state: bool = False

    @property
    def name(self) -> str:
        """Name of the quantity."""
        return self.row.name

    @property
    def components(self) -> str:
        """Which components of all nodes it runs over: "n_nodes", "n_coordinates", ..., as in its shape."""
        return self.row.shape[0]

    @property
    def follows_bars(self) -> bool:
        """Whether it depends on the tensions of rigid bars: loops over tables do not serve it there."""
        return any(BARS_IN[name] for name in self.uses)


NODE_QUANTITIES = (
    NodeQuantity(
        Quantity("node_position", "r", "m", ("n_nodes", "n_axes"), "Positions of all nodes.", "S&K 3"),
        entries=lambda n: n.position,
        uses=("position",),
        is_state=True,
    ),
    NodeQuantity(
        Quantity("node_velocity", "r'", "m/s", ("n_nodes", "n_axes"), "Velocities of all nodes.", "S&K 3"),
        entries=lambda n: n.velocity,
        uses=("velocity",),
        is_state=True,
    ),
    NodeQuantity(
        Quantity(
            "node_speed", "|r'|", "m/s", ("n_nodes",), "Speeds of all nodes: lengths of their velocities."
        ),
        entries=lambda n: [sum(component**2 for component in n.velocity) ** 0.5],
        uses=("velocity",),
    ),
    NodeQuantity(
        Quantity(
            "node_force", "f", "N", ("n_nodes", "n_axes"),
            "Sum of member forces, weight and loads on every node.",
        ),
        entries=lambda n: n.force,
        uses=("force",),
    ),
    NodeQuantity(
        Quantity(
            "node_residual", "-dU/dq", "N", ("n_coordinates",),
            "Static force (no damping) on every free coordinate; zero in equilibrium.",
        ),
        entries=lambda n: n.spring_force,
        uses=("spring_force",),
    ),
    NodeQuantity(
        Quantity(
            "support_reaction", "R", "N", ("n_anchored_coordinates",),
            "Static force that the anchors exert on the structure, anchored coordinate by coordinate.",
        ),
        entries=lambda n: [-force for force in n.static_force],
        uses=("static_force",),
    ),
    NodeQuantity(
        Quantity(
            "cable_force", "f_c", "N", ("n_coordinates",),
            "Force on every free coordinate by weight, loads and cables, without two-sided members.",
        ),
        entries=lambda n: n.cable_force,
        uses=("cable_force",),
    ),
)  # fmt: skip

NODES = tuple(quantity.row for quantity in NODE_QUANTITIES)
