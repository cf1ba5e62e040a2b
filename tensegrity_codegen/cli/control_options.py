"""Options of the verb `control`, how their texts are read, its scene as one case, and the controller in C."""

import math
import re
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from tensegrity_codegen.cli.options import InputOption, parse_vector, read_folder, read_inputs
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import name_options, quote_command
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.analyses.plans.held_motion import FeedbackOptions, HeldMotion
    from tensegrity_codegen.control.feedback.loop.sampled_plant import Gust
    from tensegrity_codegen.control.feedback.mpc import Mpc
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust, StatedErrors
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject


@dataclass(frozen=True)
class MotionOptions:
    """What is held: a motion to targets, that of a plan, or an equilibrium."""

    to: Annotated[
        list[str] | None,
        typer.Option(
            "--to",
            help="TARGET=VALUE of a plan, as of the verb plan; may be repeated; without it and --plan the "
            "equilibrium is held.",
            show_default=False,
        ),
    ] = None
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Result file of the verb plan (.npz), in place of --to.")
    ] = None
    actuate: Annotated[
        list[str] | None,
        typer.Option(
            "--actuate",
            help="What moves: cables, all, or a name of actuators, members, groups or classes; may be "
            "repeated; default: the actuators of the scene.",
            show_default=False,
        ),
    ] = None
    input: InputOption = None
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration", help="Time of the motion [s]; default: twice the shortest that the rates permit."
        ),
    ] = None

    def to_motion(self) -> "HeldMotion":
        """Return the motion that is held."""
        from tensegrity_codegen.analyses.plans.held_motion import HeldMotion

        return HeldMotion(tuple(self.to or ()), self.plan, tuple(self.actuate or ()), self.duration)


@dataclass(frozen=True)
class MpcOptions:
    """Weights, horizon and least tensions of the controller."""

    sample: Annotated[float, typer.Option("--sample", help="Time between two commands [s].")] = 0.005
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            help="Displacement of a node that the weights accept for a moment [m]; default: a twentieth of "
            "the size of the structure.",
        ),
    ] = None
    effort: Annotated[
        float | None,
        typer.Option(
            "--effort",
            help="Change of a rest length that the weights accept [m]; larger: stronger feedback; default: "
            "the least of --tolerance / 20, rate times --response-time and half the range.",
        ),
    ] = None
    response_time: Annotated[
        float | None,
        typer.Option(
            "--response-time",
            help="Time in which the weights accept a change by --tolerance [s]; default: 1 over the lowest "
            "natural frequency [rad/s].",
        ),
    ] = None
    integral_action: Annotated[
        list[str] | None,
        typer.Option(
            "--integral",
            help="Coordinate whose error is summed; may be repeated; none: no integral action; default: all, "
            "or what the actuators can move.",
            show_default=False,
        ),
    ] = None
    weights: Annotated[
        Path | None,
        typer.Option("--weights", help="Weights in place of those of the options: .npz with arrays Q and R."),
    ] = None
    least_tension: Annotated[
        str | None,
        typer.Option(
            "--least-tension",
            help="Distribute tensions so that none is below this [N]; scene: below the limits of the scene, "
            "as --mpc does by default.",
        ),
    ] = None
    horizon: Annotated[int, typer.Option("--horizon", help="Commands that --mpc plans ahead.")] = 20


@dataclass(frozen=True)
class DesignOptions(MpcOptions):
    """With gains, or model-predictive control; and an estimator."""

    mpc: Annotated[
        bool,
        typer.Option(
            "--mpc",
            help="Model-predictive control in place of stored gains: plans ahead within rates, ranges and "
            "least tensions; implies --in-c.",
        ),
    ] = False
    estimator: Annotated[
        bool,
        typer.Option("--estimator/--no-estimator", help="Simulate an estimator, where there are sensors."),
    ] = True
    disturbance: Annotated[
        float | None,
        typer.Option(
            "--disturbance",
            help="How fast the estimator lets disturbance forces change [N or N m in 1 s]; 0: none is "
            "estimated.",
        ),
    ] = None
    only_observable: Annotated[
        bool,
        typer.Option(
            "--only-observable", help="Estimate disturbance forces only where the sensors tell them apart."
        ),
    ] = False

    def to_feedback(self) -> "FeedbackOptions":
        """Return the options of the controller."""
        from tensegrity_codegen.analyses.plans.held_motion import FeedbackOptions

        integral_action = None if self.integral_action is None else tuple(self.integral_action)
        return FeedbackOptions(**{**vars(self), "integral_action": integral_action})


@dataclass(frozen=True)
class StudyOptions:
    """Disturbances, their draws, and the simulated time."""

    start_error: Annotated[
        list[str] | None,
        typer.Option(
            "--start-error",
            help="By how much every coordinate is off at the start: a displacement of nodes (3mm) or, of "
            "angles, an angle (1.2deg); both may be given; default: a hundredth of the size of the "
            "structure, at most a tenth of the shortest rigid distance, less along stiff members.",
            show_default=False,
        ),
    ] = None
    stiffness_error: Annotated[
        float,
        typer.Option(
            "--stiffness-error",
            help="Part by which the stiffness of each cable is off, up or down by the draw.",
        ),
    ] = 0.05
    gust: Annotated[
        list[str] | None,
        typer.Option(
            "--gust",
            help="NODE=FX,FY,FZ@START+DURATION: a force on a node [N, s]; NODE=F@...: of random direction; "
            "without START from 0 s, without DURATION for 0.2 s; "
            "NODE may be a pattern such as 't*', of which one node is drawn; may be repeated.",
            show_default=False,
        ),
    ] = None
    draws: Annotated[int, typer.Option("--draws", help="Number of draws of the disturbances.")] = 5
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws and of the noise.")] = 0
    t_end: Annotated[
        float | None,
        typer.Option("--t-end", help="Simulated time [s]; default: three times the motion, 2 s at rest."),
    ] = None
    in_c: Annotated[
        bool,
        typer.Option("--in-c", help="Simulate in C, many draws at once, with the gains that --build stores."),
    ] = False
    last: Annotated[
        float | None,
        typer.Option(
            "--last",
            help="Time before the end in which errors are compared [s]; default: a sixth of --t-end.",
        ),
    ] = None


@dataclass(frozen=True)
class CodeOptions:
    """The controller in C that is written."""

    build: Annotated[
        Path | None,
        typer.Option(
            "--build",
            parser=read_folder,
            metavar="<path>",
            help="Write the controller in C into this folder, where feedback holds; other files there stay, "
            "its own are replaced.",
        ),
    ] = None
    name: Annotated[
        str | None,
        typer.Option("--name", help="First word of all names of the controller in C; default: the scene's."),
    ] = None
    precision: Annotated[
        str, typer.Option("--precision", help="Of the controller in C: double or single.")
    ] = "double"


def list_export_options() -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of the options of `export` for a motion and its control."""
    listed: dict[str, tuple[Any, Any]] = {}
    for group in (MotionOptions, MpcOptions):
        for name, hint in get_type_hints(group, include_extras=True).items():
            kind, option = get_args(hint)
            option_copy, default = copy(option), getattr(group, name)
            option_copy.help = f"acados: {option.help}" + (
                "" if default is None else f" [default: {default}]"
            )
            listed[name] = (Annotated[kind | None, option_copy], None)
    del listed["sample"]
    return listed


def read_export_options(given: Mapping[str, Any]) -> tuple[MotionOptions, DesignOptions]:
    """Return the options of `export` for a motion and its control as those of the verb `control`."""
    stated = {name: value for name, value in given.items() if value is not None}
    held = MotionOptions(**{key: stated.pop(key) for key in vars(MotionOptions()) if key in stated})
    return held, DesignOptions(**stated, mpc=True, estimator=False)


def read_errors(options: StudyOptions, axes: Sequence[int]) -> "StatedErrors":
    """Return the disturbances that the options state; raises InvalidValueError for texts that state none."""
    from tensegrity_codegen.control.feedback.study.stated_errors import StatedErrors, read_start_errors

    length, angle = read_start_errors(options.start_error or ())
    drawn = tuple(_read_gust(error_text, axes) for error_text in options.gust or ())
    return StatedErrors(length, angle, options.stiffness_error, drawn)


def _read_gust(text: str, axes: Sequence[int]) -> "RandomGust":
    from tensegrity_codegen.control.feedback.study.stated_errors import NUMBER, RandomGust

    node, equals, rest = text.partition("=")
    vector, at, times = rest.partition("@")
    match = re.fullmatch(rf"\s*({NUMBER})\s*(?:\+\s*({NUMBER})\s*)?", times) if at else None
    if not equals or not node.strip() or (at and match is None):
        allowed = "NODE=FX,FY,FZ@START+DURATION, or NODE=F@START+DURATION"
        hint = "for example t1=0,0,-5@0.5+0.2, or 't*=5@0.5+0.2'"
        raise InvalidValueError("not a gust", where="--gust", given=text, allowed=allowed, hint=hint)
    start = float(match[1]) if match else 0.0
    duration = float(match[2]) if match and match[2] else 0.2
    return RandomGust(node.strip(), _read_force(vector, node.strip(), axes), start, duration)


def _read_force(text: str, node: str, axes: Sequence[int]) -> float | tuple[float, float, float]:
    if "," in text:
        return parse_vector(text, f"--gust {node}", axes)
    try:
        size = float(text)
    except ValueError:
        size = math.nan
    if not math.isfinite(size) or size < 0.0:
        allowed = "FX,FY,FZ or one number >= 0 [N]"
        raise InvalidValueError("not a force", where=f"--gust {node}", given=text, allowed=allowed)
    return size


def read_controlled(
    output: Output, scene: Path, held: "HeldMotion", inputs: list[str] | None, compiler: str | None
) -> "SceneCase":
    """Return the scene with the actuators of a motion, and the values of --input."""
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.analyses.plans.planned import add_actuators

    structure, request = output.load(scene, settles=True, sags=True)
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
    """Raise an error for a folder that cannot be written, a name, or a precision that is not known."""
    from tensegrity_codegen.scene.names import check_scene_name
    from tensegrity_codegen.system.output_folder import check_folder
    from tensegrity_codegen.tables.precision import find_precision

    find_precision(code.precision, "precision")
    if code.name is not None:
        check_scene_name(code.name, "--name")
    if code.build is not None:
        check_folder(code.build, inputs=[scene], overwrite=overwrite)


def check_estimator(code: CodeOptions, options: "FeedbackOptions", subject: "Subject") -> None:
    """Raise FormulationError for an estimator in C that is to know rigid bars or bodies."""
    from tensegrity_codegen.control.feedback.design.linear_samples import refuse_rigid_bars
    from tensegrity_codegen.structure.structure import Structure

    if code.build is not None and options.estimator and subject.sensors and isinstance(subject, Structure):
        hint = "--no-estimator, which takes the state as known: from motion capture, or an estimator of yours"
        refuse_rigid_bars(int(subject.is_rigid.sum()), subject.name, "an estimator in C", hint)


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
        code=ControllerCode(code.name, code.precision, compiler=compiler, inputs=[scene]),
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
        prediction_parts = FeedbackDesign(model, motion, options, case.inputs).build()
    return case.subject, (model, motion, prediction_parts["gains"])
