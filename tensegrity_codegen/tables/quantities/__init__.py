"""The table of every quantity and argument: name, symbol, unit, shape, sentence, source.

Registered once; header comments, docstrings, help texts and shape checks all read it from here.
Shapes name dimensions: `n_nodes`, `n_members`, `n_axes`, `n_coordinates` (free node coordinates),
`n_internal` (internal states), `n_states` = 2 n_coordinates + n_internal, `n_inputs`, `n_parameters` (all
run-time parameters, stacked in argument order), `n_varied` = n_states + n_parameters + n_inputs, `n_columns`
(derivatives of a motion), `n_followed` = n_states (1 + n_columns), `n_bar_pairs`,
`n_bar_points` = 2 n_bar_pairs, `n_law_values` = 3 + n_axes, `n_tension_only` (members that pull only),
`n_switches` (members whose law switches its slope), `n_contacts` (nodes that can touch the ground),
`n_yields` (two for each plastic member), `n_motors` (with a time constant), `n_rings` (with friction),
`n_ring_sides` = 2 n_rings, `n_bodies` (free rigid bodies), `n_rotation` = 9, `n_values` (all numbers of a
quantity), `n_arguments` (all numbers of its arguments); `k` is the number of nodes or
members that the scene keeps changeable.
"""

from collections.abc import Mapping
from types import MappingProxyType

from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.tables.quantities.arguments import ARGUMENT_ROWS
from tensegrity_codegen.tables.quantities.bodies import BODIES
from tensegrity_codegen.tables.quantities.contacts import GROUND, INTERFERENCE
from tensegrity_codegen.tables.quantities.distances import DISTANCES
from tensegrity_codegen.tables.quantities.members import MEMBERS
from tensegrity_codegen.tables.quantities.memory import MEMORY
from tensegrity_codegen.tables.quantities.nodes import NODES
from tensegrity_codegen.tables.quantities.quantity import Quantity
from tensegrity_codegen.tables.quantities.structures import STRUCTURES


def _table(*rows: Quantity) -> Mapping[str, Quantity]:
    return MappingProxyType({row.name: row for row in rows})


ARGUMENTS = _table(*ARGUMENT_ROWS)

STATE = ("coordinate", "velocity", "internal")
OF_COLUMNS = ("column", "direction")
# Adjoints: the weights of each, and the quantity that they weigh.
ADJOINTS = MappingProxyType(
    {
        "adjoint_rate": ("state_weight", "state_derivative"),
        "adjoint_tension": ("tension_weight", "member_tension"),
        "adjoint_margin": ("margin_weight", "cable_margin"),
    }
)
# Derivatives to all arguments, and the quantity that each is of.
SLOPES = MappingProxyType(
    {
        f"{name}_slopes": name
        for name in (
            *("acceleration", "member_tension", "member_length", "node_position", "node_velocity"),
            *("body_position", "body_axes", "contact_force"),
            *("kinetic_energy", "potential_energy", "total_energy"),
        )
    }
)
# Parts of derivatives of motions, which nobody asks for by name.
OF_MOTIONS = ("column_rate", "tension_column", "margin_column", "margin_jump", *ADJOINTS)
OF_MOTIONS_BOTH_WAYS = ("adjoint_rate", "adjoint_tension", "tension_column")  # what a library is asked for
WEIGHT_OF = MappingProxyType(
    {name: weight for name, (weight, _) in ADJOINTS.items()} | {"margin_jump": "margin_weight"}
)
WEIGHTS = tuple(dict.fromkeys(WEIGHT_OF.values()))
PARAMETERS = tuple(name for name in ARGUMENTS if name not in (*STATE, "input", *OF_COLUMNS, *WEIGHTS))
DIRECTED = (*PARAMETERS, "input")  # the rows of a direction

QUANTITIES = _table(
    *(*MEMBERS, *NODES, *STRUCTURES, *BODIES, *INTERFERENCE, *DISTANCES, *GROUND, *MEMORY),
    *[
        Quantity(
            *(name, f"d({quantity})/d(...)", "mixed", ("n_values", "n_arguments")),
            f"Derivatives of `{quantity}`, entry by entry, to all numbers of its arguments.",
            sparse=True,
        )
        for name, quantity in SLOPES.items()
    ],
)


def find_quantity(name: str) -> Quantity:
    """Return the table's row of `name`; an unknown name raises UnknownNameError with the known ones."""
    if name not in QUANTITIES:
        check_choice(name, [key for key in QUANTITIES if key not in OF_MOTIONS], "quantity", "quantities")
    return QUANTITIES[name]
