"""The model of a structure with its actuators, and its plan to targets."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.control.planning.plan_point import require_actuators
from tensegrity_codegen.control.planning.quadratic_program import require_solver
from tensegrity_codegen.control.planning.target_text import read_targets
from tensegrity_codegen.control.planning.targets import find_target_quantities
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.structure.applied_inputs import actuate_members
from tensegrity_codegen.system.progress import work_pass

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


def add_actuators(structure: "Subject", actuate: Sequence[str]) -> "Subject":
    """Return a structure with the actuators that `--actuate` names."""
    return actuate_members(structure, actuate)[0] if actuate else structure


def list_actuators(structure: "Subject", actuate: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names of the actuators that `--actuate` names; None for all of the scene."""
    return actuate_members(structure, actuate)[1] if actuate else None


def request_actuated(
    case: "SceneCase",
    to: Sequence[str],
    choose_request: "Callable[[Subject, ModelRequest], ModelRequest]",
) -> "ModelRequest":
    """Return the request for the model of a structure that moves to targets; it must have actuators.

    choose_request: takes the structure and its request with statics; the quantities of the targets are added.
    """
    require_actuators(case.subject, case.subject.name)
    quantities: Sequence[str] = ()
    if to:
        require_solver()
        quantities = find_target_quantities(read_targets(list(to)))
    request = choose_request(case.subject, with_statics(case.subject, case.request))
    return replace(request, quantities=(*request.quantities, *quantities))


def plan_to_targets(
    case: "SceneCase", model: "CompiledModel", to: Sequence[str], actuate: Sequence[str], **options: Any
) -> "PlanResult":
    """Return the plan to targets, whether it is found or not, after its warnings."""
    with work_pass("planning") as move:
        result = plan(
            model,
            list(to),
            actuators=list_actuators(case.subject, actuate),
            arguments=case.inputs,
            progress=lambda points, done: move(done),
            **options,
        )
    case.warn(*result.warnings)
    return result
