"""Quantities that feedback needs of a library, besides a linear model."""

CONTROL_METHOD = "rk853"  # integrator of the simulated plant
CONTROL_QUANTITIES = (
    "acceleration",
    "mass_matrix",
    "equilibrium_matrix",
    "member_length",
    "member_tension",
)
