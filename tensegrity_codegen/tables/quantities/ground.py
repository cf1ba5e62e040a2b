"""Quantities of contacts with the ground."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

SOURCE = "Hunt and Crossley 1975"

GROUND = (
    Quantity(
        "internal_rate",
        "z'",
        "m/s, W",
        ("n_internal",),
        "Rates of the internal states.",
        SOURCE,
    ),
    Quantity(
        "penetration",
        "d",
        "m",
        ("n_contacts",),
        "Depth of each node that can touch the ground, its radius included, below the plane; negative above "
        "it.",
        SOURCE,
    ),
    Quantity(
        "contact_force",
        "N n - F",
        "N",
        ("n_contacts", "n_axes"),
        "Force of the ground on each node that can touch it: normal force and friction.",
        SOURCE,
    ),
    Quantity(
        "contact_margin",
        "g_n",
        "m",
        ("n_contacts",),
        "Margins of contacts, min(d, d (1 + a d')): the ground presses while one is positive.",
        SOURCE,
    ),
    *(
        Quantity(
            f"{name}_power",
            f"P_{name[0]}",
            "W",
            (),
            f"What {words} adds to the total energy, zero or less.",
            SOURCE,
        )
        for name, words in (("friction", "friction on the ground"), ("impact", "dissipation in impacts"))
    ),
    Quantity(
        "stick_margin",
        "g_t",
        "m",
        ("n_contacts",),
        "Margins of sticking, (mu N - |T|) / kt: a contact sticks while its margin is positive; -1 where the "
        "ground does not press.",
        SOURCE,
    ),
)
