"""Quantities of contacts with the ground, and of pairs of bars: their distances, points and cases."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

SOURCE = "Hunt and Crossley 1975"

GROUND = (
    Quantity("internal_rate", "z'", "m/s, W", ("n_internal",), "Rates of the internal states.", SOURCE),
    Quantity(
        "penetration", "d", "m", ("n_contacts",),
        "Depth of each node that can touch the ground, its radius included, below the plane; negative above "
        "it.",
        SOURCE,
    ),
    Quantity(
        "contact_force", "N n - F", "N", ("n_contacts", "n_axes"),
        "Force of the ground on each node that can touch it: normal force and friction.", SOURCE,
    ),
    Quantity(
        "contact_margin", "g_n", "m", ("n_contacts",),
        "Margins of contacts, min(d, d (1 + a d')): the ground presses while one is positive.", SOURCE,
    ),
    *(
        Quantity(
            f"{name}_power", f"P_{name[0]}", "W", (),
            f"What {words} adds to the total energy, zero or less.", SOURCE,
        )
        for name, words in (("friction", "friction on the ground"), ("impact", "dissipation in impacts"))
    ),
    Quantity(
        "stick_margin", "g_t", "m", ("n_contacts",),
        "Margins of sticking, (mu N - |T|) / kt: a contact sticks while its margin is positive; -1 where the "
        "ground does not press.",
        SOURCE,
    ),
)  # fmt: skip


INTERFERENCE = (
    Quantity(
        "bar_distance", "D", "m", ("n_bar_pairs",),
        "Distances between the surfaces of bars with round ends, pair by pair; negative where they overlap.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_case", "k", "1", ("n_bar_pairs",),
        "Which case of the geometry of two bars holds, 1 to 11.", "LIN 3.2",
    ),
    Quantity(
        "bar_distance_parameters", "(s, t)", "1", ("n_bar_pairs", "2"),
        "Where the nearest points are on both axes, from 0 (first node of the bar) to 1 (second node).",
        "LIN 3.2",
    ),
    Quantity(
        "bar_nearest_point", "P, Q", "m", ("n_bar_points", "n_axes"),
        "Nearest points of the axes of two bars, first and second, pair by pair.", "LIN 3.2",
    ),
    Quantity(
        "bar_distance_jacobian", "dD/dq", "1", ("n_bar_pairs", "n_coordinates"),
        "Jacobian of the distances between bars; where axes meet, of one of the two sides.", "LIN 3.2",
        sparse=True,
    ),
    Quantity(
        "collision_force", "N", "N", ("n_bar_pairs",),
        "Force between the bars of each pair that touch, along their distance.", "Hunt and Crossley 1975",
    ),
    Quantity(
        "collision_margin", "g_d", "m", ("n_bar_pairs",),
        "Margins of collisions, min(d, d (1 + a d')) with the overlap d of two bars: they press each other "
        "while one is positive.",
        "Hunt and Crossley 1975",
    ),
)  # fmt: skip
