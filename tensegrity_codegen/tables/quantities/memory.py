"""Quantities of members with memory, and of motors with a lag."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

CAPSTAN = "Euler 1769"
SOURCE = "Simo and Hughes 1998"

MEMORY = (
    Quantity(
        "settled_internal", "z+", "m", ("n_internal",),
        "Internal states behind an event, or at rest behind a straight way from those given to here.", SOURCE,
    ),
    Quantity(
        "relaxed_internal", "z_oo", "m", ("n_internal",),
        "Internal states at rest after infinite time: viscous members relaxed, others as settled_internal.",
        "Zener 1948",
    ),
    Quantity(
        "viscous_power", "P_v", "W", (),
        "What the dashpots of viscous members add to the total energy, zero or less.", "Zener 1948",
    ),
    Quantity(
        "plastic_elongation", "q", "m", ("n_members",),
        "Plastic elongations of members; 0 of those that are elastic.", SOURCE,
    ),
    Quantity(
        "yield_margin", "g_y", "m", ("n_yields",),
        "Margins of plastic members, pulled and pushed: what is left of the elastic range; while a member "
        "flows -x' and x' times 1 s. It does not flow while its margin is positive.",
        SOURCE,
    ),
    Quantity(
        "motor_margin", "g_m", "m", ("n_motors",),
        "Margins of motors with a time constant, rate tau - |command - u|: a rate is not limited while its "
        "margin is positive; 1 without a limit.",
        "Linear systems",
    ),
    Quantity(
        "ring_margin", "g_r", "m", ("n_rings",),
        "Margins of rings with friction: a cable sticks at a ring while its margin is positive; negative "
        "where both strands are slack.",
        CAPSTAN,
    ),
    Quantity(
        "ring_ratio", "E", "1", ("n_rings",),
        "Largest ratio of the tensions at both sides of each ring with friction, exp(mu theta).", CAPSTAN,
    ),
    Quantity(
        "ring_excess", "F_r", "N", ("n_ring_sides",),
        "Rings with friction at rest, ring by ring: T behind - exp(mu theta) T before, and the reverse; none "
        "is positive where friction holds the cable.",
        CAPSTAN,
    ),
    Quantity(
        "plastic_work", "W_p", "J", (),
        "Minus the energy that plastic flow has taken, with what hardening stores left out: -Fy a of all "
        "members.",
        SOURCE,
    ),
    Quantity(
        "plastic_power", "P_p", "W", (), "What plastic flow adds to the total energy, zero or less.", SOURCE
    ),
)  # fmt: skip
