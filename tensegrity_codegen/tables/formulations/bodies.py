"""Angles and positions of rigid bodies as coordinates."""

from tensegrity_codegen.tables.formulations.formulation import Formulation

FORMULATION = Formulation(
    name="bodies",
    order=4,
    sentence="Angles and positions of rigid bodies that tendons join.",
    variants=(),
    of_bodies=True,
    has_angles=True,
    statics="bodies",
    simulation_quantities=("node_position", "node_velocity", "chart_margin", "energy_rate"),
)
