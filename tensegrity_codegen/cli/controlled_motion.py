"""The motion that `control` holds: planned, read from a file, or an equilibrium."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.control_options import (
    CodeOptions,
    DesignOptions,
    MotionOptions,
    StudyOptions,
)
from tensegrity_codegen.cli.inputs import read_inputs
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.planned_motion import compile_actuated, find_plan
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InfeasibleError,
    InvalidValueError,
    TensegrityError,
)

if TYPE_CHECKING:
    from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
    from tensegrity_codegen.control.feedback.loop.sampled_plant import Gust
    from tensegrity_codegen.control.feedback.mpc import Mpc
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.control.feedback.study.stated_errors import RandomGust
    from tensegrity_codegen.control.feedback.study.tuning import Tuning
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class ControlDesign:
    """What the options state of the controller."""

    model: "CompiledModel"
    motion: "Motion"
    options: DesignOptions
    arguments: Mapping[str, Any]
    in_c: bool = False
    warn: Callable[[str], None] | None = None

    @property
    def lacks_sensors(self) -> bool:
        """Whether an estimator has nothing to measure."""
        structure = self.model.structure
        return self.options.estimator and (structure is None or not structure.sensors)

    def build(self) -> dict[str, Any]:
        """Return tuning, gains, estimator and distribution, as `study_control` takes them."""
        from tensegrity_codegen.control.feedback.study.read_files import read_weights
        from tensegrity_codegen.control.feedback.study.tuning import choose_weights, design_limited

        model, motion, given = self.model, self.motion, self.arguments
        wanted = self.options.integral_action
        names = None if wanted is None else [name for name in wanted if name != "none"]
        tuning = choose_weights(
            model, motion, sample=self.options.sample, tolerance=self.options.tolerance,
            effort=self.options.effort, response_time=self.options.response_time,
            integral_action=names, arguments=given,
        )  # fmt: skip
        if self.options.weights is not None:
            q, r = read_weights(self.options.weights)
            tuning = replace(tuning, Q=q, R=r)
        gains = self._design_gains(tuning)
        senses = None
        if self.options.estimator and not self.lacks_sensors:
            senses = self._design_estimator(tuning, gains)
        feedback, spread = design_limited(
            model, motion, tuning, gains, least_tension=self.options.least_tension, mpc=self.options.mpc,
            horizon=self.options.horizon, arguments=given,
        )  # fmt: skip
        return {"tuning": tuning, "gains": feedback, "estimator": senses, "distribution": spread}

    def _design_estimator(self, tuning: "Tuning", gains: "Gains") -> "Estimator":
        """Return the estimator; disturbances that are not stated are as large as noise permits."""
        from tensegrity_codegen.control.feedback.kalman import design_kalman
        from tensegrity_codegen.control.feedback.study.linear_loop import design_slow_estimator

        if self.options.disturbance is not None:
            return design_kalman(
                self.model, self.motion, sample=self.options.sample, disturbance=self.options.disturbance,
                only_observable=self.options.only_observable, arguments=self.arguments,
            )  # fmt: skip
        estimator, warning = design_slow_estimator(
            self.model, self.motion, gains, tuning.scales, only_observable=self.options.only_observable,
            arguments=self.arguments,
        )  # fmt: skip
        if warning is not None and self.warn is not None:
            self.warn(warning)
        return estimator

    def _design_gains(self, tuning: "Tuning") -> "Gains":
        """Return the gains; an error of the weights names their file."""
        from tensegrity_codegen.control.feedback.lqr import design_lqr

        try:
            gains = design_lqr(
                self.model, self.motion, tuning.Q, tuning.R, sample=self.options.sample,
                integral_action=tuning.integral_action, arguments=self.arguments,
            )  # fmt: skip
        except InvalidValueError as error:
            if self.options.weights is not None and error.where in ("Q", "R"):
                error.where = f"{self.options.weights}: {error.where}"
            raise
        return gains.at_knots() if self.in_c else gains  # as a controller in C stores them


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


SLOWER = 2.0  # than the shortest motion: the other half of the rates is for feedback


def check_motion_times(held: MotionOptions, design: DesignOptions, study: StudyOptions) -> None:
    """Raise InvalidValueError for times that are wrong whatever the motion will be."""
    from tensegrity_codegen.control.feedback.study.stated_errors import HELD_TIME, check_times

    if held.is_at_rest and held.duration is not None:
        raise InvalidValueError(
            "an equilibrium that is held has no duration",
            where="--duration", given=held.duration, allowed="--duration with --to or --plan",
            hint="--t-end sets the simulated time",
        )  # fmt: skip
    length = HELD_TIME if held.is_at_rest and study.t_end is None else held.duration
    check_times(design.sample, duration=length, t_end=study.t_end, last=study.last)


def check_motion_gusts(gusts: "Sequence[Gust | RandomGust]", t_end: float | None) -> None:
    """Raise InvalidValueError for a gust after the simulated time, where that is known before the motion."""
    from tensegrity_codegen.control.feedback.study.stated_errors import check_gust_times

    if t_end is not None:
        check_gust_times(gusts, t_end)


def compile_control(
    output: Output,
    scene: Path,
    held: MotionOptions,
    compiler: str | None,
) -> "tuple[Subject, CompiledModel, tuple[str, ...] | None]":
    """Return the structure with its actuators, its model, and the names of the actuators that are chosen."""
    from tensegrity_codegen.pipeline.analyses import find_needs, want_analyses

    if held.to and held.plan is not None:
        raise InvalidValueError(
            "a motion is given twice",
            where="--plan",
            given=f"--to {held.to[0]} and --plan {held.plan}",
            allowed="one of them",
        )

    def find_request(subject: "Subject", request: "ModelRequest") -> "ModelRequest":
        _check_formulation(request)
        moves = bool(held.to) or held.plan is not None
        needs = find_needs("time_motion" if moves else "equilibrium", subject, request).alone(request)
        return want_analyses(subject, needs, ("control",))

    try:
        return compile_actuated(output, scene, held.to, held.actuate, compiler, find_request)
    except TensegrityError as error:
        error.where = "--to" if error.where == "targets" else error.where
        raise


def _check_formulation(request: "ModelRequest") -> None:
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
    held: MotionOptions,
    chosen: tuple[str, ...] | None,
    *,
    arguments: Mapping[str, Any],
    t_end: float | None,
) -> "Motion":
    """Return the motion: of a new plan, of a plan in a file, or at rest in the equilibrium."""
    from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
    from tensegrity_codegen.control.feedback.study.read_files import read_path
    from tensegrity_codegen.control.feedback.study.stated_errors import HELD_TIME
    from tensegrity_codegen.control.feedback.time_motion import time_motion
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    if held.to:
        path: Any = _find_plan(output, model, held.to, chosen, arguments)
    elif held.plan is not None:
        path = read_path(held.plan, model)
    else:
        found = find_equilibrium(model, arguments=arguments)
        return build_rest(model, found, HELD_TIME if t_end is None else t_end, arguments, chosen)
    try:
        with output.progress("putting the plan in time"):
            motion = time_motion(model, path, held.duration, arguments=arguments)
            if held.duration is None:
                motion = time_motion(model, path, SLOWER * motion.duration, arguments=arguments)
    except InvalidValueError as error:
        if held.plan is not None and error.where == "path":
            error.where = f"{held.plan}: path"
            error.hint = "the plan may be of another scene, or of other values of --input: plan anew"
        raise
    output.warn(*motion.warnings)
    return motion


def design_prediction(
    output: Output, scene: Path, held: MotionOptions, options: DesignOptions, compiler: str | None
) -> "tuple[Subject, tuple[CompiledModel, Motion, Mpc]]":
    """Return the structure with its actuators, its model, the motion, and model-predictive control."""
    from tensegrity_codegen.control.feedback.study.tuning import read_least_tension

    check_motion_times(held, options, StudyOptions())
    read_least_tension(options.least_tension)
    subject, model, chosen = compile_control(output, scene, held, compiler)
    arguments = read_inputs(held.input, subject, output)
    motion = find_motion(output, model, held, chosen, arguments=arguments, t_end=None)
    with output.progress("designing feedback"):
        return subject, (model, motion, ControlDesign(model, motion, options, arguments).build()["gains"])


def _find_plan(
    output: Output,
    model: "CompiledModel",
    to: Sequence[str],
    chosen: tuple[str, ...] | None,
    arguments: Mapping[str, Any],
) -> "PlanResult":
    """Return a plan that was found; raises InfeasibleError or ConvergenceError where there is none."""
    found = find_plan(output, model, to, chosen, arguments=arguments)
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
