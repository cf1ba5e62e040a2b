"""The motion that `control` holds: planned, read from a file, or an equilibrium."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InfeasibleError,
    InvalidValueError,
)

if TYPE_CHECKING:
    from tensegrity_codegen.control.feedback.loop.sampled_plant import Gust
    from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


SLOWER = 2.0  # than the shortest motion: the other half of the rates is for feedback


def check_motion_times(
    sample: float, duration: float | None, t_end: float | None, last: float | None, *, is_held: bool
) -> None:
    """Raise InvalidValueError for times that are wrong whatever the motion will be.

    is_held: whether an equilibrium is held, whose time is known.
    """
    from tensegrity_codegen.control.feedback.study.stated_errors import HELD_TIME, check_times

    if is_held and duration is not None:
        raise InvalidValueError(
            "an equilibrium that is held has no duration",
            where="--duration", given=duration, allowed="--duration with --to or --plan",
            hint="--t-end sets the simulated time",
        )  # fmt: skip
    length = HELD_TIME if is_held and t_end is None else duration
    check_times(sample, duration=length, t_end=t_end, last=last)


def check_motion_gusts(gusts: "Sequence[Gust | RandomGust]", t_end: float | None) -> None:
    """Raise InvalidValueError for a gust after the simulated time, where that is known before the motion."""
    from tensegrity_codegen.control.feedback.study.stated_errors import check_gust_times

    if t_end is not None:
        check_gust_times(gusts, t_end)


def compile_control(
    output: Output,
    scene: Path,
    to: Sequence[str] | None,
    plan: Path | None,
    actuate: Sequence[str] | None,
    compiler: str | None,
) -> "tuple[Subject, CompiledModel, tuple[str, ...] | None]":
    """Return the structure with its actuators, its model, and the names of the actuators that are chosen."""
    from tensegrity_codegen.control.planning.quadratic_program import require_solver
    from tensegrity_codegen.control.planning.target_text import read_targets
    from tensegrity_codegen.control.planning.targets import find_target_quantities
    from tensegrity_codegen.pipeline.analyses import find_needs, want_analyses
    from tensegrity_codegen.pipeline.build_library import build_library
    from tensegrity_codegen.pipeline.settle import with_statics
    from tensegrity_codegen.structure.actuate import actuate_members

    if to and plan is not None:
        raise InvalidValueError(
            "a motion is given twice",
            where="--plan",
            given=f"--to {to[0]} and --plan {plan}",
            allowed="one of them",
        )
    quantities: Sequence[str] = ()
    if to:
        require_solver()
        quantities = find_target_quantities(read_targets(list(to)))
    subject, request = output.load(scene, settles=True)
    chosen = None
    if actuate:
        subject, chosen = actuate_members(subject, actuate)
    statics = with_statics(subject, request)
    _check_formulation(subject, statics)
    needs = find_needs("time_motion", subject, statics).alone(statics)
    wanted = want_analyses(subject, needs, ("control",))
    wanted = wanted.wanting(*wanted.quantities, *quantities, integrators=wanted.integrators)
    return subject, build_library(subject, wanted, compiler=compiler).load(), chosen


def _check_formulation(subject: "Subject", request: "ModelRequest") -> None:
    """Raise FormulationError where coordinates depend on each other: rigid bars between nodes."""
    from tensegrity_codegen.tables.formulations import find_formulation

    formulation = find_formulation(request.formulation)
    if formulation.of_bodies or (formulation.in_nodes and not formulation.has_rigid_bars):
        return
    raise FormulationError(
        "feedback needs coordinates that are independent of each other; those of rigid bars are not",
        where="model.formulation",
        given=f"formulation {request.formulation!r}",
        allowed='"node_position" with bars that have a stiffness, or a scene of bodies',
        hint="give the class of the bars a spring_constant and a damping, or state the bars as [bodies]",
    )


def find_motion(
    output: Output,
    model: "CompiledModel",
    to: Sequence[str] | None,
    plan: Path | None,
    chosen: tuple[str, ...] | None,
    *,
    duration: float | None,
    arguments: Mapping[str, Any],
    t_end: float | None,
) -> "Motion":
    """Return the motion: of a new plan, of a plan in a file, or at rest in the equilibrium."""
    from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
    from tensegrity_codegen.control.feedback.study.read_files import read_path
    from tensegrity_codegen.control.feedback.study.stated_errors import HELD_TIME
    from tensegrity_codegen.control.feedback.time_motion import time_motion
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    if to:
        path: Any = _find_plan(output, model, to, chosen, arguments)
    elif plan is not None:
        path = read_path(plan, model)
    else:
        found = find_equilibrium(model, arguments=arguments)
        return build_rest(model, found, HELD_TIME if t_end is None else t_end, arguments, chosen)
    try:
        with output.progress("putting the plan in time"):
            motion = time_motion(model, path, duration, arguments=arguments)
            if duration is None:
                motion = time_motion(model, path, SLOWER * motion.duration, arguments=arguments)
    except InvalidValueError as error:
        if plan is not None and error.where == "path":
            error.where = f"{plan}: path"
            error.hint = "the plan may be of another scene, or of other values of --input: plan anew"
        raise
    for text in motion.warnings:
        output.warn(text)
    return motion


def _find_plan(
    output: Output,
    model: "CompiledModel",
    to: Sequence[str],
    chosen: tuple[str, ...] | None,
    arguments: Mapping[str, Any],
) -> "PlanResult":
    """Return a plan that was found; raises InfeasibleError or ConvergenceError where there is none."""
    from tensegrity_codegen.control.planning.plan import plan

    with output.progress("planning") as move:
        found = plan(
            model, list(to), actuators=chosen, arguments=arguments, progress=lambda points, done: move(done)
        )
    for text in found.warnings:
        output.warn(text)
    if not found.is_found:
        kind = InfeasibleError if found.status == "infeasible" else ConvergenceError
        raise kind(
            f"there is no plan to hold: {found.message}",
            evidence={"status": found.status},
            where=", ".join(to),
            hint="the verb plan shows what binds",
        )
    if found.n_steps == 0:
        raise InvalidValueError(
            "the structure is at its target already, so that nothing moves",
            where="--to",
            given=", ".join(to),
            allowed="another target, or no target: then the equilibrium is held",
        )
    return found
