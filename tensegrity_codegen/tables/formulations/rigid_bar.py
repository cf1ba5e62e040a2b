"""Positions of nodes as coordinates, with bars of constant length."""

from tensegrity_codegen.tables.formulations.formulation import Formulation

FORMULATION = Formulation(
    name="rigid_bar",
    order=2,
    sentence="Positions of free nodes; bars without stiffness keep their lengths.",
    options={"bars": ("without_stiffness", "all"), "correction": ("none", "first_order")},
    variants=({}, {"bars": "all"}),
    in_nodes=True,
    has_rigid_bars=True,
    statics="bars",
    emitters=("unrolled", "table"),
    simulation_quantities=("energy_rate", "rigidity_error"),
    massless_tension="spring_tension",
)
