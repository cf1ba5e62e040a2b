"""Quantities of pairs of bars: how far apart, where, in which case."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

INTERFERENCE = (
    Quantity(
        "bar_distance",
        "D",
        "m",
        ("n_bar_pairs",),
        "Distances between the surfaces of bars with round ends, pair by pair; negative where they overlap.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_case",
        "k",
        "1",
        ("n_bar_pairs",),
        "Which case of the geometry of two bars holds, 1 to 11.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_parameters",
        "(s, t)",
        "1",
        ("n_bar_pairs", "2"),
        "Where the nearest points are on both axes, from 0 (first node of the bar) to 1 (second node).",
        "LIN 3.2",
    ),
    Quantity(
        "bar_nearest_point",
        "P, Q",
        "m",
        ("n_bar_points", "n_axes"),
        "Nearest points of the axes of two bars, first and second, pair by pair.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_jacobian",
        "dD/dq",
        "1",
        ("n_bar_pairs", "n_coordinates"),
        "Jacobian of the distances between bars; where axes meet, of one of the two sides.",
        "LIN 3.2",
        sparse=True,
    ),
    Quantity(
        "collision_force",
        "N",
        "N",
        ("n_bar_pairs",),
        "Force between the bars of each pair that touch, along their distance.",
        "Hunt and Crossley 1975",
    ),
    Quantity(
        "collision_margin",
        "g_d",
        "m",
        ("n_bar_pairs",),
        "Margins of collisions, min(d, d (1 + a d')) with the overlap d of two bars: they press each other "
        "while one is positive.",
        "Hunt and Crossley 1975",
    ),
)
