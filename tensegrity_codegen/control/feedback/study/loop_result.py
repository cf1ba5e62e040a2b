"""Results of loops: errors, tensions, limits and statuses of one run, and of all draws of a study."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, find_displacement
from tensegrity_codegen.control.feedback.study.tuning import find_angles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

ROUNDING = 1e-6  # of a limit, by which it may be exceeded
OPEN = "open"
LOOPS = (OPEN, "true_state", "estimator")


@dataclass(frozen=True)
class RunMeasures:
    """Measures of one run; those of the end are over the last part of the time.

    status: of the run; end_error, peak_error [m]: largest distance of a node from the motion, at the end and
    at all; end_angle [rad]: largest error of an angle at the end, nan without angles; end_node: the node;
    least_tension [N], least_member: of cables over all times; end_tension [N]: at the end;
    end_rms [m]: root mean square of the distance of each node from the motion at the end, by its name;
    broken: limits of the scene that are exceeded at the end, with the members; steps: number of commands of
    each status.
    """

    status: str
    end_error: float
    peak_error: float
    end_angle: float
    end_node: str
    least_tension: float
    least_member: str
    end_tension: float
    end_rms: Mapping[str, float]
    broken: Mapping[str, tuple[str, ...]]
    steps: Mapping[str, int]

    @property
    def is_unstable(self) -> bool:
        """Whether the simulation stopped."""
        return self.status not in ("ok", "does_not_hold", "not_solved")


def measure_run(model: CompiledModel, run: ControlRun, last: float) -> RunMeasures:
    """Return the measures of a run.

    run: the run; where it stopped, its end is that time.
    last [s]: time before the end that counts as the end.
    """
    # Errors, and where the largest one is at the end.
    away = find_displacement(model, run)
    ending = run.time >= run.time[-1] - last - 1e-12
    angles = find_angles(model.manifest)
    tension = run.member_tension
    cables = find_cables(model)
    step, node = np.unravel_index(int(away[ending].argmax()), away[ending].shape)
    # Tensions of the cables.
    least, member, end = np.nan, "", np.nan
    if len(cables):
        least = float(tension[:, cables].min())
        member = run.member_name[int(cables[tension[:, cables].min(axis=0).argmin()])]
        end = float(tension[ending][:, cables].min())
    return RunMeasures(
        status=run.status,
        end_error=float(away[ending][step, node]),
        peak_error=float(away.max()),
        end_angle=float(np.abs(run.error[ending][:, angles]).max()) if angles.any() else np.nan,
        end_node=model.manifest.node_name[int(node)],
        least_tension=least,
        least_member=member,
        end_tension=end,
        end_rms=dict(
            zip(model.manifest.node_name, np.sqrt((away[ending] ** 2).mean(axis=0)).tolist(), strict=True)
        ),
        broken=_find_broken(model, run, ending),
        steps=dict(Counter(run.step_status)),
    )


def find_cables(model: CompiledModel) -> NDArray[np.int64]:
    """Return the indices of the members that carry tension only."""
    structure = model.structure
    found = np.zeros(0) if structure is None else np.asarray(structure.tension_only)
    return np.flatnonzero(found).astype(np.int64)


def _find_broken(model: CompiledModel, run: ControlRun, ending: BoolArray) -> dict[str, tuple[str, ...]]:
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
    found = {
        name: tuple(run.member_name[e] for e in np.flatnonzero(rows))
        for name, rows in tests.items()
        if rows.any()
    }
    if np.isfinite(limits.clearance) and model.has("bar_distance"):
        pairs = np.array([model.compute("bar_distance", coordinate=q) for q in run.coordinate[ending]])
        near = np.flatnonzero(pairs.min(axis=0) < limits.clearance)
        if len(near):
            found["clearance"] = tuple(" and ".join(model.manifest.bar_pair[k]) for k in near)
    return found


# One loop of a study over all draws.


@dataclass(frozen=True, eq=False)
class LoopResult:
    """One loop over all draws; those of the end are over the last part of the time.

    name: ``"open"``, ``"true_state"`` or ``"estimator"``.
    measures: of each draw: status, errors, tensions, limits, statuses of the commands.
    run: the run of the worst draw of the study.
    """

    name: str
    measures: tuple[RunMeasures, ...]
    run: ControlRun

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
