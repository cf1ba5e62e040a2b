"""The controller that the options of `control` state: weights, gains, estimator, distribution."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.control_options import read_least_tension
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from tensegrity_codegen.control.feedback.design.estimator import Estimator
    from tensegrity_codegen.control.feedback.design.gains import Gains
    from tensegrity_codegen.control.feedback.study.tuning import Tuning
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.timed_motion import Motion


@dataclass(frozen=True)
class ControlDesign:
    """What the options state of the controller."""

    model: "CompiledModel"
    motion: "Motion"
    sample: float
    tolerance: float | None
    effort: float | None
    response_time: float | None
    integral_action: Sequence[str] | None
    weights: Path | None
    estimator: bool
    disturbance: float | None
    only_observable: bool
    least_tension: str | None
    arguments: Mapping[str, Any]
    in_c: bool = False
    warn: Callable[[str], None] | None = None

    @property
    def lacks_sensors(self) -> bool:
        """Whether an estimator has nothing to measure."""
        structure = self.model.structure
        return self.estimator and (structure is None or not structure.sensors)

    def build(self) -> dict[str, Any]:
        """Return tuning, gains, estimator and distribution, as `study_control` takes them."""
        from tensegrity_codegen.control.feedback.loop.tension_distribution import design_distribution
        from tensegrity_codegen.control.feedback.study.read_files import read_weights
        from tensegrity_codegen.control.feedback.study.tuning import choose_weights

        model, motion, given = self.model, self.motion, self.arguments
        wanted = self.integral_action
        names = None if wanted is None else [name for name in wanted if name != "none"]
        tuning = choose_weights(
            model, motion, sample=self.sample, tolerance=self.tolerance, effort=self.effort,
            response_time=self.response_time, integral_action=names, arguments=given,
        )  # fmt: skip
        if self.weights is not None:
            q, r = read_weights(self.weights)
            tuning = replace(tuning, Q=q, R=r)
        gains = self._design_gains(tuning)
        senses = spread = None
        if self.estimator and not self.lacks_sensors:
            senses = self._design_estimator(tuning, gains)
        if self.least_tension is not None:
            least = read_least_tension(self.least_tension)
            spread = design_distribution(model, motion, least_tension=least, arguments=given)
        return {"tuning": tuning, "gains": gains, "estimator": senses, "distribution": spread}

    def _design_estimator(self, tuning: "Tuning", gains: "Gains") -> "Estimator":
        """Return the estimator; disturbances that are not stated are as large as noise permits."""
        from tensegrity_codegen.control.feedback.kalman import design_kalman
        from tensegrity_codegen.control.feedback.study.linear_loop import design_slow_estimator

        if self.disturbance is not None:
            return design_kalman(
                self.model, self.motion, sample=self.sample, disturbance=self.disturbance,
                only_observable=self.only_observable, arguments=self.arguments,
            )  # fmt: skip
        estimator, warning = design_slow_estimator(
            self.model, self.motion, gains, tuning.scales, only_observable=self.only_observable,
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
                self.model, self.motion, tuning.Q, tuning.R, sample=self.sample,
                integral_action=tuning.integral_action, arguments=self.arguments,
            )  # fmt: skip
        except InvalidValueError as error:
            if self.weights is not None and error.where in ("Q", "R"):
                error.where = f"{self.weights}: {error.where}"
            raise
        return gains.at_knots() if self.in_c else gains  # as a controller in C stores them
