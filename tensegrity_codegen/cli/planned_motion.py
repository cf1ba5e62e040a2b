"""The model of a structure that moves to targets, and its plan: for the verbs `plan` and `control`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.output import Output

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


def compile_actuated(
    output: Output,
    scene: Path,
    to: Sequence[str] | None,
    actuate: Sequence[str] | None,
    compiler: str | None,
    find_request: "Callable[[Subject, ModelRequest], ModelRequest]",
) -> "tuple[Subject, CompiledModel, tuple[str, ...] | None]":
    """Return the structure with its actuators, its model, and the names of the actuators that are chosen.

    find_request: takes the structure and its request with statics; the quantities of the targets are added.
    """
    from tensegrity_codegen.control.planning.quadratic_program import require_solver
    from tensegrity_codegen.control.planning.target_text import read_targets
    from tensegrity_codegen.control.planning.targets import find_target_quantities
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import with_statics
    from tensegrity_codegen.structure.applied_inputs import actuate_members

    quantities: Sequence[str] = ()
    if to:
        require_solver()
        quantities = find_target_quantities(read_targets(list(to)))
    subject, request = output.load(scene, settles=True)
    chosen = None
    if actuate:
        subject, chosen = actuate_members(subject, actuate)
    wanted = find_request(subject, with_statics(subject, request))
    wanted = replace(wanted, quantities=(*wanted.quantities, *quantities))
    return subject, build_library(subject, wanted, compiler=compiler, calls=MANY_CALLS).load(), chosen


def find_plan(
    output: Output,
    model: "CompiledModel",
    to: Sequence[str],
    chosen: tuple[str, ...] | None,
    *,
    arguments: Mapping[str, Any],
    **options: Any,
) -> "PlanResult":
    """Return the plan to targets, whether it is found or not, after its warnings."""
    from tensegrity_codegen.control.planning.plan import plan

    with output.progress("planning") as move:
        found = plan(
            model, list(to), actuators=chosen, arguments=arguments,
            progress=lambda points, done: move(done), **options,
        )  # fmt: skip
    output.warn(*found.warnings)
    return found
