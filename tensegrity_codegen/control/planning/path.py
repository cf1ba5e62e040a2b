"""The path of a plan: steps by programs, Newton's method, a check of every limit, corrections.

Each step goes from one equilibrium within all limits to the next. Where the equilibrium that a step leads to
violates a limit, or misses the target, further programs at the same progress correct it; where they do not,
the step is shortened. Only equilibria within all limits are kept.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.limits import WITHIN, Margins, PlanLimits, compute_margins
from tensegrity_codegen.control.planning.plan_point import (
    PlanModel,
    PlanPoint,
    Slopes,
    compute_slopes,
    describe_immobility,
)
from tensegrity_codegen.control.planning.step_problem import EASED, INSIDE, Program, Step
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, SingularStiffnessError

Progress = Callable[[int, float], None]

EXACT = 1e-8  # of the change of the targets: error that counts as none
END = 1e-9  # progress this near to 1 is 1
MOST_CORRECTIONS = 8
LEAST_SHARE = 0.1  # of the progress of a step that its corrections leave
SHRINK, GROW = 0.4, 2.0
LARGEST_CHANGE = 1.0  # of the longest member: of an input in all steps together
SMALLEST_CHANGE = 1e-6  # of the largest change: shorter steps are not tried
UNIT = 1e-3  # of the longest member: scale of changes
LEAST_PROGRESS = 1e-6  # of a step that counts at all
N_LAST, DEAD = 8, 1e-4  # the last steps together make less progress than this: it has died out
FADED = 0.05  # of `least_progress`: the same, as a part of what such steps would make at the start
REACH = 0.5  # of the predicted motion: how far the equilibrium is from the prediction
SOFT = 3.0  # steps after which the smallest eigenvalue could reach its limit


@dataclass(frozen=True)
class PathPoint:
    """A stored point: the equilibrium, progress, values of the targets, margins, and what bound the step.

    binding: rows of `margins` that limited the step to this point; multiplier: their multipliers.
    """

    at: PlanPoint
    progress: float
    target: FloatArray
    margins: Margins
    binding: NDArray[np.int64]
    multiplier: FloatArray


class PlanPath:
    """The moving state of one plan.

    Parameters
    ----------
    plan_model : PlanModel
        The model and its actuators.
    limits : PlanLimits
        The limits.
    targets : Targets
        Targets bound to the model.
    start : PlanPoint
        An equilibrium within all limits.
    steps : int
        Number of steps where nothing limits them.
    least_progress : float
        Progress, as part of that of a step which nothing limits: the path ends where several steps in a row
        make less.
    preferred : ndarray, shape (n_actuators,) [m], optional
        Changes of the inputs that the first step prefers to the smallest ones, as far as targets and limits
        leave them free.
    """

    def __init__(
        self,
        plan_model: PlanModel,
        limits: PlanLimits,
        targets: Targets,
        start: PlanPoint,
        steps: int,
        least_progress: float,
        preferred: FloatArray | None = None,
    ) -> None:
        self.model, self.limits, self.targets = plan_model, limits, targets.follow(start.position)
        self.first = self.targets.evaluate(plan_model.problem(start.change), start.coordinate)
        self.goal = self.targets.goal
        self.direction = self.goal - self.first
        none = np.zeros(0)
        margins = compute_margins(limits, start)
        self.points = [PathPoint(start, 0.0, self.first, margins, none.astype(np.int64), none)]
        self.unit = UNIT * start.point.longest
        self.most_radius = self.radius = LARGEST_CHANGE * start.point.longest / steps
        self.most_pace = self.pace = 1.0 / steps
        self.least_progress, self.preferred = least_progress, preferred
        self.slopes = self._find_slopes(start, start)
        self.first_free: float | None = None  # progress that the largest step at the start could make
        self.expected: list[float] = []  # of each step, the progress that such a step would make at the start
        self.n_slow = 0  # last steps in a row with less progress than `least_progress`
        self.failure = ""  # why the last step was shortened
        self.is_limited = True  # whether limits are to blame for it
        self.inside = INSIDE  # margin that the programs of the step leave to limits

    @property
    def is_done(self) -> bool:
        """Whether the targets are reached."""
        size = np.maximum(np.abs(self.first), np.abs(self.goal))
        at_start = bool(np.all(np.abs(self.direction) <= EXACT * np.maximum(size, self.unit)))
        return at_start or self.points[-1].progress >= 1.0

    def advance(self) -> bool:
        """Make one step, or shorten the next one; return whether the path can go on."""
        here = self.points[-1]
        ask = min(self.pace, 1.0 - here.progress)
        self.inside = INSIDE
        program = self._build_program(here.at, here.target, here.progress)
        if self.preferred is not None and len(self.points) == 1:
            furthest = program.find_furthest(0.0, ask)
            ask = ask if furthest is None else furthest.progress / 2  # the rest is left to other changes
            program = replace(program, preferred=self.preferred)
        step = program.find_step(ask) or self._find_last(here, ask) or program.find_furthest(0.0, ask)
        if step is None:
            return self._shorten("the limits leave no progress")
        if step.progress < LEAST_PROGRESS and here.progress + step.progress < 1.0 - END:
            return self._stop(program)
        reached = self._reach(here, step)
        if reached is None:
            return self._shorten(self.failure)
        self.points.append(reached)
        self.failure = ""
        self.targets = self.targets.follow(reached.at.position)
        return self._judge(program, ask, reached.progress - here.progress)

    def _judge(self, program: Program, ask: float, made: float) -> bool:
        """Return whether the path can go on after a step; set the size of the next one.

        Parameters
        ----------
        program : Program
            That of the step.
        ask, made : float
            Progress asked for, and made.
        """
        if self.first_free is None:
            self.first_free = program.find_free(1.0)
        self.expected.append(min(ask, program.radius / self.most_radius * self.first_free))
        least, meant = self.least_progress * ask, made
        if made < least:  # without limits, the bound of the step may permit less than asked for
            least = min(least, self.least_progress * program.find_free(ask))
            bound = program.find_bound(ask)
            meant = 0.0 if bound is None else bound.progress
        if made < least <= meant:  # limits leave more to first order: shorter steps follow them better
            self.failure = "the corrections of the steps leave too little progress"
            return self.is_done or (self._shorten(self.failure) and not self._has_died_out())
        self.radius = min(GROW * self.radius, self.most_radius)
        self.pace = min(GROW * self.pace, self.most_pace)
        self.n_slow = self.n_slow + 1 if made < least else 0
        if self.n_slow == N_LAST and not self.is_done:
            self.failure = (
                f"the limits leave little progress, less than {self.least_progress:g} of what a step could "
                f"make (`least_progress`) in {N_LAST} in a row: further steps are possible, and "
                "`least_progress` 0 takes them"
            )
            return False
        return not self._has_died_out()

    def _find_last(self, here: PathPoint, ask: float) -> Step | None:
        """Return the step to a target on a limit, which is met within the tolerance of limits."""
        if here.progress + ask < 1.0 - END:
            return None
        self.inside = EASED
        step = self._build_program(here.at, here.target, here.progress).find_step(ask)
        if step is None:
            self.inside = INSIDE
        return step

    def _stop(self, program: Program) -> bool:
        """Say why steps of the full size make no progress: targets do not move, or limits; the path ends.

        Where such a step could, to first order, it and all shorter ones were rejected: the last one says why.
        """
        program = replace(program, radius=self.most_radius)
        bound = program.find_bound(self.most_pace)
        if program.find_free(self.most_pace) < LEAST_PROGRESS:
            self.is_limited = False
            self.failure = describe_immobility(
                self.targets.names, self.slopes.target, self.direction, self.points[-1].at.point.longest
            )
        elif bound is None or bound.progress < LEAST_PROGRESS or not self.failure:
            self.failure = "the limits leave no progress"
        return False

    def find_bound(self) -> Step | None:
        """Return the step of most progress at the last point, of the limits linearised."""
        self.radius = self.most_radius
        here = self.points[-1]
        return self._build_program(here.at, here.target, here.progress).find_bound()

    def _has_died_out(self) -> bool:
        """Return whether the last steps together make next to no progress, or little of that of the first."""
        if self.is_done or len(self.points) <= N_LAST:
            return False
        made = self.points[-1].progress - self.points[-1 - N_LAST].progress
        meant = sum(
            self.expected[-N_LAST:]
        )  # zero where the first step, to first order, does not move the targets
        share = f", {made / meant:.2g} of what they would make at the start" if meant > 0.0 else ""
        self.failure = (
            f"progress has died out: {made:.3g} of the way in the last {N_LAST} steps{share}; a step changes "
            f"rest lengths by {self.most_radius:.3g} m at most, fewer steps (`steps`) permit more"
        )
        return made < DEAD or made < FADED * self.least_progress * meant

    def _shorten(self, why: str) -> bool:
        self.failure = why
        self.radius *= SHRINK
        self.pace *= SHRINK
        return self.radius > SMALLEST_CHANGE * self.most_radius

    def _build_program(self, at: PlanPoint, target: FloatArray, progress: float) -> Program:
        margins = compute_margins(self.limits, at, self.slopes)
        defect = self.first + progress * self.direction - target
        return Program(margins, self.slopes, defect, self.direction, self.radius, self.unit, self.inside)

    def _reach(self, here: PathPoint, step: Step) -> PathPoint | None:
        """Return the point that a step leads to, after corrections; None where it cannot be kept."""
        progress = here.progress + step.progress
        progress = 1.0 if progress > 1.0 - END else progress
        at, before = self._follow(here.at, step.change), self.slopes
        if at is None:
            return None
        try:
            self.slopes = self._find_slopes(at, here.at)
            reached = self._correct(at, progress, here, step)
        except (SingularStiffnessError, NonFiniteError):
            self.failure, reached = "a motion of the structure meets no resistance", None
        if reached is None:
            self.slopes = before
        return reached

    def _correct(self, at: PlanPoint, progress: float, here: PathPoint, step: Step) -> PathPoint | None:
        """Return the point within all limits near an equilibrium, by programs with the same slopes."""
        least = here.progress + LEAST_SHARE * step.progress
        for _ in range(MOST_CORRECTIONS):
            target = self.targets.evaluate(self.model.problem(at.change), at.coordinate)
            wanted = self.first + progress * self.direction
            margins = compute_margins(self.limits, at)
            if self._is_inside(margins) and self._is_exact(target - wanted) and self._is_stable(at):
                return PathPoint(at, progress, target, margins, step.binding, step.multiplier)
            program = self._build_program(at, target, progress)
            better = program.find_step(0.0) or program.find_furthest(min(least - progress, 0.0), 0.0)
            if better is None:
                self.failure = f"the limits are exceeded beyond the step: {self._name_worst(margins)}"
                return None
            progress += better.progress
            moved = self._follow(at, better.change)
            if moved is None:
                return None
            at = moved
        miss = target - wanted
        worst = int(np.abs(miss).argmax())
        what = (
            f"{self.targets.names[worst]} is missed by {miss[worst]:.3g} {self.targets.units[worst]}".rstrip()
        )
        if self._is_exact(miss):
            what = "the equilibrium is unstable" if self._is_inside(margins) else self._name_worst(margins)
        self.failure = f"the corrections of the step do not converge: {what}"
        return None

    def _name_worst(self, margins: Margins) -> str:
        return margins.kind[int(margins.excess.argmax())]

    def _follow(self, at: PlanPoint, change: FloatArray) -> PlanPoint | None:
        """Return the equilibrium after a change of the inputs, None where it is not found."""
        moved = self.slopes.coordinate @ change
        carried = self.model.problem(at.change + change).carry(at.coordinate, moved)
        reach = REACH * float(np.abs(moved).max(initial=0.0)) + SMALLEST_CHANGE * at.point.longest
        found = None if carried is None else self.model.find_point(at.change + change, carried[0], reach)
        if found is None:
            self.failure = "no equilibrium is found near the step"
        return found

    def _find_slopes(self, at: PlanPoint, before: PlanPoint) -> Slopes:
        return compute_slopes(self.model, at, self.targets, with_stiffness=self._is_soft(at, before))

    def _is_soft(self, at: PlanPoint, before: PlanPoint) -> bool:
        """Return whether the smallest eigenvalue could come to its limit within the next steps."""
        if len(at.eigenvalue) == 0:
            return False
        if at is before:
            return self.limits.least_stiffness > 0
        fallen = float(before.eigenvalue[0] - at.eigenvalue[0])
        return float(at.eigenvalue[0]) - self.limits.least_stiffness < SOFT * fallen

    def _is_inside(self, margins: Margins) -> bool:
        return float(margins.excess.max(initial=-1.0)) <= WITHIN

    def _is_exact(self, defect: FloatArray) -> bool:
        return bool(np.all(np.abs(defect) <= EXACT * float(np.abs(self.direction).max())))

    def _is_stable(self, at: PlanPoint) -> bool:
        return len(at.eigenvalue) == 0 or float(at.eigenvalue[0]) > 0.0
