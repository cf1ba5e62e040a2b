"""The record of a study of feedback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.control.design.estimator import Estimator
from tensegrity_codegen.runtime.control.design.gains import Gains
from tensegrity_codegen.runtime.control.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.runtime.control.loop.control_run import ControlRun
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.control.study.run_measures import RunMeasures
from tensegrity_codegen.runtime.control.study.stated_errors import DrawnErrors, StatedErrors
from tensegrity_codegen.runtime.control.study.tuning import Tuning
from tensegrity_codegen.runtime.control.tension_distribution import TensionDistribution

__all__ = ["LOOPS", "OPEN", "ControlStudy", "LoopResult", "find_warnings", "judge_study"]

FloatArray = NDArray[np.float64]

OPEN = "open"
LOOPS = (OPEN, "true_state", "estimator")
WORSE = 0.1  # of the tolerance, by which a closed loop may end further away than the open loop
LITTLE = 0.5  # of the error of the open loop: with more left, feedback gains little
OFTEN = 0.1  # of the commands of a loop: more are cut often
CUT = ("rate_limited", "range_limited")
WORDS = {OPEN: "open loop", "true_state": "true state", "estimator": "estimator"}


@dataclass(frozen=True, eq=False)
class LoopResult:
    """One loop over all draws; those of the end are over the last part of the time.

    Attributes
    ----------
    name : str
        ``"open"``, ``"true_state"`` or ``"estimator"``.
    measures : tuple of RunMeasures
        Of each draw: status, errors, tensions, limits, statuses of the commands.
    run : ControlRun
        The run of the worst draw of the study.
    """

    name: str
    measures: tuple[RunMeasures, ...]
    run: ControlRun

    @classmethod
    def collect(cls, name: str, rows: Sequence[RunMeasures], run: ControlRun) -> LoopResult:
        """Return the result of a loop."""
        return cls(name, tuple(rows), run)

    @property
    def unstable(self) -> int:
        """Number of draws in which the simulation stopped."""
        return sum(row.status != "ok" for row in self.measures)

    @property
    def end_error(self) -> FloatArray:
        """Largest distance of a node from the motion at the end of each draw, (n_draws,) [m]."""
        return np.array([row.end_error for row in self.measures])

    @property
    def end_angle(self) -> FloatArray:
        """Largest error of an angle at the end of each draw, (n_draws,) [rad]; nan without angles."""
        return np.array([row.end_angle for row in self.measures])

    @property
    def peak_error(self) -> FloatArray:
        """Largest distance of a node from the motion in each draw, (n_draws,) [m]."""
        return np.array([row.peak_error for row in self.measures])

    @property
    def least_tension(self) -> FloatArray:
        """Least tension of the cables in each draw, (n_draws,) [N]."""
        return np.array([row.least_tension for row in self.measures])

    @property
    def end_tension(self) -> FloatArray:
        """Least tension of the cables at the end of each draw, (n_draws,) [N]."""
        return np.array([row.end_tension for row in self.measures])

    @property
    def steps(self) -> dict[str, int]:
        """Number of commands of each status, over all draws."""
        words = dict.fromkeys(("ok", *(word for row in self.measures for word in row.steps)))
        return {word: sum(row.steps.get(word, 0) for row in self.measures) for word in words}

    @property
    def broken(self) -> dict[str, tuple[str, ...]]:
        """Limits of the scene that are exceeded at the end of any draw, with members or pairs of bars."""
        found: dict[str, tuple[str, ...]] = {}
        for row in self.measures:
            for name, who in row.broken.items():
                found[name] = tuple(dict.fromkeys((*found.get(name, ()), *who)))
        return found


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
        """Warnings of the motion, of loops whose commands are often cut or that gain little, of delays."""
        found = [*self.motion.warnings, *find_warnings(self.loops, self.tuning.tolerance)]
        delay = float(self.bounds.delay.max(initial=0.0))
        if not self.holds and delay > 0.0:
            found.append(
                f"actuators answer up to {1000 * delay:.3g} ms late ({delay / self.gains.sample:.3g} "
                "samples), which the gains do not know: weaker feedback (a smaller effort) tolerates more"
            )
        return tuple(found)

    @property
    def time_constant(self) -> float:
        """Time in which the slowest error of the closed loop falls to 1/e at the end of the motion [s]."""
        slowest = float(np.abs(self.gains.E).max(initial=0.0))
        if not 0.0 < slowest < 1.0:
            return 0.0 if slowest == 0.0 else float("inf")
        return -self.gains.sample / float(np.log(slowest))

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


def judge_study(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, str]:
    """Return the status of a study, and a sentence with the errors of all loops."""
    ends = {name: float(loop.end_error.max()) for name, loop in loops.items()}
    texts = [
        f"{WORDS[name]} {1000 * ends[name]:.3g} mm"
        + (f" ({loop.unstable} unstable)" if loop.unstable else "")
        for name, loop in loops.items()
    ]
    message = f"largest errors at the end: {', '.join(texts)}"
    closed = [name for name in loops if name != OPEN]
    if any(loops[name].unstable for name in closed):
        return "unstable", message
    bound = np.inf if loops[OPEN].unstable else ends[OPEN]
    bound = min(bound, 1e300) + WORSE * tolerance
    return ("holds" if all(ends[name] <= bound for name in closed) else "does_not_hold"), message


def find_warnings(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose commands are often cut, or that gains little.

    Parameters
    ----------
    loops : mapping of str to LoopResult
        All loops.
    tolerance : float [m]
        Displacement that the weights accept; smaller errors than a tenth of it are no reason to warn.

    Returns
    -------
    tuple of str
        Sentences.
    """
    found = []
    without = float(loops[OPEN].end_error.max())
    for name, loop in loops.items():
        if name == OPEN or loop.unstable:
            continue
        count = sum(loop.steps.values())
        cut = sum(loop.steps.get(word, 0) for word in CUT) / max(count, 1)
        if cut > OFTEN:
            found.append(
                f"{WORDS[name]}: {100 * cut:.0f} % of the commands were cut to the rate or range of an "
                "actuator, and integrals of errors stand still then: weaker feedback (a smaller effort), a "
                "slower motion or faster actuators avoid that"
            )
        left = float(loop.end_error.max())
        if not loops[OPEN].unstable and left > LITTLE * without and left > WORSE * tolerance:
            kind = "makes the error larger" if left > without else "gains little"
            found.append(
                f"{WORDS[name]}: feedback {kind}, {1000 * left:.3g} mm at the end, {1000 * without:.3g} mm "
                "without feedback: look at weights, actuators and sensors"
            )
    return tuple(found)
