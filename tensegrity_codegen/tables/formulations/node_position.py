"""Positions of nodes as coordinates, every member a spring."""

from tensegrity_codegen.tables.formulations.formulation import ALL_EMITTERS, Formulation

FORMULATION = Formulation(
    name="node_position",
    order=1,
    sentence="Positions of free nodes; every member is a spring.",
    in_nodes=True,
    emitters=ALL_EMITTERS,
)
