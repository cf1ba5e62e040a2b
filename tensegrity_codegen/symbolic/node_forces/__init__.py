"""Forces on nodes that are no members: the registry, with a class for each kind.

A kind has a function `build_...(structure, arguments)` here, which returns its force on this structure, or
None if the structure has none. What it remembers are internal states z, rows of the argument `internal`;
their names are `Structure.internal_name`.
"""

from collections.abc import Callable

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.node_forces.bar_collision import build_bar_collision
from tensegrity_codegen.symbolic.node_forces.ground_contact import build_ground_contact
from tensegrity_codegen.symbolic.node_forces.node_force import NodeForce

NODE_FORCES: tuple[Callable[[Structure, SymbolicArguments], NodeForce | None], ...] = (
    build_ground_contact,
    build_bar_collision,
)


def build_node_forces(structure: Structure, arguments: SymbolicArguments) -> list[NodeForce]:
    """Return all forces on nodes of a structure besides members, weights and loads."""
    forces = [build(structure, arguments) for build in NODE_FORCES]
    return [force for force in forces if force is not None]
