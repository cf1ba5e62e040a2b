"""A plan put in time: the option `--motion` of `plan`, its file and its part of the JSON."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.system.files import check_ending, check_output

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion


MOTION_ENDINGS = (".npz", ".csv")

MotionOption = Annotated[
    Path | None,
    typer.Option(
        "--motion",
        help="Put the plan in time by a quintic, with inverse dynamics, and write it: .npz, or .csv for "
        "`simulate --profile FILE --profile-kind cubic`.",
    ),
]


def check_motion_file(path: Path | None, scene: Path, overwrite: bool) -> None:
    """Raise OutputError for a file that cannot be written."""
    if path is not None:
        check_ending(path, *MOTION_ENDINGS)
        check_output(path, inputs=[scene], overwrite=overwrite)


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
    for text in motion.warnings:
        output.warn(text)
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
