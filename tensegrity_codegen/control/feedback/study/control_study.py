"""The record of a study of feedback: what its loops show, its status and warnings."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.control_run import describe_cuts
from tensegrity_codegen.control.feedback.loop.loop_parts import describe_unknown_delays
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.study.loop_result import OPEN, LoopResult
from tensegrity_codegen.control.feedback.study.margins import Margins
from tensegrity_codegen.control.feedback.study.stated_errors import (
    DrawnErrors,
    StatedErrors,
    find_needed_time,
)
from tensegrity_codegen.control.feedback.study.tuning import Tuning
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.limits import Limits

LEAST_WORSE = 0.1  # of the tolerance, by which a closed loop may end further away than the open loop
LITTLE_GAIN = 0.5  # of the error of the open loop: with more left, feedback gains little
LOOP_NAMES = {OPEN: "open loop", "true_state": "true state", "estimator": "estimator"}


@dataclass(frozen=True, eq=False)
class ControlStudy:
    """A motion under disturbances, with and without feedback.

    Attributes
    ----------
    status : str
        ``"holds"``; ``"does_not_hold"``: at the end, a loop with feedback is further from the motion than the
        open loop by more than a tenth of the tolerance of the weights; ``"not_solved"``: in a loop with
        feedback a tenth of the commands of a draw are not those of a solved program; ``"unstable"``: the
        simulation of a loop with feedback stopped.
    message : str
        A sentence.
    motion : Motion
        The motion.
    tuning : Tuning
        Weights, and what they were chosen from.
    gains : Gains
        Feedback.
    mpc : Mpc or None
        Model-predictive control in place of the gains.
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
    predicted : mapping of str to mapping of str to float [m]
        Of each loop with feedback: root mean square of the distance of each node from its place that noise of
        the sensors causes in the linear loop, by the name of the node; beside `LoopResult.end_rms`.
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
    mpc: Mpc | None
    estimator: Estimator | None
    distribution: TensionDistribution | None
    errors: StatedErrors
    bounds: ActuatorBounds
    drawn: tuple[DrawnErrors, ...]
    loops: Mapping[str, LoopResult]
    margins: Mapping[str, Margins]
    predicted: Mapping[str, Mapping[str, float]]
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
            if name in self.predicted:
                found[f"{name}_predicted_rms"] = np.array([*self.predicted[name].values()])
            found[f"{name}_end_rms"] = np.array([*loop.end_rms.values()])
            found |= {f"{name}_{key}": value for key, value in loop.run.arrays().items() if key != "message"}
            for key in ("end_error", "end_angle", "peak_error", "least_tension", "end_tension"):
                found[f"{name}_draws_{key}"] = getattr(loop, key)
            found[f"{name}_draws_status"] = np.array([row.status for row in loop.measures])
        return found


# What the loops of a study show: status and warnings.


def judge_study(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, str]:
    """Return the status of a study, and a sentence with the errors of all loops."""
    ends = {name: float(loop.end_error.max()) for name, loop in loops.items()}
    texts = [
        f"{LOOP_NAMES[name]} {1000 * ends[name]:.3g} mm"
        + (f" ({loop.unstable} unstable)" if loop.unstable else "")
        + (f" ({loop.not_solved} not solved)" if loop.not_solved else "")
        for name, loop in loops.items()
    ]
    message = f"largest errors at the end: {', '.join(texts)}"
    closed = [name for name in loops if name != OPEN]
    worse = count_worse(loops, closed[-1])
    if worse:
        count = len(loops[OPEN].measures)
        message += f"; {LOOP_NAMES[closed[-1]]} worse than open loop in {worse} of {count} draws"
    if any(loops[name].unstable for name in closed):
        return "unstable", message
    if any(loops[name].not_solved for name in closed):
        return "not_solved", message
    bound = np.inf if loops[OPEN].unstable else ends[OPEN]
    bound = min(bound, 1e300) + LEAST_WORSE * tolerance
    return ("holds" if all(ends[name] <= bound for name in closed) else "does_not_hold"), message


def count_worse(loops: Mapping[str, LoopResult], name: str) -> int:
    """Return the number of draws in which a loop ends further from the motion than the open loop."""
    pairs = zip(loops[name].measures, loops[OPEN].measures, strict=True)
    return sum(
        not before.is_unstable and (row.is_unstable or row.end_error > before.end_error)
        for row, before in pairs
    )


def find_time_constants(gains: Gains, estimator: Estimator | None) -> list[float]:
    """Return the times in which the slowest errors of gains and estimator fall to 1/e [s], or infinity."""
    parts = [gains.E] if estimator is None else [gains.E, estimator.E]
    slowest = np.array([np.abs(values).max(initial=1e-300) for values in parts])
    with np.errstate(divide="ignore"):
        found: list[float] = (gains.sample / np.abs(np.log(np.minimum(slowest, 1.0)))).tolist()
    return found


def find_margin_warnings(
    margins: Mapping[str, Margins], bounds: ActuatorBounds, sample: float
) -> tuple[str, ...]:
    """Return a sentence for each linear loop that is unstable, or that one sample of more delay makes so."""
    found = []
    for name, margin in margins.items():
        late = 1000 * float(bounds.delay.max(initial=0.0))
        if not margin.is_stable:
            found.append(
                f"{LOOP_NAMES[name]}: the linear loop at the end of the motion is unstable"
                + (f" with delays of up to {late:.3g} ms" if late else "")
                + ": weaker feedback (a smaller effort) tolerates more"
            )
        elif margin.delay < sample:
            found.append(
                f"{LOOP_NAMES[name]}: {1000 * margin.delay:.3g} ms more delay make the loop unstable, less "
                f"than one sample ({1000 * sample:.3g} ms), which computing and sending a command may take: "
                "state it as delay of the actuators, or choose weaker feedback (a smaller effort)"
            )
    return tuple(found)


def find_low_tensions(loops: Mapping[str, LoopResult], limits: Limits) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose cables are slack or below a limit on the way."""
    stated = limits.least_tension[np.isfinite(limits.least_tension)]
    bound = float(stated.max(initial=0.0))
    found = []
    for name, loop in loops.items():
        values = loop.least_tension
        if name == OPEN or not np.isfinite(values).any() or "least_tension" in loop.broken:
            continue
        draw = int(np.nanargmin(values))
        low = float(values[draw])
        if low <= 0.0 or low < bound:
            found.append(
                f"{LOOP_NAMES[name]}: {loop.measures[draw].least_member} "
                + ("goes slack" if low <= 0.0 else f"falls to {low:.3g} N")
                + " on the way"
                + (f", below the least tension of {bound:g} N" if low < bound else "")
            )
    return tuple(found)


def find_warnings(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose commands are often cut, or that gains little.

    loops: all loops.
    tolerance [m]: displacement that the weights accept; smaller errors than a tenth of it are no reason to
        warn.
    """
    found = []
    without = float(loops[OPEN].end_error.max())
    for name, loop in loops.items():
        if name == OPEN or loop.unstable:
            continue
        found += [f"{LOOP_NAMES[name]}: {text}" for text in describe_cuts(loop.steps)]
        if loop.run.slip is not None and loop.run.warnings:
            found.append(f"{LOOP_NAMES[name]}, worst draw: {loop.run.warnings[-1]}")
        left = float(loop.end_error.max())
        if not loops[OPEN].unstable and left > LITTLE_GAIN * without and left > LEAST_WORSE * tolerance:
            kind = "makes the error larger" if left > without else "gains little"
            found.append(
                f"{LOOP_NAMES[name]}: feedback {kind}, {1000 * left:.3g} mm at the end, {1000 * without:.3g} "
                "mm without feedback: look at weights, actuators and sensors"
            )
    return tuple(found)
