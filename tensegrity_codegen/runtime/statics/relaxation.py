"""Dynamic relaxation with kinetic damping: slow, and hard to lead astray.

The structure moves from rest with fictitious masses; whenever its kinetic energy peaks it is stopped, a
little way back (M. R. Barnes, "Form finding and analysis of tension structures by dynamic relaxation",
Int. J. Space Structures 14, 1999). With a time step of 1, masses of 0.6 times the row sums of |K| keep
the integration stable, by Gershgorin's bound, with a margin for stiffness that grows meanwhile.
"""

import numpy as np

from tensegrity_codegen.runtime.statics.newton import Outcome, Progress
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

MASS_FACTOR = 0.6
REFRESH = 25  # steps between two looks at the stiffness
MAX_MOTION_RATIO = 1e5  # times the longest member: beyond, the motion counts as unbounded
MOST_RETREATS = 30


def find_relaxed(
    problem: StaticProblem,
    start: Point,
    *,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None = None,
) -> Outcome:
    """Return where dynamic relaxation from `start` comes to rest.

    status: "converged" (by the criterion of Point.is_balanced), "unbounded", "stalled" (it kept blowing
    up) or "iteration_limit". The stability of the place is not looked at.
    """
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
            place = coordinate if back is None else back[0]
            self._rest_at(place, self.problem.find_residual(place))
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
        wanted = self.margin * MASS_FACTOR * rows
        largest = float(wanted.max(initial=0.0)) or float(np.abs(point.residual).max(initial=0.0)) or 1.0
        wanted = np.where(wanted > 1e-9 * largest, wanted, largest)
        grown = np.maximum(self.mass, wanted)
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
        if self.retreats > MOST_RETREATS:
            return "stalled", "the fictitious motion is unstable"
        return None
