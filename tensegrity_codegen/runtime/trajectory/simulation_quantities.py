"""Quantities that simulations and feedback need of a library."""

from tensegrity_codegen.runtime.model.interface import Model, require_quantities
from tensegrity_codegen.tables.formulations import find_formulation

# In any formulation; the integrators come besides.
SIMULATION_QUANTITIES = ("acceleration", "member_tension", "kinetic_energy", "total_energy")
CONTACT_QUANTITIES = ("contact_force", "penetration")  # of structures on the ground
CONTROL_METHOD = "rk853"  # integrator of the simulated plant
CONTROL_QUANTITIES = ("acceleration", "mass_matrix", "equilibrium_matrix", "member_length", "member_tension")


def simulation_quantities(formulation: str) -> tuple[str, ...]:
    """Return the quantities that a simulation needs in this formulation."""
    return (*SIMULATION_QUANTITIES, *find_formulation(formulation).simulation_quantities)


def require_simulation(model: Model) -> None:
    """Raise FormulationError if a model lacks quantities of the samples of a motion."""
    of_nodes = () if model.manifest.coordinate_node_axis else ("node_position", "node_velocity")
    require_quantities(model, (*SIMULATION_QUANTITIES, *of_nodes), "a simulation needs")
