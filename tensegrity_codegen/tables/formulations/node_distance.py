"""Differences of node positions and centres of mass as coordinates."""

from tensegrity_codegen.tables.formulations.formulation import Formulation

FORMULATION = Formulation(
    name="node_distance",
    order=3,
    sentence="Differences of node positions, and centres of mass; every member is a spring.",
    options={
        "pairs": ("connected", "full"),
        "order": ("uvec321", "uvec123"),
        "basis": ("cycles", "orthonormal"),
    },
    variants=({}, {"pairs": "full"}),
    has_centres=True,
    has_statics=False,
    simulation_quantities=("node_position", "node_velocity"),
    linear_quantities=("distance_inertia_inverse",),
)
