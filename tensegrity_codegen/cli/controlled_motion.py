"""The scene of `control` as one case, and the controller in C that the verb writes."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.control_options import CodeOptions, DesignOptions, MotionOptions
from tensegrity_codegen.cli.inputs import read_inputs
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import name_options, quote_command

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.analyses.plans.held_motion import HeldMotion
    from tensegrity_codegen.control.feedback.loop.sampled_plant import Gust
    from tensegrity_codegen.control.feedback.mpc import Mpc
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject


def read_controlled(
    output: Output, scene: Path, held: "HeldMotion", inputs: list[str] | None, compiler: str | None
) -> "SceneCase":
    """Return the scene with the actuators of a motion, and the values of --input."""
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.analyses.plans.planned import add_actuators

    structure, request = output.load(scene, settles=True)
    structure = add_actuators(structure, held.actuate)
    return SceneCase(
        structure,
        request,
        inputs=read_inputs(inputs, structure, output),
        compiler=compiler,
        warn=output.warn,
        command=quote_command(),
        name_options=name_options,
    )


def check_build(code: CodeOptions, scene: Path, overwrite: bool) -> None:
    """Raise OutputError for a folder that cannot be written, UnknownNameError for a precision."""
    from tensegrity_codegen.system.output_folder import check_folder
    from tensegrity_codegen.tables.precision import find_precision

    find_precision(code.precision, "precision")
    if code.build is not None:
        check_folder(code.build, inputs=[scene], overwrite=overwrite)


def write_controller(
    output: Output,
    study: "ControlStudy",
    model: "CompiledModel",
    code: CodeOptions,
    *,
    scene: Path,
    compiler: str | None,
    overwrite: bool,
) -> dict[str, Any] | None:
    """Write the controller of a study that holds; return folder, files and sizes, JSON-ready."""
    from tensegrity_codegen.control.embedded.build_controller import build_controller
    from tensegrity_codegen.control.embedded.parts import ControllerCode

    if code.build is None:
        return None
    if not study.holds:
        output.warn("the controller in C is not written, for feedback does not hold")
        return None
    bundle = build_controller(
        model, study.motion, study.mpc or study.gains, estimator=study.estimator,
        distribution=study.distribution, out=code.build, overwrite=overwrite,
        code=ControllerCode(precision=code.precision, compiler=compiler), inputs=[scene],
    )  # fmt: skip
    made = bundle.description
    return {
        "folder": str(bundle.folder),
        "files": list(bundle.files),
        "name": made.name,
        "precision": made.precision,
        "gain_knots": None if study.mpc else len(study.gains.time),
        "table_bytes": made.table_bytes,
        "library": made.library,
    }


def check_motion_gusts(gusts: "Sequence[Gust | RandomGust]", t_end: float | None) -> None:
    """Raise InvalidValueError for a gust after the simulated time, where that is known before the motion."""
    from tensegrity_codegen.control.feedback.study.stated_errors import check_gust_times

    if t_end is not None:
        check_gust_times(gusts, t_end)


def design_prediction(
    output: Output, scene: Path, stated: MotionOptions, design: DesignOptions, compiler: str | None
) -> "tuple[Subject, tuple[CompiledModel, Motion, Mpc]]":
    """Return the structure with its actuators, its model, the motion, and model-predictive control."""
    from tensegrity_codegen.analyses.plans.held_motion import FeedbackDesign
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS

    held, options = stated.to_motion(), design.to_feedback()
    held.check(options.sample, None, None)
    options.check()
    case = read_controlled(output, scene, held, stated.input, compiler)
    model = case.build_library(case.subject, held.request_model(case), MANY_CALLS).load()
    motion = held.find(case, model, None)
    with output.progress("designing feedback"):
        parts = FeedbackDesign(model, motion, options, case.inputs).build()
    return case.subject, (model, motion, parts["gains"])
