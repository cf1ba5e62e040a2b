"""Minimum of the potential energy by Newton's method with damping of single members, and by relaxation.

Each step of Newton's method solves (K* + damping) s = f, see `damping` and `stiff_members`. Where the
residual vanishes and the energy still curves down, the search leaves the saddle along the lowest eigenvector.
Savings too small to show in the energy, through rounding, are taken from the forces instead: half the sum of
residuals at both ends times the step.

Dynamic relaxation is slow, and hard to lead astray. The structure moves from rest with fictitious masses;
whenever its kinetic energy peaks it is stopped, a little way back (M. R. Barnes, "Form finding and analysis
of tension structures by dynamic relaxation", Int. J. Space Structures 14, 1999). With a time step of 1,
masses of 0.6 times the row sums of |K| keep the integration stable, by Gershgorin's bound, with a margin for
stiffness that grows meanwhile.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.statics.damping import MAX_TURN, MemberDamping, find_turn
from tensegrity_codegen.runtime.statics.factors import find_lowest_curvature, project
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem, find_neutral_motions
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.system.progress import SETTLING, describe_pass

Progress = Callable[[int, float], None]

ENERGY_DIGITS = 1e-11  # of the energy's scale: smaller savings are judged by the forces
MAX_ATTEMPTS = 40  # steps with more and more damping from one configuration
MIN_SAVING = 0.1  # of the energy that the damped model says a step saves
MAX_STALLED_ITERATIONS = 6  # iterations without a better residual once rounding is reached
MAX_ESCAPES = 20
MIN_STEP_RATIO = 1e-15  # times the structure's size: no step is shorter
MAX_WORK = 3e7  # factorisations times coordinates; some minutes on one core
# Times the structure's size, in relaxation the longest member: beyond, the motion counts as unbounded.
MAX_MOTION_RATIO = 1e5
MASS_FACTOR = 0.6
REFRESH = 25  # steps between two looks at the stiffness
MAX_RETREATS = 30


@dataclass(frozen=True)
class Stability:
    """Smallest eigenvalue off the neutral rigid motions, and how large rounding may be."""

    smallest_eigenvalue: float  # [N/m]
    direction: FloatArray  # its vector
    neutral_motions: int
    rounding: float  # [N/m]
    model_eigenvalue: float  # in the model's own coordinates, which may be angles
    neutral: FloatArray  # those motions, orthonormal columns (n_directions, neutral_motions)
    unbalanced: float = 0.0  # part of `rounding` by forces that are not in balance

    @property
    def is_unstable(self) -> bool:
        """Whether the energy curves down along `direction`, beyond rounding."""
        return self.smallest_eigenvalue < -self.rounding

    @property
    def is_neutral(self) -> bool:
        """Whether the smallest eigenvalue is zero to rounding."""
        return abs(self.smallest_eigenvalue) <= self.rounding


@dataclass(frozen=True)
class Outcome:
    """The end of a search: status, point, iterations, and a sentence."""

    status: str
    point: Point
    iterations: int
    message: str = ""
    saddles_left: int = 0  # unstable equilibria that the search came to and left
    stability: Stability | None = None  # of the point, where known


def find_idle_motions(problem: StaticProblem, point: Point, stiffness: Any) -> tuple[FloatArray, float]:
    """Return the neutral rigid motions, (n_directions, k), and the bound of stiffness that is none [N/m]."""
    position = problem.node_position(point.coordinate)
    spread = float(np.linalg.norm(position - position.mean(axis=0)))
    turned = 10 * float(np.linalg.norm(point.residual)) / max(spread, 1e-300)
    motions = problem.rigid_motions(point.coordinate)
    return find_neutral_motions(stiffness, motions, turned), turned


def find_stability(problem: StaticProblem, point: Point) -> Stability:
    """Return the smallest eigenvalue of the tangent stiffness with neutral rigid motions projected off."""
    stiffness = problem.stiffness(point.coordinate)
    neutral, turned = find_idle_motions(problem, point, stiffness)
    lowest, direction = find_lowest_curvature(stiffness, neutral)
    # What is left of the forces blurs eigenvalues too.
    rounding = problem.bound_rounding(stiffness, point.coordinate) + turned
    reported = problem.smallest_eigenvalue(point.coordinate, lowest, neutral)
    return Stability(lowest, direction, neutral.shape[1], rounding, reported, neutral, turned)


def find_minimum(
    problem: StaticProblem,
    start: Point,
    *,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None = None,
) -> Outcome:
    """Return the minimum of the energy that Newton's method reaches from `start`.

    status: "converged"; "rounding_limited" (the residual is as small as rounding lets it be, and larger
    than asked); "unstable" (a saddle that no step leaves); "unbounded"; "stalled"; "iteration_limit";
    "work_limit" (a large problem has taken MAX_WORK).
    """
    search = _Search(problem, start)
    for iteration in range(max_iterations):
        if progress is not None:
            progress(iteration, search.point.node_force)
        ended = search.find_overwork() or search.advance(tolerance)
        if ended is not None:
            stability = search.stability if search.stable_point is search.best else None
            point = problem.state_tensions(search.best, tolerance)
            return Outcome(ended[0], point, iteration, ended[1], search.escapes, stability)
    message = "no convergence within the allowed iterations"
    return Outcome("iteration_limit", search.best, max_iterations, message, search.escapes)


class _Search:
    """The moving state of one minimisation."""

    def __init__(self, problem: StaticProblem, start: Point) -> None:
        self.problem, self.start, self.point, self.best = problem, start, start, start
        position = problem.node_position(start.coordinate)
        self.extent = max(float(np.ptp(position, axis=0).max(initial=0.0)), start.longest)
        self.damping = MemberDamping(problem)
        self.waited = 0
        self.escapes = 0
        self.stability: Stability | None = None  # of stable_point
        self.stable_point: Point | None = None

    def find_overwork(self) -> tuple[str, str] | None:
        """Return status and message where the search has taken as long as anybody waits."""
        size = self.problem.size
        n_factors = self.damping.factoriser.n_factors
        if n_factors * size <= MAX_WORK:
            return None
        return "work_limit", f"no convergence after {n_factors} factorisations with {size} coordinates"

    def advance(self, tolerance: float) -> tuple[str, str] | None:
        """Make one iteration; return status and message where the search ends."""
        try:
            stiffness = self.problem.stiffness(self.point.coordinate)
        except NonFiniteError:
            return "stalled", "the stiffness is not finite"
        floor = self.problem.rounding_floor(stiffness, self.point)
        self._note_best(floor)
        if self.point.is_balanced(tolerance, floor):
            self.best = self.point
            settled = self._settle("converged", "")
            if settled is None or settled[0] == "converged" or self.point.node_force <= floor:
                return settled
        if self.waited >= MAX_STALLED_ITERATIONS:
            self.point = self.best
            return self._settle("rounding_limited", "rounding error keeps the residual above the tolerance")
        return self._look_around(self._move(stiffness, floor), floor)

    def _note_best(self, floor: float) -> None:
        """Follow the point; below the rounding floor keep the best and count the wait for a better one."""
        force = self.point.node_force
        better = force < self.best.node_force
        if force > floor or force < 0.5 * self.best.node_force:
            self.waited = 0
        else:
            self.waited += 1
        if force > floor or better:
            self.best = self.point

    def _look_around(self, moved: bool, floor: float) -> tuple[str, str] | None:
        """Return status and message where no further step makes sense."""
        if (
            np.abs(self.point.coordinate - self.start.coordinate).max(initial=0.0)
            > MAX_MOTION_RATIO * self.extent
        ):
            return "unbounded", "the loads move the structure without bound"
        if moved:
            return None
        if self.point.node_force <= floor:
            self.point = self.best
            return self._settle("rounding_limited", "rounding error keeps the residual above the tolerance")
        return "stalled", "no step lowers the energy any further"

    def _settle(self, status: str, message: str) -> tuple[str, str] | None:
        """End in a minimum, or leave a saddle along its lowest eigenvector."""
        stability = find_stability(self.problem, self.point)
        self.stability, self.stable_point = stability, self.point
        if not stability.is_unstable:
            return status, message
        if self.escapes < MAX_ESCAPES and self._escape(stability):
            self.escapes += 1
            return None
        return "unstable", "an unstable equilibrium (a saddle of the energy), which no step could leave"

    def _escape(self, stability: Stability) -> bool:
        """Step along the lowest eigenvector, either way, to where the energy is lower."""
        here = self.point
        for length in self.extent * np.geomspace(0.1, 1e-7, 13):
            if -stability.smallest_eigenvalue * length**2 / 2 < 1e-14 * here.energy_scale:
                break
            ways = (length * stability.direction, -length * stability.direction)
            trials = [self.problem.find_displaced_point(here.coordinate, way) for way in ways]
            lower = [p for p in trials if p is not None and p.energy < here.energy]
            if lower:
                self.point = self.best = min(lower, key=lambda p: p.energy)
                self.waited = 0
                return True
        return False

    def _move(self, stiffness: Any, floor: float) -> bool:
        """Take a step, with more damping until the energy falls as it should; say whether one did."""
        problem, point, damping = self.problem, self.point, self.damping
        # The damped system (K* + D^T S D + mu I) s = f, without motions that no force drives.
        path = problem.find_path_stiffness(stiffness, point)
        difference = problem.find_differences(point.coordinate)
        neutral = self._find_undriven_motions(stiffness, floor)
        force = project(problem.directional_residual(point), neutral)
        here = damping.locate(point)
        for attempt in range(MAX_ATTEMPTS):
            solve = damping.factorise(path, difference, point, here)
            if solve is None:
                return False
            step = project(solve(force), neutral)
            if not np.linalg.norm(step) > MIN_STEP_RATIO * self.extent:
                return False
            trial = problem.find_displaced_point(point.coordinate, step)
            moved = (difference @ step).reshape(-1, 3)
            end = None if trial is None else damping.locate(trial)
            turn = find_turn(moved, here, end)
            if trial is None or end is None or turn.max(initial=0.0) > MAX_TURN:
                damping.hold(turn, here)
                continue
            # Energy that the damped and the undamped model save, and that the step saves.
            damped, predicted = float(force @ step) / 2, float(force @ step - step @ (path @ step) / 2)
            by_force = predicted <= ENERGY_DIGITS * point.energy_scale
            saved = self._saving(trial, by_force=by_force)
            need = damping.find_need(moved, here, end, problem.kept_strands)
            # Correct the step to second order if it saves too little.
            if saved < 0.5 * damped and not by_force:
                pull = damping.find_lengthening(moved, here, end)
                correction = solve(np.asarray(difference.T @ pull.ravel()))
                better = problem.find_displaced_point(point.coordinate, step - correction)
                if better is not None and better.energy < trial.energy:
                    trial, saved = better, self._saving(better, by_force=by_force)
                    need = damping.find_need(moved, here, damping.locate(trial), problem.kept_strands)
            if saved >= MIN_SAVING * damped or (by_force and trial.node_force < 0.9 * point.node_force):
                damping.relax(need, turn, saved / max(predicted, 1e-300), attempt == 0)
                damping.forget_small(here)
                self.point = trial
                return True
            if by_force and point.node_force <= floor:
                return False
            damping.refuse(need, here, attempt)
        return False

    def _find_undriven_motions(self, stiffness: Any, floor: float) -> FloatArray:
        """Return the rigid motions that no force drives and that cost none, (n_directions, k) orthonormal."""
        motions = self.problem.rigid_motions(self.point.coordinate)
        force = motions.T @ self.problem.directional_residual(self.point)
        if not motions.shape[1] or np.abs(force).max() > floor * np.sqrt(self.problem.size):
            return motions[:, :0]
        return find_idle_motions(self.problem, self.point, stiffness)[0]

    def _saving(self, trial: Point, *, by_force: bool) -> float:
        if by_force:
            moved = trial.coordinate - self.point.coordinate
            return float((self.point.residual + trial.residual) @ moved) / 2
        return self.point.energy - trial.energy


def follow_residual(also: Progress | None) -> Progress:
    """Return progress(iteration, largest node residual [N]), which describes the pass and calls `also`."""

    def progress(iteration: int, residual: float) -> None:
        if also is not None:
            also(iteration, residual)
        describe_pass(f"{SETTLING}: iteration {iteration:,}, residual {residual:.3g} N")

    return progress


def find_relaxed(
    problem: StaticProblem,
    start: Point,
    *,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None = None,
) -> Outcome:
    """Return the end of dynamic relaxation: "converged", "unbounded", "stalled", "iteration_limit"."""
    motion = _Motion(problem, start)
    for iteration in range(max_iterations):
        if iteration % REFRESH == 0:
            if progress is not None:
                progress(iteration, motion.point.node_force)
            ended = motion.look(tolerance)
            if ended is not None:
                return Outcome(ended[0], motion.point, iteration, ended[1])
        motion.step()
    motion.look(tolerance)
    return Outcome(
        "iteration_limit", motion.point, max_iterations, "no convergence within the allowed iterations"
    )


class _Motion:
    """A structure in fictitious motion; `point` is the last configuration that was looked at."""

    def __init__(self, problem: StaticProblem, start: Point) -> None:
        self.problem, self.start, self.point = problem, start, start
        self.mass = np.zeros(problem.size)
        self.margin = 1.0
        self.retreats = 0
        self.coordinate: FloatArray = start.coordinate
        self.velocity: FloatArray = np.zeros(problem.size)
        self.residual: FloatArray = start.residual
        self.kinetic = 0.0
        self._rest_at(start.coordinate, start.residual)

    def look(self, tolerance: float) -> tuple[str, str] | None:
        """Refresh masses from the stiffness; return status and message where the motion is over."""
        point = self.problem.find_point(self.coordinate)
        if point is None or not self._refresh_mass(point):
            return self._retreat()
        if point.node_force > 1e3 * (self.start.node_force + self.start.largest_force):
            return self._retreat()
        self.point = point
        floor = self.problem.rounding_floor(self.problem.stiffness(point.coordinate), point)
        if point.is_balanced(tolerance, floor):
            return "converged", ""
        moved = np.abs(point.coordinate - self.start.coordinate).max(initial=0.0)
        if moved > MAX_MOTION_RATIO * self.start.longest:
            return "unbounded", "the loads move the structure without bound"
        return None

    def step(self) -> None:
        """Advance by one unit of fictitious time; stop and go back where the kinetic energy has peaked."""
        moved = self.problem.move_coordinate(self.coordinate, self.velocity + self.residual / self.mass)
        residual = None if moved is None else self.problem.find_residual(moved[0])
        if moved is None or residual is None:
            self._retreat()
            return
        coordinate, self.velocity = moved
        kinetic = float(self.mass @ self.velocity**2)
        if kinetic < self.kinetic:
            back = self.problem.move_coordinate(
                coordinate, -1.5 * self.velocity + 0.5 * self.residual / self.mass
            )
            stop = coordinate if back is None else back[0]
            self._rest_at(stop, self.problem.find_residual(stop))
            return
        self.coordinate, self.residual, self.kinetic = coordinate, residual, kinetic

    def _rest_at(self, coordinate: FloatArray, residual: FloatArray | None) -> None:
        """Stop; the first step from rest is half a step."""
        if residual is None:
            coordinate, residual = self.point.coordinate, self.point.residual
        self.coordinate, self.residual, self.kinetic = coordinate, residual, 0.0
        self.velocity = -0.5 * residual / self.mass if self.mass.any() else np.zeros_like(residual)

    def _refresh_mass(self, point: Point) -> bool:
        """Raise the masses to the present stiffness; massless coordinates get the largest mass."""
        try:
            rows = self.problem.row_stiffness(point.coordinate)
        except NonFiniteError:
            return False
        mass = self.margin * MASS_FACTOR * rows
        largest = float(mass.max(initial=0.0)) or float(np.abs(point.residual).max(initial=0.0)) or 1.0
        mass = np.where(mass > 1e-9 * largest, mass, largest)
        grown = np.maximum(self.mass, mass)
        if np.any(grown > 1.5 * self.mass):
            self.mass = grown
            self._rest_at(point.coordinate, point.residual)
        return True

    def _retreat(self) -> tuple[str, str] | None:
        """Go back to the last sound point with four times the masses."""
        self.retreats += 1
        self.margin *= 4
        self.mass = self.mass * 4
        self._rest_at(self.point.coordinate, self.point.residual)
        if self.retreats > MAX_RETREATS:
            return "stalled", "the fictitious motion is unstable"
        return None
