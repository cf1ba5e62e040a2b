"""The two models that the studies compare, compiled from one structure."""

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest


def compile_in(structure: Structure, formulation: str, *quantities: str, **options: str) -> CompiledModel:
    """Return the compiled model in a formulation, fit for simulation, with some more quantities."""
    request = ModelRequest(
        (*simulation_quantities(formulation), *quantities),
        integrators=("rk4", "rk54"),
        formulation=formulation,
        options=options,
    )
    return build_library(structure, request).load()
