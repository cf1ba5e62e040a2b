"""Newton's method with damping of single members for many cases at once: the search of newton.py.

Every case takes the steps that it takes alone, with damping of its own; each pass makes one attempt at a step
of every case. What is rare is left to the search for one case: leaving a saddle, a stiffness that is not
finite, and where no step helps.
"""

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points, put, take
from tensegrity_codegen.runtime.statics.batch.stability import (
    carry_motions,
    find_idle_motions,
    find_rigid_motions,
)
from tensegrity_codegen.runtime.statics.damping import (
    MAX_FACTORS,
    MAX_TURN,
    Damping,
    Members,
    find_least_shift,
    find_turn,
    locate_members,
)
from tensegrity_codegen.runtime.statics.newton import (
    ENERGY_DIGITS,
    MAX_ATTEMPTS,
    MAX_MOTION_RATIO,
    MAX_STALLED_ITERATIONS,
    MIN_SAVING,
    MIN_STEP_RATIO,
)
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray

MOVING, LEFT = "", "left"


@dataclass(frozen=True)
class _Ground:
    """What all attempts from one configuration have in common, one row a case."""

    path: FloatArray  # (count, n, n) [N/m], the Hessian along the curves that steps follow
    force: FloatArray  # (count, n) [N], the residual without its part along undriven motions
    undriven: FloatArray  # (count, n, 6): rigid motions that no force drives; columns of zeros where fewer
    compression: FloatArray  # (count, n_members) [N/m], compression over length
    least: FloatArray  # (count, 1) [N/m], least shift
    floor: FloatArray  # (count,) [N], of the residual


@dataclass(frozen=True)
class _Attempt:
    """One step of each case in rows."""

    rows: IntArray
    point: Points
    here: Members
    damping: Damping
    floor: FloatArray  # (count,) [N]
    factor: Any  # (count,) Cholesky factors
    step: FloatArray  # (count, n) [m]
    moved: FloatArray  # (count, n_members, 3) [m], differences of the ends of members
    damped: FloatArray  # (count,) [J], saved by the damped model
    predicted: FloatArray  # (count,) [J], saved by the undamped model

    @property
    def is_by_force(self) -> BoolArray:
        """Whether savings are too small to show in the energy."""
        return np.asarray(self.predicted <= ENERGY_DIGITS * self.point.energy_scale)

    def find_saving(self, trial: Points) -> FloatArray:
        """Return the energy saved at trials [J]."""
        moved = trial.coordinate - self.point.coordinate
        by_force = ((self.point.residual + trial.residual) * moved).sum(axis=1) / 2
        return np.where(self.is_by_force, by_force, self.point.energy - trial.energy)


class BatchSearch:
    """The moving state of the searches of the cases of a problem.

    status: of each case "" while it moves; "converged", "rounding_limited", "unbounded" where it has ended at
    `best`; "left" where the search for one case has to begin anew.
    """

    def __init__(self, problem: BatchProblem, start: Points) -> None:
        self.problem, self.start = problem, start
        count, members, size = len(start.energy), len(problem.ends), problem.size
        self.point, self.best = deepcopy(start), deepcopy(start)
        self.extent = np.maximum(np.ptp(start.position, axis=1).max(axis=1), start.longest)
        self.twist, self.middle = find_rigid_motions(problem, start.position)[1], start.position.mean(axis=1)
        self.damping = Damping.start(count, members)
        shapes = ((size, size), (size,), (size, 6), (members,), (1,), ())
        self.ground = _Ground(*(np.zeros((count, *shape)) for shape in shapes))
        self.waited, self.iterations, self.attempts, self.hardened = np.zeros((4, count), dtype=np.int64)
        self.is_new = np.ones(count, dtype=np.bool_)
        self.status = np.full(count, MOVING, dtype="<U20")

    def run(self, tolerance: float, max_iterations: int) -> None:
        """Search until every case has ended, or was left."""
        while len(rows := np.flatnonzero(self.status == MOVING)):
            if (new := self.is_new[rows]).any():
                self._look(rows[new], tolerance)
            if (moves := self.status[rows] == MOVING).any():
                self._try(rows[moves])
            is_late = (self.status == MOVING) & (self.iterations >= max_iterations)
            self.status[is_late] = LEFT

    def _look(self, rows: IntArray, tolerance: float) -> None:
        """End the searches of cases that have come to a configuration, or prepare steps from there."""
        point = take(self.point, rows)
        stiffness, is_finite = self.problem.find_stiffness(point.coordinate, rows)
        self.status[rows[~is_finite]] = LEFT
        floor = np.where(is_finite, self.problem.rounding_floor(stiffness, point), np.inf)
        self._note_best(rows[is_finite], floor[is_finite])
        is_balanced = is_finite & point.is_balanced(tolerance, floor)
        put(self.best, rows[is_balanced], take(point, is_balanced))
        self.status[rows[is_balanced]] = "converged"
        has_waited = self.waited[rows] >= MAX_STALLED_ITERATIONS
        self.status[rows[is_finite & ~is_balanced & has_waited]] = "rounding_limited"
        moves = self.status[rows] == MOVING
        if moves.any():
            self._prepare(rows[moves], take(point, moves), stiffness[moves], floor[moves])

    def _note_best(self, rows: IntArray, floor: FloatArray) -> None:
        """Follow the points; below the rounding floor keep the best and count the wait for a better one."""
        force, best = self.point.node_force[rows], self.best.node_force[rows]
        falls = (force > floor) | (force < 0.5 * best)
        self.waited[rows] = np.where(falls, 0, self.waited[rows] + 1)
        better = rows[(force > floor) | (force < best)]
        put(self.best, better, take(self.point, better))

    def _prepare(self, rows: IntArray, point: Points, stiffness: FloatArray, floor: FloatArray) -> None:
        """Note the common data of all attempts from the points."""
        problem, here = self.problem, self._locate(point)
        path, tension = problem.find_path(stiffness, point)
        undriven = np.zeros((len(rows), problem.size, 6))
        if self.twist.shape[2]:
            undriven = self._find_undriven_motions(rows, point, stiffness, floor)
        force = _project(point.residual, undriven)
        compression = np.maximum(-tension, 0.0) / here.length
        least_shift = find_least_shift(problem.bound_rounding(path, point, rows)[:, None], here)
        put(self.ground, rows, _Ground(path, force, undriven, compression, least_shift, floor))
        self.is_new[rows] = False

    def _find_undriven_motions(
        self, rows: IntArray, point: Points, stiffness: FloatArray, floor: FloatArray
    ) -> FloatArray:
        """Return the rigid motions that no force drives and that cost none, (count, n, 6)."""
        motions = carry_motions(self.problem, point.position, self.twist[rows], self.middle[rows])
        drive = np.abs(point.residual[:, None, :] @ motions).max(axis=(1, 2))
        motions[drive > floor * np.sqrt(self.problem.size)] = 0.0
        return find_idle_motions(stiffness, motions, point)[0]

    def _try(self, rows: IntArray) -> None:
        """Make one attempt of each case in rows."""
        attempt = self._find_steps(rows)
        if attempt is None:
            return
        trial = self.problem.find_displaced_points(attempt.point, attempt.step, attempt.rows)
        trial.tension[~trial.is_finite] = np.nan
        turn = find_turn(attempt.moved, attempt.here, self._locate(trial))
        is_far = ~trial.is_finite | (turn.max(axis=1, initial=0.0) > MAX_TURN)
        if is_far.any():
            held = take(attempt, is_far)
            held.damping.hold(turn[is_far], held.here)
            self._count(held)
            attempt, trial, turn = (take(record, ~is_far) for record in (attempt, trial, turn))
        if len(attempt.rows):
            self._judge(attempt, trial, turn)

    def _find_steps(self, rows: IntArray) -> _Attempt | None:
        """Return steps of those cases whose matrices are positive definite; damp the others more."""
        ground, damping, point = (take(record, rows) for record in (self.ground, self.damping, self.point))
        here, matrix = self._locate(point), ground.path.copy()
        self.problem.blocks.add(matrix, damping.find_weight(ground.compression))
        diagonal = np.arange(self.problem.size)
        matrix[:, diagonal, diagonal] += damping.shift + ground.least
        factor, solution, is_definite = _solve(matrix, ground.force)
        self._harden(take(damping, ~is_definite), take(here, ~is_definite), ground, rows, ~is_definite)
        step = _project(solution, ground.undriven)
        is_short = ~(np.linalg.norm(step, axis=1) > MIN_STEP_RATIO * self.extent[rows])
        self._stop(rows[is_definite & is_short])
        good = is_definite & ~is_short
        if not good.any():
            return None
        driven = (ground.force * step).sum(axis=1)
        along = (ground.path @ step[:, :, None])[:, :, 0]
        moved, saved = self.problem.find_displacements(step), driven - (step * along).sum(axis=1) / 2
        attempt = _Attempt(rows, point, here, damping, ground.floor, factor, step, moved, driven / 2, saved)
        return attempt if good.all() else take(attempt, good)

    def _harden(
        self, damping: Damping, here: Members, ground: _Ground, rows: IntArray, which: BoolArray
    ) -> None:
        if which.any():
            damping.harden(here, ground.least[which])
            put(self.damping, rows[which], damping)
            self.hardened[rows[which]] += 1
            self._stop(rows[which & (self.hardened[rows] >= MAX_FACTORS)])
        self.hardened[rows[~which]] = 0

    def _judge(self, attempt: _Attempt, trial: Points, turn: FloatArray) -> None:
        """Take the steps after which the energy is lower as it should be; damp the others more."""
        by_force, saved = attempt.is_by_force, attempt.find_saving(trial)
        need = self._find_need(attempt, trial)
        poor = (saved < 0.5 * attempt.damped) & ~by_force
        if poor.any():
            self._correct(attempt, np.flatnonzero(poor), trial, saved, need)
        good = saved >= MIN_SAVING * attempt.damped
        good |= by_force & (trial.node_force < 0.9 * attempt.point.node_force)
        if good.any():
            self._accept(*(take(record, good) for record in (attempt, trial, need, turn, saved)))
        if not good.all():
            refused = take(attempt, ~good)
            self._stop(refused.rows[refused.is_by_force & (refused.point.node_force <= refused.floor)])
            refused.damping.refuse(need[~good], refused.here, self.attempts[refused.rows, None])
            self._count(refused)

    def _find_need(self, attempt: _Attempt, trial: Points) -> FloatArray:
        end, kept_members = self._locate(trial), self.problem.kept_members
        return attempt.damping.find_need(attempt.moved, attempt.here, end, kept_members)

    def _correct(
        self, attempt: _Attempt, rows: IntArray, trial: Points, saved: FloatArray, need: FloatArray
    ) -> None:
        """Replace trials by those of steps corrected to second order, where these save more."""
        poor, poor_trial = take(attempt, rows), take(trial, rows)
        pull = self.problem.find_node_forces(
            poor.damping.find_lengthening(poor.moved, poor.here, self._locate(poor_trial))
        )
        correction = np.array(
            [
                scipy.linalg.lapack.dpotrs(factor, force, lower=1)[0]
                for factor, force in zip(poor.factor, pull, strict=True)
            ]
        )
        corrected = self.problem.find_displaced_points(poor.point, poor.step - correction, poor.rows)
        better = corrected.is_finite & (corrected.energy < poor_trial.energy)
        poor, corrected, rows = take(poor, better), take(corrected, better), rows[better]
        put(trial, rows, corrected)
        saved[rows], need[rows] = poor.find_saving(corrected), self._find_need(poor, corrected)
        put(attempt.damping, rows, poor.damping)

    def _accept(
        self, attempt: _Attempt, trial: Points, need: FloatArray, turn: FloatArray, saved: FloatArray
    ) -> None:
        rows, damping = attempt.rows, attempt.damping
        ratio = saved / np.maximum(attempt.predicted, 1e-300)
        damping.relax(need, turn, ratio[:, None], (self.attempts[rows] == 0)[:, None])
        damping.forget_small(attempt.here)
        put(self.damping, rows, damping)
        put(self.point, rows, trial)
        way = np.abs(trial.coordinate - self.start.coordinate[rows]).max(axis=1, initial=0.0)
        is_far = way > MAX_MOTION_RATIO * self.extent[rows]
        self.status[rows[is_far]] = "unbounded"
        self.iterations[rows[~is_far]] += 1
        self.attempts[rows] = 0
        self.is_new[rows] = True

    def _count(self, attempt: _Attempt) -> None:
        """Note the damping after failed attempts, and end the searches with too many."""
        put(self.damping, attempt.rows, attempt.damping)
        self.attempts[attempt.rows] += 1
        self._stop(attempt.rows[self.attempts[attempt.rows] >= MAX_ATTEMPTS])

    def _stop(self, rows: IntArray) -> None:
        """End searches in which no step helps any further."""
        is_quiet = self.point.node_force[rows] <= self.ground.floor[rows]
        self.status[rows] = np.where(is_quiet, "rounding_limited", LEFT)

    def _locate(self, point: Points) -> Members:
        return locate_members(point.position, self.problem.manifest.strands, point)


def _project(vector: FloatArray, motions: FloatArray) -> FloatArray:
    """Return vectors (count, n) without their parts along orthonormal motions (count, n, k)."""
    components = vector[:, None, :] @ motions
    return np.asarray(vector - (motions @ components.transpose(0, 2, 1))[:, :, 0])


def _solve(matrix: FloatArray, right: FloatArray) -> tuple[Any, FloatArray, BoolArray]:
    """Return Cholesky factors, solutions (count, n), and which matrices are positive definite."""
    factor, solution = np.empty(len(matrix), dtype=object), np.zeros_like(right)
    is_definite = np.zeros(len(matrix), dtype=np.bool_)
    for k in range(len(matrix)):
        factor[k], solution[k], failed = scipy.linalg.lapack.dposv(matrix[k].T, right[k], lower=1)
        is_definite[k] = not failed
    return factor, solution, is_definite
