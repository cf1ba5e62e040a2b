"""Actuated structures with masses and damped cables, for the tests of timed motions."""

from functools import cache
from typing import Any

import numpy as np

from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.quickly import without_optimisation
from tests.control.planning.structures import actuate, assemble, limit


@cache
def build_prism(start: str = "", *, rate: float = 0.05, rigid: bool = False, free: bool = True) -> Structure:
    """Return a prism of 12 damped cables with a motor for each whose name begins with `start`."""
    bar = {"kind": "bar", "radius": 0.005, "spring_constant": 1e5, "damping": 20.0}
    shape = {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "height": 0.3,
        "twist": 155.0,
        "opposite_class": "cable",
        "node_mass": 0.05,
        "prestress": 20.0,
    }
    cable = {"kind": "cable", "spring_constant": 1000.0, "damping": 8.0}
    document: dict[str, Any] = {"name": "prism", "classes": {"bar": bar, "cable": cable}, "shape": shape}
    structure = assemble(document)
    if rigid:
        stiff = np.where(structure.is_bar, 0.0, structure.spring_constant)
        rest = np.where(structure.is_bar, structure.member_length(), structure.rest_length)
        damping = np.where(structure.is_bar, 0.0, structure.damping)
        structure = structure.with_changes(spring_constant=stiff, rest_length=rest, damping=damping)
    if not free:
        held = np.zeros((structure.n_nodes, 3), dtype=bool)
        held[[name.startswith("b") for name in structure.node_name]] = True
        structure = structure.with_changes(node_anchored=held)
    return limit(actuate(structure, start, rate=rate))


MODELS: dict[tuple[int, str, bool], tuple[Any, CompiledModel]] = {}
PLANS: dict[tuple[int, str], tuple[Any, PlanResult]] = {}


def compile_motion(
    structure: Any, formulation: str = "node_position", *, simulates: bool = True
) -> CompiledModel:
    """Return the model of a structure, for plans, timed motions and simulations; not optimised."""
    key = (id(structure), formulation, simulates)
    if key not in MODELS:
        MODELS[key] = (structure, _compile(structure, formulation, simulates))
    return MODELS[key][1]


def _compile(structure: Any, formulation: str, simulates: bool) -> CompiledModel:
    request = ModelRequest((), formulation=formulation)
    with without_optimisation():
        wanted = want_analyses(
            structure, request, ("plan", "time_motion", *(("simulate",) if simulates else ()))
        )
        return build_library(structure, wanted).load()


def plan_prism(
    structure: Structure, formulation: str = "node_position", *, simulates: bool = True
) -> PlanResult:
    """Return the plan of a prism from 155 to 165 degrees of twist."""
    key = (id(structure), formulation)
    if key not in PLANS:
        found = plan(compile_motion(structure, formulation, simulates=simulates), "twist=165")
        assert found.status == "found", found.message
        PLANS[key] = (structure, found)
    return PLANS[key][1]
