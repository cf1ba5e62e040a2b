"""The path of a plan: steps by programs, Newton's method, a check of every limit, corrections.

Each step goes from one equilibrium within all limits to the next. Where the equilibrium that a step leads to
violates a limit, or misses the target, further programs at the same progress correct it; where they do not,
the step is shortened. Only equilibria within all limits are kept.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.limits import LIMIT_TOLERANCE, Margins, PlanLimits, compute_margins
from tensegrity_codegen.control.planning.plan_point import (
    PlanModel,
    PlanPoint,
    Slopes,
    compute_slopes,
    describe_immobility,
)
from tensegrity_codegen.control.planning.step_problem import AIMED_MARGIN, FINAL_MARGIN, Program, Step
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, SingularStiffnessError

Progress = Callable[[int, float], None]

TARGET_TOLERANCE = 1e-8  # of the change of the targets: error that counts as none
PROGRESS_TOLERANCE = 1e-9  # progress this near to 1 is 1
MOST_CORRECTIONS = 8
LEAST_CORRECTED_PART = 0.1  # of the progress of a step that its corrections leave
STEP_DECREASE, STEP_INCREASE = 0.4, 2.0
LARGEST_CHANGE = 1.0  # of the longest member: of an input in all steps together
SMALLEST_CHANGE = 1e-6  # of the largest change: shorter steps are not tried
CHANGE_SCALE = 1e-3  # of the longest member
LEAST_PROGRESS = 1e-6  # of a step that counts at all
# The path has stalled where so many last steps together make less progress than this, or less than this part,
# of `least_progress`, of what such steps would make at the start.
N_RECENT_STEPS, LEAST_RECENT_PROGRESS, LEAST_RECENT_PART = 8, 1e-4, 0.05
SEARCH_PART = 0.5  # of the predicted motion: how far the equilibrium is from the prediction
STEPS_TO_LIMIT = 3.0  # steps after which the smallest eigenvalue could reach its limit


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

    targets: targets bound to the model.
    start: an equilibrium within all limits.
    steps: number of steps where nothing limits them.
    least_progress: progress, as part of that of a step which nothing limits: the path ends where several
        steps in a row make less.
    preferred (n_actuators,) [m]: changes of the inputs that the first step prefers to the smallest ones, as
        far as targets and limits leave them free.
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
        self.unit = CHANGE_SCALE * start.point.longest
        self.most_radius = self.radius = LARGEST_CHANGE * start.point.longest / steps
        self.most_step_progress = self.step_progress = 1.0 / steps
        self.least_progress, self.preferred = least_progress, preferred
        self.slopes = self._find_slopes(start, start)
        # Progress that the largest step at the start could make; and of each step, what it would make there.
        self.first_unlimited_progress: float | None = None
        self.expected_progress: list[float] = []
        self.n_slow = 0  # last steps in a row with less progress than `least_progress`
        self.failure = ""  # why the last step was shortened
        self.is_limited = True  # whether limits are to blame for it
        self.aimed_margin = AIMED_MARGIN  # margin that the programs of the step leave to limits

    @property
    def is_done(self) -> bool:
        """Whether the targets are reached."""
        size = np.maximum(np.abs(self.first), np.abs(self.goal))
        at_start = bool(np.all(np.abs(self.direction) <= TARGET_TOLERANCE * np.maximum(size, self.unit)))
        return at_start or self.points[-1].progress >= 1.0

    def advance(self) -> bool:
        """Make one step, or shorten the next one; return whether the path can go on."""
        here = self.points[-1]
        wanted = min(self.step_progress, 1.0 - here.progress)
        self.aimed_margin = AIMED_MARGIN
        program = self._build_program(here.at, here.target, here.progress)
        # The first step makes half of the progress that limits leave: the rest is left to preferred changes.
        if self.preferred is not None and len(self.points) == 1:
            furthest = program.find_furthest(0.0, wanted)
            wanted = wanted if furthest is None else furthest.progress / 2
            program = replace(program, preferred=self.preferred)
        # The smallest changes that make the wanted progress; else the most progress that there is.
        step = (
            program.find_step(wanted)
            or self._find_final_step(here, wanted)
            or program.find_furthest(0.0, wanted)
        )
        if step is None:
            return self._shorten("the limits leave no progress")
        if step.progress < LEAST_PROGRESS and here.progress + step.progress < 1.0 - PROGRESS_TOLERANCE:
            return self._explain_end(program)
        # The equilibrium there, corrected until it is within all limits.
        reached = self._find_reached_point(here, step)
        if reached is None:
            return self._shorten(self.failure)
        self.points.append(reached)
        self.failure = ""
        self.targets = self.targets.follow(reached.at.position)
        return self._adapt_step(program, wanted, reached.progress - here.progress)

    def _adapt_step(self, program: Program, wanted: float, made: float) -> bool:
        """Return whether the path can go on after a step of a program; set the size of the next one.

        wanted, made: progress asked for, and made.
        """
        # What such a step would make at the start, by which later ones are measured.
        if self.first_unlimited_progress is None:
            self.first_unlimited_progress = program.find_unlimited_progress(1.0)
        at_start = program.radius / self.most_radius * self.first_unlimited_progress
        self.expected_progress.append(min(wanted, at_start))
        # The least that is enough: without limits, the bound of the step may permit less than asked for.
        least, possible = self.least_progress * wanted, made
        if made < least:
            least = min(least, self.least_progress * program.find_unlimited_progress(wanted))
            bound = program.find_bound(wanted)
            possible = 0.0 if bound is None else bound.progress
        # Limits leave more to first order: shorter steps follow them better.
        if made < least <= possible:
            self.failure = "the corrections of the steps leave too little progress"
            return self.is_done or (self._shorten(self.failure) and not self._has_stalled())
        # Longer steps, unless several in a row were slow.
        self.radius = min(STEP_INCREASE * self.radius, self.most_radius)
        self.step_progress = min(STEP_INCREASE * self.step_progress, self.most_step_progress)
        self.n_slow = self.n_slow + 1 if made < least else 0
        if self.n_slow == N_RECENT_STEPS and not self.is_done:
            self.failure = (
                f"the limits leave little progress, less than {self.least_progress:g} of what a step could "
                f"make (`least_progress`) in {N_RECENT_STEPS} in a row: further steps are possible, and "
                "`least_progress` 0 takes them"
            )
            return False
        return not self._has_stalled()

    def _find_final_step(self, here: PathPoint, wanted: float) -> Step | None:
        """Return the step to a target on a limit, which is met within the tolerance of limits."""
        if here.progress + wanted < 1.0 - PROGRESS_TOLERANCE:
            return None
        self.aimed_margin = FINAL_MARGIN
        step = self._build_program(here.at, here.target, here.progress).find_step(wanted)
        if step is None:
            self.aimed_margin = AIMED_MARGIN
        return step

    def _explain_end(self, program: Program) -> bool:
        """Say why steps of the full size make no progress: targets do not move, or limits; the path ends.

        Where such a step could, to first order, it and all shorter ones were rejected: the last one says why.
        """
        program = replace(program, radius=self.most_radius)
        bound = program.find_bound(self.most_step_progress)
        if program.find_unlimited_progress(self.most_step_progress) < LEAST_PROGRESS:
            self.is_limited = False
            self.failure = describe_immobility(
                self.targets.names, self.slopes.target, self.direction, self.points[-1].at.point.longest
            )
        elif bound is None or bound.progress < LEAST_PROGRESS or not self.failure:
            self.failure = "the limits leave no progress"
        return False

    def build_last_program(self) -> Program:
        """Return what the largest step from the last point is found from."""
        self.radius = self.most_radius
        here = self.points[-1]
        return self._build_program(here.at, here.target, here.progress)

    def _has_stalled(self) -> bool:
        """Return whether the last steps together make next to no progress, or little of that of the first."""
        if self.is_done or len(self.points) <= N_RECENT_STEPS:
            return False
        made = self.points[-1].progress - self.points[-1 - N_RECENT_STEPS].progress
        # Zero where the first step, to first order, does not move the targets.
        expected = sum(self.expected_progress[-N_RECENT_STEPS:])
        share = f", {made / expected:.2g} of what they would make at the start" if expected > 0.0 else ""
        has_stalled = (
            made < LEAST_RECENT_PROGRESS or made < LEAST_RECENT_PART * self.least_progress * expected
        )
        if has_stalled:
            self.failure = (
                f"progress has died out: {made:.3g} of the way in the last {N_RECENT_STEPS} steps{share}; a "
                f"step changes rest lengths by {self.most_radius:.3g} m at most, fewer steps (`steps`) "
                "permit more"
            )
        return has_stalled

    def _shorten(self, why: str) -> bool:
        """Shorten the next step; return whether it is long enough to be tried."""
        self.failure = why
        self.radius *= STEP_DECREASE
        self.step_progress *= STEP_DECREASE
        return self.radius > SMALLEST_CHANGE * self.most_radius

    def _build_program(self, at: PlanPoint, target: FloatArray, progress: float) -> Program:
        margins = compute_margins(self.limits, at, self.slopes)
        defect = self.first + progress * self.direction - target
        return Program(
            margins, self.slopes, defect, self.direction, self.radius, self.unit, self.aimed_margin
        )

    def _find_reached_point(self, here: PathPoint, step: Step) -> PathPoint | None:
        """Return the point that a step leads to, after corrections; None where it cannot be kept."""
        progress = here.progress + step.progress
        progress = 1.0 if progress > 1.0 - PROGRESS_TOLERANCE else progress
        at, before = self._find_equilibrium(here.at, step.change), self.slopes
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
        least = here.progress + LEAST_CORRECTED_PART * step.progress
        for _ in range(MOST_CORRECTIONS):
            # Is the equilibrium stable, within all limits and on target?
            target = self.targets.evaluate(self.model.problem(at.change), at.coordinate)
            wanted = self.first + progress * self.direction
            margins = compute_margins(self.limits, at)
            is_stable = len(at.eigenvalue) == 0 or float(at.eigenvalue[0]) > 0.0
            if self._is_inside(margins) and self._is_exact(target - wanted) and is_stable:
                return PathPoint(at, progress, target, margins, step.binding, step.multiplier)
            # The smallest change that corrects it, with less progress where there is none.
            program = self._build_program(at, target, progress)
            better = program.find_step(0.0) or program.find_furthest(min(least - progress, 0.0), 0.0)
            if better is None:
                self.failure = f"the limits are exceeded beyond the step: {self._name_worst(margins)}"
                return None
            progress += better.progress
            moved = self._find_equilibrium(at, better.change)
            if moved is None:
                return None
            at = moved
        # What is left after all corrections.
        miss = target - wanted
        if self._is_exact(miss):
            what = "the equilibrium is unstable" if self._is_inside(margins) else self._name_worst(margins)
        else:
            worst = int(np.abs(miss).argmax())
            name, unit = self.targets.names[worst], self.targets.units[worst]
            what = f"{name} is missed by {miss[worst]:.3g} {unit}".rstrip()
        self.failure = f"the corrections of the step do not converge: {what}"
        return None

    def _name_worst(self, margins: Margins) -> str:
        return margins.kind[int(margins.excess.argmax())]

    def _find_equilibrium(self, at: PlanPoint, change: FloatArray) -> PlanPoint | None:
        """Return the equilibrium after a change of the inputs, None where it is not found."""
        moved = self.slopes.coordinate @ change
        carried = self.model.problem(at.change + change).move_coordinate(at.coordinate, moved)
        reach = SEARCH_PART * float(np.abs(moved).max(initial=0.0)) + SMALLEST_CHANGE * at.point.longest
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
        return float(at.eigenvalue[0]) - self.limits.least_stiffness < STEPS_TO_LIMIT * fallen

    def _is_inside(self, margins: Margins) -> bool:
        return float(margins.excess.max(initial=-1.0)) <= LIMIT_TOLERANCE

    def _is_exact(self, defect: FloatArray) -> bool:
        return bool(
            np.all(np.abs(defect) <= TARGET_TOLERANCE * float(np.abs(self.direction).max(initial=0.0)))
        )
