"""The motion that feedback holds, planned, read from a file or at rest, and the design of its controller."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.analyses.plans.planned import list_actuators, plan_to_targets, request_actuated
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import HORIZON
from tensegrity_codegen.control.feedback.study.linear_loop import design_slow_estimator
from tensegrity_codegen.control.feedback.study.read_files import read_path, read_weights
from tensegrity_codegen.control.feedback.study.stated_errors import check_times
from tensegrity_codegen.control.feedback.study.tuning import (
    HELD_TIME,
    Tuning,
    choose_weights,
    design_limited,
    read_least_tension,
)
from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.pipeline.analyses import find_needs, want_analyses
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InfeasibleError,
    InvalidValueError,
    TensegrityError,
)
from tensegrity_codegen.system.progress import work_pass
from tensegrity_codegen.tables.formulations import find_formulation

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

SLOWER = 2.0  # than the shortest motion: the other half of the rates is for feedback


@dataclass(frozen=True)
class HeldMotion:
    """The motion that feedback holds: a motion to targets, that of a plan in a file, or an equilibrium.

    to: targets, as of the verb plan; plan: result file of that verb; actuate: the actuators, as of that verb.
    duration [s]: of the motion; None: twice the shortest.
    """

    to: tuple[str, ...] = ()
    plan: str | Path | None = None
    actuate: tuple[str, ...] = ()
    duration: float | None = None

    @property
    def is_at_rest(self) -> bool:
        """Whether an equilibrium is held."""
        return not self.to and self.plan is None

    def check(self, sample: float, t_end: float | None, last: float | None) -> None:
        """Raise InvalidValueError for two motions, or times that are wrong for every motion."""
        if self.to and self.plan is not None:
            raise InvalidValueError(
                "a motion is given twice",
                where="plan",
                given=f"{self.to[0]} and {self.plan}",
                allowed="targets such as tilt=10, or a plan, or neither: then the equilibrium is held",
            )
        if self.is_at_rest and self.duration is not None:
            raise InvalidValueError(
                "an equilibrium that is held has no duration",
                where="duration",
                given=self.duration,
                allowed="with `to` or `plan`",
                hint="`t_end` sets the simulated time",
            )
        length = HELD_TIME if self.is_at_rest and t_end is None else self.duration
        check_times(sample, duration=length, t_end=t_end, last=last)

    def choose_request(self, structure: "Subject", request: "ModelRequest") -> "ModelRequest":
        """Return the request for the motion and for feedback about it; raises FormulationError."""
        formulation = find_formulation(request.formulation)
        is_corrected = request.options.get("correction", "none") != "none"
        if is_corrected or not (formulation.of_bodies or formulation.in_nodes):
            raise FormulationError(
                "feedback needs coordinates that are independent of each other, or bars of constant length",
                where="model.formulation",
                given=f"formulation {request.formulation!r}",
                allowed='"node_position", "rigid_bar" with correction = "none", or a scene of bodies',
                hint='formulation = "node_position"',
            )
        analysis = "equilibrium" if self.is_at_rest else "time_motion"
        needs = find_needs(analysis, structure, request).alone(request)
        return want_analyses(structure, needs, ("control",))

    def request_model(self, case: "SceneCase") -> "ModelRequest":
        """Return the request for the model in which the motion is held."""
        try:
            return request_actuated(case, self.to, self.choose_request)
        except TensegrityError as error:
            error.where = "to" if error.where == "targets" else error.where
            raise

    def find(self, case: "SceneCase", model: "CompiledModel", t_end: float | None) -> "Motion":
        """Return the motion: of a new plan, of a plan in a file, or at rest in the equilibrium."""
        if self.is_at_rest:
            equilibrium = find_equilibrium(model, arguments=case.inputs)
            chosen = list_actuators(case.subject, self.actuate)
            return build_rest(model, equilibrium, HELD_TIME if t_end is None else t_end, case.inputs, chosen)
        path: Any = self._plan(case, model) if self.plan is None else read_path(self.plan, model)
        try:
            with work_pass("putting the plan in time"):
                motion = time_motion(model, path, self.duration, arguments=case.inputs)
                if self.duration is None:
                    motion = time_motion(model, path, SLOWER * motion.duration, arguments=case.inputs)
        except InvalidValueError as error:
            if self.plan is not None and error.where == "path":
                error.where = f"{self.plan}: path"
                error.hint = "the plan may be of another scene, or of other values of --input: plan anew"
            raise
        case.warn(*motion.warnings)
        return motion

    def _plan(self, case: "SceneCase", model: "CompiledModel") -> "PlanResult":
        """Return a plan that was found; raises InfeasibleError or ConvergenceError if there is none."""
        plan = plan_to_targets(case, model, self.to, self.actuate)
        if not plan.is_found:
            kind = InfeasibleError if plan.status == "infeasible" else ConvergenceError
            raise kind(
                f"there is no plan to hold: {plan.message}",
                evidence={"status": plan.status},
                where=", ".join(self.to),
                hint="the verb plan shows what binds",
            )
        if plan.n_steps == 0:
            raise InvalidValueError(
                "the structure is at its target already, so that nothing moves",
                where="to",
                given=", ".join(self.to),
                allowed="another target, or no target: then the equilibrium is held",
            )
        return plan


@dataclass(frozen=True)
class FeedbackOptions:
    """Weights, horizon and least tensions of a controller, and its estimator; as of the verb control."""

    sample: float = 0.005
    tolerance: float | None = None
    effort: float | None = None
    response_time: float | None = None
    integral_action: tuple[str, ...] | None = None
    weights: Path | None = None
    least_tension: str | None = None
    horizon: int = HORIZON
    mpc: bool = False
    estimator: bool = True
    disturbance: float | None = None
    only_observable: bool = False

    def check(self) -> None:
        """Raise InvalidValueError for a least tension that is no number and not the scene's."""
        read_least_tension(self.least_tension)


@dataclass(frozen=True)
class FeedbackDesign:
    """The design of feedback about a motion; arguments: inputs and parameters by name.

    in_c: whether gains are those at the knots that a controller in C stores.
    """

    model: "CompiledModel"
    motion: "Motion"
    options: FeedbackOptions
    arguments: Mapping[str, Any]
    in_c: bool = False
    warn: Callable[..., None] = lambda *texts: None

    @property
    def lacks_sensors(self) -> bool:
        """Whether an estimator has nothing to measure."""
        structure = self.model.structure
        return self.options.estimator and (structure is None or not structure.sensors)

    def build(self) -> dict[str, Any]:
        """Return tuning, gains before limits, gains, estimator and distribution, by these names."""
        options, model, motion = self.options, self.model, self.motion
        integral_action = options.integral_action
        tuning = choose_weights(
            model,
            motion,
            sample=options.sample,
            tolerance=options.tolerance,
            effort=options.effort,
            response_time=options.response_time,
            integral_action=None
            if integral_action is None
            else [name for name in integral_action if name != "none"],
            arguments=self.arguments,
        )
        if options.weights is not None:
            q, r = read_weights(options.weights)
            tuning = replace(tuning, Q=q, R=r)
        gains = self._design_gains(tuning)
        has_estimator = options.estimator and not self.lacks_sensors
        estimator = self._design_estimator(tuning, gains) if has_estimator else None
        feedback, distribution = design_limited(
            model,
            motion,
            tuning,
            gains,
            least_tension=options.least_tension,
            mpc=options.mpc,
            horizon=options.horizon,
            arguments=self.arguments,
        )
        return {
            "tuning": tuning,
            "stored_gains": gains,
            "gains": feedback,
            "estimator": estimator,
            "distribution": distribution,
        }

    def _design_estimator(self, tuning: Tuning, gains: "Gains") -> "Estimator":
        """Return the estimator; disturbances that are not stated are as large as noise permits."""
        options = self.options
        if options.disturbance is not None:
            return design_kalman(
                self.model,
                self.motion,
                sample=options.sample,
                disturbance=options.disturbance,
                only_observable=options.only_observable,
                arguments=self.arguments,
            )
        estimator, warning = design_slow_estimator(
            self.model,
            self.motion,
            gains,
            tuning.scales,
            only_observable=options.only_observable,
            arguments=self.arguments,
        )
        if warning is not None:
            self.warn(warning)
        return estimator

    def _design_gains(self, tuning: Tuning) -> "Gains":
        """Return the gains; an error of the weights names their file."""
        options = self.options
        try:
            gains = design_lqr(
                self.model,
                self.motion,
                tuning.Q,
                tuning.R,
                sample=options.sample,
                integral_action=tuning.integral_action,
                arguments=self.arguments,
            )
        except InvalidValueError as error:
            if options.weights is not None and error.where in ("Q", "R"):
                error.where = f"{options.weights}: {error.where}"
            raise
        return gains.at_knots() if self.in_c else gains
