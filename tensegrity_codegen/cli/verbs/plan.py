"""`tensegrity-codegen plan`: rest lengths that move a structure to a target through stable equilibria."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.control_options import ActuateOption
from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result, write_page
from tensegrity_codegen.cli.planned_motion import compile_actuated, find_plan
from tensegrity_codegen.cli.verb import Verb, name_options, quote_command

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

MOTION_ENDINGS = (".npz", ".csv")

MotionOption = Annotated[
    Path | None,
    typer.Option(
        "--motion",
        help="Put the plan in time by a quintic, with inverse dynamics, and write it: .npz, or .csv for "
        "`simulate --profile FILE --profile-kind cubic`.",
    ),
]


def time_plan(
    output: Output,
    model: Any,
    found: "PlanResult",
    path: Path | None,
    *,
    duration: float | None,
    arguments: Mapping[str, Any],
    overwrite: bool,
) -> "Motion | None":
    """Return the motion of a plan that was found, after it is written; None where there is none."""
    from tensegrity_codegen.control.feedback.time_motion import time_motion

    if path is None or not found.is_found or found.n_steps == 0:
        return None
    has_masses = model.has("acceleration")
    if not has_masses:
        output.warn("without masses the inputs of the motion are those of its equilibria")
    kind = "dynamic" if has_masses else "static"
    with output.progress("putting the plan in time"):
        motion = time_motion(model, found, duration, feedforward=kind, arguments=arguments)
    output.warn(*motion.warnings)
    motion.write(path, overwrite=overwrite)
    return motion


def describe_motion(motion: "Motion | None", path: Path | None) -> dict[str, Any] | None:
    """Return the facts of a motion as one JSON-ready object."""
    if motion is None:
        return None
    return {
        "out": str(path),
        "duration": motion.duration,
        "shortest_duration": motion.shortest_duration,
        "peak_rate": dict(zip(motion.actuators, motion.peak_rate.tolist(), strict=True)),
        "largest_residual": float(motion.residual.max(initial=0.0)),
    }


ToOption = Annotated[
    list[str],
    typer.Option(
        "--to",
        help="TARGET=VALUE: twist=165, tilt=10, height=250mm, 'member_length[\"c1\"]=0.2' and others "
        "(docs/planning.md); may be repeated.",
        show_default=False,
    ),
]
OutOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--out", "-o", help="Result file: .npz, or .csv for `simulate --profile`; may be repeated.",
        show_default=False,
    ),
]  # fmt: skip
PageOption = Annotated[
    Path | None,
    typer.Option("--page", help="Write a page with shapes, tensions, clearances and what binds (.html)."),
]
StepsOption = Annotated[
    int, typer.Option("--steps", min=1, help="Number of steps where nothing limits them.")
]
MostOption = Annotated[int, typer.Option("--max-steps", min=1, help="Largest number of steps and attempts.")]
LeastOption = Annotated[
    float,
    typer.Option(
        "--least-progress",
        help="The path ends where limits leave less than this part of a step 8 times in a row; 0: where they "
        "leave none.",
    ),
]
AttemptsOption = Annotated[
    int,
    typer.Option(
        "--attempts",
        min=0,
        help="Largest number of other paths where limits block the first: two begin with other changes, more "
        "go over shapes that random walks lead to.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Of the random changes and walks.")]
DurationOption = Annotated[
    float | None,
    typer.Option("--duration", help="Time of the plan [s]; default: the shortest that the rates permit."),
]


@dataclass(frozen=True)
class StepOptions:
    """Steps of a path."""

    steps: StepsOption = 20
    max_steps: MostOption = 200
    least_progress: LeastOption = 0.4
    attempts: AttemptsOption = 2
    seed: SeedOption = 0


def plan(
    scene: SceneArgument,
    to: ToOption,
    actuate: ActuateOption = None,
    input: InputOption = None,
    *,
    stepping: StepOptions,
    duration: DurationOption = None,
    out: OutOption = None,
    page: PageOption = None,
    motion: MotionOption = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    printing: PrintOptions,
) -> None:
    """Plan rest lengths that move a structure to a target, through stable equilibria within its limits.

    The plan is found, proved infeasible, or blocked by limits that are named; a blocked path proves nothing
    about others. Exit code 3 unless it is found.

    Example: tensegrity-codegen plan prism12.toml --to twist=165 --out plan.csv
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        from tensegrity_codegen.control.planning.record_plan import ENDINGS, write_plan
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.sweeps.engines.threads import limit_threads

        files = list(out or [])
        for file in files:
            check_result(file, *ENDINGS, inputs=[scene], overwrite=overwrite)
        check_result(page, ".html", inputs=[scene], overwrite=overwrite, draws=True)
        check_result(motion, *MOTION_ENDINGS, inputs=[scene], overwrite=overwrite)
        analysis = "plan" if motion is None else "time_motion"

        def find_request(subject: "Subject", request: "ModelRequest") -> "ModelRequest":
            return find_needs(analysis, subject, request).alone(request)

        subject, model, chosen = compile_actuated(output, scene, to, actuate, compiler, find_request)
        arguments = read_inputs(input, subject, output)
        limit_threads()  # the matrices are too small for several: waiting for each other takes longer
        found = find_plan(output, model, to, chosen, arguments=arguments, duration=duration, **vars(stepping))
        timed = time_plan(
            output, model, found, motion, duration=duration, arguments=arguments, overwrite=overwrite
        )
        for file in files:
            write_plan(found, file, overwrite=overwrite)
        if page is not None:
            from tensegrity_codegen.control.pages.plan_page import build_plan_page
            from tensegrity_codegen.structure.outline import outline_bodies

            with output.progress("drawing"):
                named = replace(found, message=name_options(found.message))
                drawn = outline_bodies(subject)
                write_page(
                    build_plan_page(named, drawn, subject.limits, quote_command()), page, overwrite=overwrite
                )
        profiles = [*files, *([motion] if motion is not None and timed is not None else [])]
        if actuate and any(file.suffix.lower() == ".csv" for file in profiles):
            output.warn(
                "the scene needs [[actuators]] of these names for `simulate --profile` to follow the plan"
            )
        if found.time is None and any(file.suffix.lower() == ".csv" for file in files):
            output.warn(
                "no actuator has a rate, so the .csv has the progress in place of times: with --duration "
                "SECONDS `simulate --profile` can follow it"
            )
        written = {"out": [str(file) for file in files], "page": None if page is None else str(page)}
        _report(output, subject, found, written | {"motion": describe_motion(timed, motion)})
        if not found.is_found:
            raise typer.Exit(3)


def _report(output: Output, subject: "Subject", found: "PlanResult", more: dict[str, Any]) -> None:
    """Print the plan: targets, rest lengths, what limits it."""
    from tensegrity_codegen.control.pages.plans import (
        actuators_table,
        binding_table,
        certificate_table,
        describe_extremes,
        describe_plan,
        targets_table,
    )

    data = describe_plan(found) | more
    name = subject.name
    tables = [
        build(found, name) for build in (targets_table, actuators_table, binding_table, certificate_table)
    ]
    lines = describe_extremes(found)
    if found.time is not None:
        lines.append(f"takes {found.time[-1]:.6g} s")
    if more["motion"] is not None:
        facts = more["motion"]
        lines.append(f"motion of {facts['duration']:.6g} s, shortest {facts['shortest_duration']:.6g} s")
    shown = [table for table in tables if table is not None]
    output.result(data, f"{found.status}: {found.message}", *shown, *lines)


VERB = Verb(plan, order=310)
