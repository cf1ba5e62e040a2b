"""The symbolic model in any formulation."""

from importlib import import_module

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.body_support import check_bodies
from tensegrity_codegen.structure.collision import check_collision
from tensegrity_codegen.structure.ground_support import check_ground
from tensegrity_codegen.structure.memory_support import check_memory
from tensegrity_codegen.structure.sliding import check_ring_friction, check_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.columns import add_derivatives
from tensegrity_codegen.symbolic.jacobians import add_slopes
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest


def build_model(structure: Structure | BodySystem, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model in the requested formulation; FormulationError lists the known ones.

    The function build_NAME of the module of its name in `formulations` makes it.
    """
    name = find_formulation(request.formulation).name
    check_bodies(structure, request)
    check_ground(structure, request)
    check_rings(structure, request)
    check_collision(structure, request)
    check_memory(structure, request)
    check_ring_friction(structure, request)
    module = import_module(f"tensegrity_codegen.symbolic.formulations.{name}")
    build = getattr(module, f"build_{name}")
    model: SymbolicModel = build(structure, request)
    add_slopes(model, request.quantities)
    if request.differentiates_motions:
        add_derivatives(model, request, build)
    return model
