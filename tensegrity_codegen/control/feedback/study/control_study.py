"""The record of a study of feedback: the results of its loops, its status and warnings."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, describe_cuts, find_displacement
from tensegrity_codegen.control.feedback.loop.sampled_plant import describe_unknown_delays
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.study.linear_loop import Margins
from tensegrity_codegen.control.feedback.study.stated_errors import (
    DrawnErrors,
    StatedErrors,
    find_needed_time,
)
from tensegrity_codegen.control.feedback.study.tuning import Tuning, find_angles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

ROUNDING = 1e-6  # of a limit, by which it may be exceeded
OPEN = "open"
LOOPS = (OPEN, "true_state", "estimator")
MIN_WORSE = 0.1  # of the tolerance, by which a closed loop may end further away than the open loop
LITTLE_GAIN = 0.5  # of the error of the open loop: with more left, feedback gains little
DOUBTFUL_PART = 0.2  # of the size of the structure: an error of the start above it may be in other units
LONG_STEP = 0.5  # of a sample, that a step of the controller may take on this machine
LOOP_NAMES = {OPEN: "open loop", "true_state": "true state", "estimator": "estimator"}


@dataclass(frozen=True)
class RunMeasures:
    """Measures of one run; those of the end are over the last part of the time."""

    status: str  # of the run
    end_error: float  # [m]: largest distance of a node from the motion at the end
    peak_error: float  # [m]: the same at all times
    end_angle: float  # [rad]: largest error of an angle at the end, nan without angles
    end_node: str  # the node of `end_error`
    least_tension: float  # [N]: of cables over all times
    least_member: str
    end_tension: float  # [N]: of cables at the end
    end_rms: Mapping[str, float]  # [m]: root mean square of the distance at the end, by name of the node
    # limits of the scene that are exceeded at the end, with the members
    broken: Mapping[str, tuple[str, ...]]
    steps: Mapping[str, int]  # number of commands of each status

    @property
    def is_unstable(self) -> bool:
        """Whether the simulation stopped."""
        return self.status not in ("ok", "does_not_hold", "not_solved")


def measure_run(model: CompiledModel, run: ControlRun, last: float) -> RunMeasures:
    """Return the measures of a run."""
    # Errors, and where the largest one is at the end.
    away = find_displacement(model, run)
    ending = run.time >= run.time[-1] - last - 1e-12
    angles = find_angles(model.manifest)
    tension = run.member_tension
    cables = find_cables(model)
    step, node = np.unravel_index(int(away[ending].argmax()), away[ending].shape)
    # Tensions of the cables.
    smallest, member, end = np.nan, "", np.nan
    if len(cables):
        smallest = float(tension[:, cables].min())
        member = run.member_name[int(cables[tension[:, cables].min(axis=0).argmin()])]
        end = float(tension[ending][:, cables].min())
    return RunMeasures(
        status=run.status,
        end_error=float(away[ending][step, node]),
        peak_error=float(away.max()),
        end_angle=float(np.abs(run.error[ending][:, angles]).max()) if angles.any() else np.nan,
        end_node=model.manifest.node_name[int(node)],
        least_tension=smallest,
        least_member=member,
        end_tension=end,
        end_rms=dict(
            zip(model.manifest.node_name, np.sqrt((away[ending] ** 2).mean(axis=0)).tolist(), strict=True)
        ),
        broken=_list_broken(model, run, ending),
        steps=dict(Counter(run.step_status)),
    )


def find_cables(model: CompiledModel) -> NDArray[np.int64]:
    """Return the indices of the members that carry tension only."""
    structure = model.structure
    is_cable = np.zeros(0) if structure is None else np.asarray(structure.tension_only)
    return np.flatnonzero(is_cable).astype(np.int64)


def _list_broken(model: CompiledModel, run: ControlRun, ending: BoolArray) -> dict[str, tuple[str, ...]]:
    """Return the limits of tensions and clearance that are exceeded at the end."""
    structure = model.structure
    if structure is None:
        return {}
    limits: Limits = structure.limits
    tension = run.member_tension[ending]
    tests = {
        "least_tension": tension.min(axis=0) < limits.least_tension - ROUNDING * np.abs(limits.least_tension),
        "most_tension": tension.max(axis=0) > limits.most_tension + ROUNDING * np.abs(limits.most_tension),
    }
    broken = {
        name: tuple(run.member_name[e] for e in np.flatnonzero(rows))
        for name, rows in tests.items()
        if rows.any()
    }
    if np.isfinite(limits.clearance) and model.has("bar_distance"):
        pairs = np.array([model.compute("bar_distance", coordinate=q) for q in run.coordinate[ending]])
        close_pairs = np.flatnonzero(pairs.min(axis=0) < limits.clearance)
        if len(close_pairs):
            broken["clearance"] = tuple(" and ".join(model.manifest.bar_pair[k]) for k in close_pairs)
    return broken


# One loop of a study over all draws.


@dataclass(frozen=True, eq=False)
class LoopResult:
    """One loop over all draws; those of the end are over the last part of the time."""

    name: str  # ``"open"``, ``"true_state"`` or ``"estimator"``
    # of each draw: status, errors, tensions, limits, statuses of the commands
    measures: tuple[RunMeasures, ...]
    run: ControlRun  # the run of the worst draw of the study

    @property
    def unstable(self) -> int:
        """Number of draws in which the simulation stopped."""
        return sum(row.is_unstable for row in self.measures)

    @property
    def not_solved(self) -> int:
        """Number of draws in which a tenth of the commands are not those of a solved program."""
        return sum(row.status == "not_solved" for row in self.measures)

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
    def end_rms(self) -> dict[str, float]:
        """Root mean square of the distance of each node from the motion at the end, over all draws [m]."""
        rows = [row.end_rms for row in self.measures]
        return {name: float(np.sqrt(np.mean([row[name] ** 2 for row in rows]))) for name in rows[0]}

    @property
    def steps(self) -> dict[str, int]:
        """Number of commands of each status, over all draws."""
        statuses = dict.fromkeys(("ok", *(status for row in self.measures for status in row.steps)))
        return {status: sum(row.steps.get(status, 0) for row in self.measures) for status in statuses}

    @property
    def broken(self) -> dict[str, tuple[str, ...]]:
        """Limits of the scene that are exceeded at the end of any draw, with members or pairs of bars."""
        broken: dict[str, tuple[str, ...]] = {}
        for row in self.measures:
            for name, who in row.broken.items():
                broken[name] = tuple(dict.fromkeys((*broken.get(name, ()), *who)))
        return broken


# The record of a study.


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
        Weights, and the values from which they were chosen.
    gains : Gains
        Feedback.
    mpc : Mpc or None
        Model-predictive control in place of the gains.
    estimator : Estimator or None
        None without sensors.
    distribution : TensionDistribution or None
        Distribution of tensions, of both loops with feedback.
    errors : StatedErrors
        The disturbances.
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
            *find_high_tensions(self.loops, self.limits),
            *self._doubt_unit(),
            *find_long_steps(self.loops, self.gains.sample, is_mpc=self.mpc is not None),
            *self._describe_slow_errors(),
        )

    def _doubt_unit(self) -> list[str]:
        """Return a sentence if the stated error of the start is a large part of the structure."""
        error, size = self.errors.start_error or 0.0, self.tuning.scales.size
        if error <= DOUBTFUL_PART * size:
            return []
        return [
            f"start_error is {error:g} m, and the structure is {size:.3g} m large: lengths without a unit "
            f"are in m, is it {error:g}mm?"
        ]

    def _describe_slow_errors(self) -> list[str]:
        """Return a sentence if errors are compared before the slowest one has decayed."""
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
        arrays = {f"motion_{name}": np.asarray(value) for name, value in self.motion.arrays().items()}
        arrays |= {
            f"gains_{name}": np.asarray(value)
            for name, value in vars(self.gains).items()
            if name not in ("S", "actuators")
        }
        arrays |= {"Q": self.tuning.Q, "R": self.tuning.R, "tolerance": np.array(self.tuning.tolerance)}
        arrays |= {"status": np.array(self.status), "message": np.array(self.message)}
        arrays |= {"worst_draw": np.array(self.worst_draw), "seed": np.array(self.seed)}
        arrays["draw_coordinate_error"] = np.array([errors.coordinate for errors in self.drawn])
        arrays["draw_stiffness"] = np.array([list(errors.stiffness.values()) for errors in self.drawn])
        if self.estimator is not None:
            for name in ("time", "L", "P", "E"):
                arrays[f"estimator_{name}"] = np.asarray(getattr(self.estimator, name))
            arrays["estimator_state_name"] = np.array(self.estimator.state_name)
        for name, loop in self.loops.items():
            if name in self.predicted:
                arrays[f"{name}_predicted_rms"] = np.array([*self.predicted[name].values()])
            arrays[f"{name}_end_rms"] = np.array([*loop.end_rms.values()])
            arrays |= {f"{name}_{key}": value for key, value in loop.run.arrays().items() if key != "message"}
            for key in ("end_error", "end_angle", "peak_error", "least_tension", "end_tension"):
                arrays[f"{name}_draws_{key}"] = getattr(loop, key)
            arrays[f"{name}_draws_status"] = np.array([row.status for row in loop.measures])
        return arrays


# The outcome of the loops of a study: status and warnings.


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
    bound = min(bound, 1e300) + MIN_WORSE * tolerance
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
    eigenvalues = [gains.E] if estimator is None else [gains.E, estimator.E]
    slowest = np.array([np.abs(values).max(initial=1e-300) for values in eigenvalues])
    with np.errstate(divide="ignore"):
        constants: list[float] = (gains.sample / np.abs(np.log(np.minimum(slowest, 1.0)))).tolist()
    return constants


def find_margin_warnings(
    margins: Mapping[str, Margins], bounds: ActuatorBounds, sample: float
) -> tuple[str, ...]:
    """Return a sentence for each linear loop that is unstable, or that one sample of more delay makes so.

    Or stiffnesses that are up to a tenth off: the sampled response of modes near half the sampling rate or
    above depends on them.
    """
    sentences = []
    for name, margin in margins.items():
        late = 1000 * float(bounds.delay.max(initial=0.0))
        if not margin.is_stable:
            sentences.append(
                f"{LOOP_NAMES[name]}: the linear loop at the end of the motion is unstable"
                + (f" with delays of up to {late:.3g} ms" if late else "")
                + ": weaker feedback (a smaller effort) tolerates more"
            )
        elif margin.delay < sample:
            sentences.append(
                f"{LOOP_NAMES[name]}: {1000 * margin.delay:.3g} ms more delay make the loop unstable, less "
                f"than one sample ({1000 * sample:.3g} ms), which computing and sending a command may take: "
                "state it as delay of the actuators, or choose weaker feedback (a smaller effort)"
            )
        if margin.is_stable and np.isfinite(margin.stiffness):
            sentences.append(
                f"{LOOP_NAMES[name]}: stiffnesses that are all {100 * margin.stiffness:.2g} % off make the "
                f"loop unstable: a shorter sample, of which half the rate (now {0.5 / sample:.3g} Hz) is "
                "above the natural frequencies, or weaker feedback (a smaller effort) tolerates more"
            )
    return tuple(sentences)


def find_low_tensions(loops: Mapping[str, LoopResult], limits: Limits) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose cables are slack or below a limit on the way."""
    stated = limits.least_tension[np.isfinite(limits.least_tension)]
    bound = float(stated.max(initial=0.0))
    sentences = []
    for name, loop in loops.items():
        values = loop.least_tension
        if name == OPEN or not np.isfinite(values).any() or "least_tension" in loop.broken:
            continue
        draw = int(np.nanargmin(values))
        low = float(values[draw])
        if low <= 0.0 or low < bound:
            sentences.append(
                f"{LOOP_NAMES[name]}: {loop.measures[draw].least_member} "
                + ("goes slack" if low <= 0.0 else f"falls to {low:.3g} N")
                + " on the way"
                + (f", below the least tension of {bound:g} N" if low < bound else "")
            )
    return tuple(sentences)


def find_high_tensions(loops: Mapping[str, LoopResult], limits: Limits) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose tensions exceed a limit on the way, worst draw."""
    sentences = []
    for name, loop in loops.items():
        if name == OPEN or not np.isfinite(limits.most_tension).any() or "most_tension" in loop.broken:
            continue
        tension = loop.run.member_tension
        excess = tension - (limits.most_tension + ROUNDING * np.abs(limits.most_tension))
        row, worst = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[row, worst] > 0.0:
            n_others = int((excess.max(axis=0) > 0.0).sum()) - 1
            sentences.append(
                f"{LOOP_NAMES[name]}: {loop.run.member_name[worst]} has {tension[row, worst]:.4g} N at "
                f"{loop.run.time[row]:.3g} s, above the largest tension of {limits.most_tension[worst]:g} N"
                + (f"; {n_others} other member{'s' * (n_others > 1)} too" if n_others else "")
            )
    return tuple(sentences)


def find_long_steps(loops: Mapping[str, LoopResult], sample: float, *, is_mpc: bool) -> tuple[str, ...]:
    """Return a sentence if a step of the controller in C takes more than half of a sample on this machine."""
    # The loop without feedback costs what the model costs.
    cost = [loop.run.sample_cost - loops[OPEN].run.sample_cost for loop in loops.values()]
    longest = float(np.max(cost))
    if not longest > LONG_STEP * sample:  # nan in Python
        return ()
    remedy = (
        "a longer sample, a shorter horizon, fewer blocks or softer bars make"
        if is_mpc
        else "a longer sample makes"
    )
    return (
        f"a step of the controller takes about {1000 * longest:.3g} ms on this machine, and a sample is "
        f"{1000 * sample:.3g} ms: it {'cannot run' if longest > sample else 'hardly runs'} in time; {remedy} "
        "that possible",
    )


def find_warnings(loops: Mapping[str, LoopResult], tolerance: float) -> tuple[str, ...]:
    """Return a sentence for each loop with feedback whose commands are often cut, or that gains little."""
    texts = []
    without = float(loops[OPEN].end_error.max())
    for name, loop in loops.items():
        if name == OPEN or loop.unstable:
            continue
        texts += [f"{LOOP_NAMES[name]}: {cut}" for cut in describe_cuts(loop.steps)]
        if loop.run.slip is not None and loop.run.warnings:
            texts.append(f"{LOOP_NAMES[name]}, worst draw: {loop.run.warnings[-1]}")
        error = float(loop.end_error.max())
        if not loops[OPEN].unstable and error > LITTLE_GAIN * without and error > MIN_WORSE * tolerance:
            kind = "makes the error larger" if error > without else "gains little"
            texts.append(
                f"{LOOP_NAMES[name]}: feedback {kind}, {1000 * error:.3g} mm at the end, "
                f"{1000 * without:.3g} mm without feedback: look at weights, actuators and sensors"
            )
    return tuple(texts)
