"""Newton's method in trust regions for many cases at once: the search of newton.py, step by step.

Every case takes the steps that it takes alone, with its own radius. What is rare is left to the search for
one case: leaving a saddle, a stiffness that is not finite, and where no step helps.
"""

import numpy as np

from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points
from tensegrity_codegen.runtime.statics.batch.trust_region import Steps, find_steps
from tensegrity_codegen.runtime.statics.newton import (
    ENERGY_DIGITS,
    MAX_MOTION_RATIO,
    MAX_STALLED_ITERATIONS,
    MIN_STEP_RATIO,
)
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray

MOST_RESTORATIONS = 5
MAX_RESIDUAL_GROWTH = 3.0  # a trial whose residual grows more than that has strained stiff members
MOVING, LEFT = "", "left"


class BatchSearch:
    """The moving state of the searches of some cases.

    status: of each case "" while it moves; "converged", "rounding_limited", "unbounded" where it has ended at
    `best`; "left" where the search for one case has to begin anew.
    """

    def __init__(self, problem: BatchProblem, cases: IntArray, start: Points) -> None:
        self.problem, self.cases, self.start = problem, cases, start
        everyone = np.arange(len(cases))
        self.point, self.best = start.take(everyone.copy()), start.take(everyone.copy())
        position = problem.place(start.coordinate, cases)
        self.extent = np.maximum(np.ptp(position, axis=1).max(axis=1), start.longest)
        self.radius = 0.1 * start.longest * np.sqrt(max(problem.size, 1))
        self.waited = np.zeros(len(cases), dtype=np.int64)
        self.iterations = np.zeros(len(cases), dtype=np.int64)
        self.status = np.full(len(cases), MOVING, dtype="<U20")

    def run(self, tolerance: float, max_iterations: int) -> None:
        """Search until every case has ended, or was left."""
        for iteration in range(max_iterations):
            rows = np.flatnonzero(self.status == MOVING)
            if not len(rows):
                return
            self.iterations[rows] = iteration
            self._advance(rows, tolerance)
        self.status[self.status == MOVING] = LEFT

    def _advance(self, rows: IntArray, tolerance: float) -> None:
        """Make one iteration of the cases in rows."""
        point = self.point.take(rows)
        stiffness, is_finite = self.problem.find_stiffness(point.coordinate, self.cases[rows])
        self.status[rows[~is_finite]] = LEFT
        floor = np.full(len(rows), np.inf)
        floor[is_finite] = self.problem.rounding_floor(
            stiffness[is_finite], point.take(is_finite), self.cases[rows[is_finite]]
        )
        self._note_best(rows[is_finite], floor[is_finite])
        is_balanced = is_finite & point.is_balanced(tolerance, floor)
        self.best.put(rows[is_balanced], point.take(is_balanced))
        self.status[rows[is_balanced]] = "converged"
        self.status[rows[is_finite & ~is_balanced & (self.waited[rows] >= MAX_STALLED_ITERATIONS)]] = (
            "rounding_limited"
        )
        moving = np.flatnonzero(self.status[rows] == MOVING)
        if len(moving):
            moved = self._move(rows[moving], point.take(moving), stiffness[moving], floor[moving])
            self._look_around(rows[moving], moved, floor[moving])

    def _note_best(self, rows: IntArray, floor: FloatArray) -> None:
        """Follow the points; below the rounding floor keep the best and count the wait for a better one."""
        force, best = self.point.node_force[rows], self.best.node_force[rows]
        falls = (force > floor) | (force < 0.5 * best)
        self.waited[rows] = np.where(falls, 0, self.waited[rows] + 1)
        better = rows[(force > floor) | (force < best)]
        self.best.put(better, self.point.take(better))

    def _look_around(self, rows: IntArray, moved: BoolArray, floor: FloatArray) -> None:
        """End the searches in which no further step makes sense."""
        way = np.abs(self.point.coordinate[rows] - self.start.coordinate[rows]).max(axis=1, initial=0.0)
        is_far = way > MAX_MOTION_RATIO * self.extent[rows]
        self.status[rows[is_far]] = "unbounded"
        is_stuck = ~is_far & ~moved & (self.radius[rows] <= MIN_STEP_RATIO * self.extent[rows])
        is_quiet = self.point.node_force[rows] <= floor
        self.status[rows[is_stuck & is_quiet]] = "rounding_limited"
        self.status[rows[is_stuck & ~is_quiet]] = LEFT

    def _move(self, rows: IntArray, point: Points, stiffness: FloatArray, floor: FloatArray) -> BoolArray:
        """Try one step of each case, adapt the radii; return which cases moved."""
        step = find_steps(stiffness, -point.residual, self.radius[rows], floor)
        length = step.length
        is_step = (step.predicted > 0.0) & (length > 0.0)
        none = rows[~is_step]
        self.radius[none] *= 0.1
        self.waited[none] += 1
        trial, saved = self._restore(rows, point, step, floor, is_step)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(is_step, saved / step.predicted, np.nan)
        radius = self.radius[rows]
        shorter, longer = ratio < 0.25, (ratio > 0.6) & step.at_boundary
        radius = np.where(shorter, 0.3 * np.minimum(length, radius), radius)
        self.radius[rows] = np.where(longer & ~shorter, 2.5 * radius, radius)
        small = step.predicted <= ENERGY_DIGITS * point.energy_scale
        quieter = small & (trial.node_force < 0.9 * point.node_force)
        is_taken = is_step & np.isfinite(saved) & ((ratio >= 1e-4) | quieter)
        self.point.put(rows[is_taken], trial.take(is_taken))
        return is_taken

    def _restore(
        self, rows: IntArray, point: Points, step: Steps, floor: FloatArray, is_step: BoolArray
    ) -> tuple[Points, FloatArray]:
        """Return the best points of steps and their restorations, and the energies saved there [J].

        Minus infinity is saved where there is no such point. See `_Search._restore` of newton.py.
        """
        by_force = step.predicted <= ENERGY_DIGITS * point.energy_scale
        best, most = point.take(np.arange(len(rows))), np.full(len(rows), -np.inf)
        radius = self._sagitta(rows, step.length)
        on = np.flatnonzero(is_step)  # cases that still try
        trial = self.problem.find_points(point.coordinate[on] + step.vector[on], self.cases[rows[on]])
        for restoration in range(1 + MOST_RESTORATIONS):
            on, trial = on[trial.is_finite], trial.take(trial.is_finite)
            if not len(on):
                break
            saved = _find_saving(point.take(on), trial, by_force[on])
            better = saved > most[on]
            best.put(on[better], trial.take(better))
            most[on[better]] = saved[better]
            quiet = trial.node_force <= MAX_RESIDUAL_GROWTH * point.node_force[on] + floor[on]
            goes_on = ~(by_force[on] | quiet | (radius[on] <= MIN_STEP_RATIO * self.extent[rows[on]]))
            if restoration == MOST_RESTORATIONS or not goes_on.any():
                break
            on, trial, relaxing = self._relax(rows, on[goes_on], trial.take(goes_on), radius, floor)
            radius[on] = np.minimum(0.5 * radius[on], self._sagitta(rows[on], relaxing))
        return best, most

    def _relax(
        self, rows: IntArray, on: IntArray, trial: Points, radius: FloatArray, floor: FloatArray
    ) -> tuple[IntArray, Points, FloatArray]:
        """Return cases, points a short step on from their trials, and the lengths of these steps."""
        stiffness, is_finite = self.problem.find_stiffness(trial.coordinate, self.cases[rows[on]])
        on, trial, stiffness = on[is_finite], trial.take(is_finite), stiffness[is_finite]
        step = find_steps(stiffness, -trial.residual, radius[on], floor[on])
        found = self.problem.find_points(trial.coordinate + step.vector, self.cases[rows[on]])
        return on, found, step.length

    def _sagitta(self, rows: IntArray, length: FloatArray) -> FloatArray:
        """Return how far steps along the tangent may lead off an arc of a member's length [m]."""
        longest = np.maximum(self.start.longest[rows], 1e-300)
        return np.asarray(np.minimum(0.5 * length, 4 * length**2 / longest))


def _find_saving(point: Points, trial: Points, by_force: BoolArray) -> FloatArray:
    moved = trial.coordinate - point.coordinate
    force = ((point.residual + trial.residual) * moved).sum(axis=1) / 2
    return np.asarray(np.where(by_force, force, point.energy - trial.energy))
