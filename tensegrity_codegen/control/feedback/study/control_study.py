"""The record of a study of feedback."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.loop_parts import describe_unknown_delays
from tensegrity_codegen.control.feedback.study.linear_loop import Margins
from tensegrity_codegen.control.feedback.study.loop_result import LoopResult
from tensegrity_codegen.control.feedback.study.stated_errors import DrawnErrors, StatedErrors
from tensegrity_codegen.control.feedback.study.study_times import find_needed_time
from tensegrity_codegen.control.feedback.study.study_warnings import (
    find_low_tensions,
    find_margin_warnings,
    find_time_constants,
    find_warnings,
)
from tensegrity_codegen.control.feedback.study.tuning import Tuning
from tensegrity_codegen.control.feedback.tension_distribution import TensionDistribution
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.limits import Limits


@dataclass(frozen=True, eq=False)
class ControlStudy:
    """A motion under disturbances, with and without feedback.

    Attributes
    ----------
    status : str
        ``"holds"``; ``"does_not_hold"``: at the end, a loop with feedback is further from the motion than the
        open loop by more than a tenth of the tolerance of the weights; ``"unstable"``: the simulation of a
        loop with feedback stopped.
    message : str
        A sentence.
    motion : Motion
        The motion.
    tuning : Tuning
        Weights, and what they were chosen from.
    gains : Gains
        Feedback.
    estimator : Estimator or None
        None without sensors.
    distribution : TensionDistribution or None
        Distribution of tensions, of both loops with feedback.
    errors : StatedErrors
        What disturbs.
    bounds : ActuatorBounds
        Rates, ranges and delays of the actuators.
    drawn : tuple of DrawnErrors
        The errors of each draw.
    loops : mapping of str to LoopResult
        ``"open"``, ``"true_state"`` and with an estimator ``"estimator"``.
    margins : mapping of str to Margins
        Of each loop with feedback: how much more delay and effect of the actuators its linear model at the
        end of the motion stands.
    limits : Limits
        Limits of the scene.
    notes : tuple of str
        Warnings of the design.
    worst_draw : int
        Draw with the largest error at the end, of the last loop; its runs are in `loops`.
    t_end, last : float [s]
        Simulated time; time before its end that counts as the end.
    seed : int
        Of the draws.
    """

    status: str
    message: str
    motion: Motion
    tuning: Tuning
    gains: Gains
    estimator: Estimator | None
    distribution: TensionDistribution | None
    errors: StatedErrors
    bounds: ActuatorBounds
    drawn: tuple[DrawnErrors, ...]
    loops: Mapping[str, LoopResult]
    margins: Mapping[str, Margins]
    limits: Limits
    notes: tuple[str, ...]
    worst_draw: int
    t_end: float
    last: float
    seed: int

    @property
    def holds(self) -> bool:
        """Whether feedback holds the motion."""
        return self.status == "holds"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of motion and design, of loops that are cut often or gain little, of margins and slack."""
        late = describe_unknown_delays(self.gains, self.bounds)
        return (
            *self.motion.warnings,
            *self.notes,
            *([late] if late else []),
            *find_warnings(self.loops, self.tuning.tolerance),
            *find_margin_warnings(self.margins, self.bounds, self.gains.sample),
            *find_low_tensions(self.loops, self.limits),
            *self._find_slow_errors(),
        )

    def _find_slow_errors(self) -> list[str]:
        """Return a sentence where errors are compared before the slowest one has decayed."""
        slowest = max(find_time_constants(self.gains, self.estimator))
        needed = find_needed_time(self.motion, slowest)
        if not self.t_end < 0.99 * needed < np.inf:
            return []
        return [
            f"the slowest error falls to 1/e in {slowest:.3g} s, and errors are compared from "
            f"{self.t_end - self.last:.3g} s on: a simulated time of {needed:.3g} s (`t_end`) covers it"
        ]

    @property
    def time_constant(self) -> float:
        """Time in which the slowest error of the closed loop falls to 1/e at the end of the motion [s]."""
        return find_time_constants(self.gains, None)[0]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, for an ``.npz`` file; docs/control.md lists them."""
        found = {f"motion_{name}": np.asarray(value) for name, value in self.motion.arrays().items()}
        found |= {
            f"gains_{name}": np.asarray(value)
            for name, value in vars(self.gains).items()
            if name not in ("S", "actuators")
        }
        found |= {"Q": self.tuning.Q, "R": self.tuning.R, "tolerance": np.array(self.tuning.tolerance)}
        found |= {"status": np.array(self.status), "message": np.array(self.message)}
        found |= {"worst_draw": np.array(self.worst_draw), "seed": np.array(self.seed)}
        found["draw_coordinate_error"] = np.array([item.coordinate for item in self.drawn])
        found["draw_stiffness"] = np.array([list(item.stiffness.values()) for item in self.drawn])
        if self.estimator is not None:
            for name in ("time", "L", "P", "E"):
                found[f"estimator_{name}"] = np.asarray(getattr(self.estimator, name))
            found["estimator_state_name"] = np.array(self.estimator.state_name)
        for name, loop in self.loops.items():
            found |= {f"{name}_{key}": value for key, value in loop.run.arrays().items() if key != "message"}
            for key in ("end_error", "end_angle", "peak_error", "least_tension", "end_tension"):
                found[f"{name}_draws_{key}"] = getattr(loop, key)
            found[f"{name}_draws_status"] = np.array([row.status for row in loop.measures])
        return found
