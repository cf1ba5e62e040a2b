"""Quantities that a simulation needs of a model."""

from tensegrity_codegen.tables.formulations import find_formulation

# In any formulation; the integrators come besides.
SIMULATION_QUANTITIES = ("acceleration", "member_tension", "kinetic_energy", "total_energy")


def simulation_quantities(formulation: str) -> tuple[str, ...]:
    """Return what a simulation needs of a model in this formulation."""
    return (*SIMULATION_QUANTITIES, *find_formulation(formulation).simulation_quantities)
