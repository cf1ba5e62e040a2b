"""The path of a plan: steps by programs, Newton's method, a check of every limit, corrections.

Each step goes from one equilibrium within all limits to the next. If the equilibrium that a step leads to
violates a limit, or misses the target, further programs at the same progress correct it; where they do not,
the step is shortened. Only equilibria within all limits are kept.

A straight path to the targets keeps to one branch of equilibria, and often to a symmetry of the structure.
If limits block it, the next ones begin with other changes of the inputs. Then the search leaves the
straight line: from a shape that it has reached, it walks in a random direction along equilibria within all
limits, as far as they let it slide, and goes straight to the targets from there. The shapes that are reached
form a tree; half of the walks begin at the one that is nearest to the targets.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.plan_point import (
    PlanModel,
    PlanPoint,
    Slopes,
    compute_slopes,
    describe_immobility,
)
from tensegrity_codegen.control.planning.step_problem import (
    AIMED_MARGIN,
    FINAL_MARGIN,
    LIMIT_TOLERANCE,
    Margins,
    PlanLimits,
    Program,
    Step,
    compute_margins,
)
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.runtime.records.plan_result import Branch, Cover
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, SingularStiffnessError

Progress = Callable[[int, float], None]

TARGET_TOLERANCE = 1e-8  # of the change of the targets: error that counts as none
PROGRESS_TOLERANCE = 1e-9  # progress this near to 1 is 1
MAX_CORRECTIONS = 8
MIN_CORRECTED_PART = 0.1  # of the progress of a step that its corrections leave
STEP_DECREASE, STEP_INCREASE = 0.4, 2.0
LARGEST_CHANGE = 1.0  # of the longest member: of an input in all steps together
SMALLEST_CHANGE = 1e-6  # of the largest change: shorter steps are not tried
CHANGE_SCALE = 1e-3  # of the longest member
MIN_PROGRESS = 1e-6  # of a step that counts at all
# The path has stalled where so many last steps together make less progress than this, or less than this part,
# of `least_progress`, of what such steps would make at the start.
N_RECENT_STEPS, MIN_RECENT_PROGRESS, MIN_RECENT_PART = 8, 1e-4, 0.05
SEARCH_PART = 0.5  # of the predicted motion: how far the equilibrium is from the prediction
STEPS_TO_LIMIT = 3.0  # steps after which the smallest eigenvalue could reach its limit

N_FIRST_CHANGES = 2  # attempts that begin with other changes, before those over drawn shapes
FIRST_CHANGE = 0.01  # of the longest member: largest of these changes
MIN_GAIN = 1e-3  # progress by which another path comes further
MIN_WALK, MAX_WALK = 2, 10  # steps of a walk
MIN_CHANGE = 0.02  # of the largest change of a step: a walk that limits let move less has ended


@dataclass(frozen=True)
class PathPoint:
    """A stored point: the equilibrium, progress, target values, margins, limits that bound the step."""

    at: PlanPoint
    progress: float
    target: FloatArray
    margins: Margins
    binding: NDArray[np.int64]  # rows of `margins` that limited the step to this point
    multiplier: FloatArray  # their multipliers


class PlanPath:
    """The moving state of one plan.

    targets: targets bound to the model.
    start: an equilibrium within all limits.
    steps: number of steps if nothing limits them.
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
        self.slopes = self._compute_slopes(start, start)
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
        requested = min(self.step_progress, 1.0 - here.progress)
        self.aimed_margin = AIMED_MARGIN
        program = self._build_program(here.at, here.target, here.progress)
        # The first step makes half of the progress that limits leave: the rest is left to preferred changes.
        if self.preferred is not None and len(self.points) == 1:
            furthest = program.find_furthest(0.0, requested)
            requested = requested if furthest is None else furthest.progress / 2
            program = replace(program, preferred=self.preferred)
        # The smallest changes that make the wanted progress; else the most progress that there is.
        step = (
            program.find_step(requested)
            or self._find_final_step(here, requested)
            or program.find_furthest(0.0, requested)
        )
        if step is None:
            return self._shorten("the limits leave no progress")
        if step.progress < MIN_PROGRESS and here.progress + step.progress < 1.0 - PROGRESS_TOLERANCE:
            return self._explain_end(program)
        # The equilibrium there, corrected until it is within all limits.
        reached = self._find_reached_point(here, step)
        if reached is None:
            return self._shorten(self.failure)
        self.points.append(reached)
        self.failure = ""
        self.targets = self.targets.follow(reached.at.position)
        return self._adapt_step(program, requested, reached.progress - here.progress)

    def _adapt_step(self, program: Program, requested: float, made: float) -> bool:
        """Return whether the path can go on after a step of a program; set the size of the next one."""
        # What such a step would make at the start, by which later ones are measured.
        if self.first_unlimited_progress is None:
            self.first_unlimited_progress = program.find_unlimited_progress(1.0)
        at_start = program.radius / self.most_radius * self.first_unlimited_progress
        self.expected_progress.append(min(requested, at_start))
        # The least that is enough: without limits, the bound of the step may permit less than asked for.
        required, possible = self.least_progress * requested, made
        if made < required:
            required = min(required, self.least_progress * program.find_unlimited_progress(requested))
            bound = program.find_bound(requested)
            possible = 0.0 if bound is None else bound.progress
        # Limits leave more to first order: shorter steps follow them better.
        if made < required <= possible:
            self.failure = "the corrections of the steps leave too little progress"
            return self.is_done or (self._shorten(self.failure) and not self._has_stalled())
        # Longer steps, unless several in a row were slow.
        self.radius = min(STEP_INCREASE * self.radius, self.most_radius)
        self.step_progress = min(STEP_INCREASE * self.step_progress, self.most_step_progress)
        self.n_slow = self.n_slow + 1 if made < required else 0
        if self.n_slow == N_RECENT_STEPS and not self.is_done:
            self.failure = (
                f"the limits leave little progress, less than {self.least_progress:g} of what a step could "
                f"make (`least_progress`) in {N_RECENT_STEPS} in a row: further steps are possible, and "
                "`least_progress` 0 takes them"
            )
            return False
        return not self._has_stalled()

    def _find_final_step(self, here: PathPoint, requested: float) -> Step | None:
        """Return the step to a target on a limit, which is met within the tolerance of limits."""
        if here.progress + requested < 1.0 - PROGRESS_TOLERANCE:
            return None
        self.aimed_margin = FINAL_MARGIN
        step = self._build_program(here.at, here.target, here.progress).find_step(requested)
        if step is None:
            self.aimed_margin = AIMED_MARGIN
        return step

    def _explain_end(self, program: Program) -> bool:
        """Say why steps of the full size make no progress: targets do not move, or limits; the path ends.

        If such a step could, to first order, it and all shorter ones were rejected: the last one says why.
        """
        program = replace(program, radius=self.most_radius)
        bound = program.find_bound(self.most_step_progress)
        if program.find_unlimited_progress(self.most_step_progress) < MIN_PROGRESS:
            self.is_limited = False
            self.failure = describe_immobility(
                self.targets.names, self.slopes.target, self.direction, self.points[-1].at.point.longest
            )
        elif bound is None or bound.progress < MIN_PROGRESS or not self.failure:
            self.failure = "the limits leave no progress"
        return False

    def build_last_program(self) -> Program:
        """Return the program of the largest step from the last point."""
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
        fraction = f", {made / expected:.2g} of what they would make at the start" if expected > 0.0 else ""
        has_stalled = made < MIN_RECENT_PROGRESS or made < MIN_RECENT_PART * self.least_progress * expected
        if has_stalled:
            self.failure = (
                f"progress has died out: {made:.3g} of the way in the last {N_RECENT_STEPS} steps{fraction}; "
                f"a step changes rest lengths by {self.most_radius:.3g} m at most, fewer steps (`steps`) "
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
        """Return the point that a step leads to, after corrections; None if it cannot be kept."""
        progress = here.progress + step.progress
        progress = 1.0 if progress > 1.0 - PROGRESS_TOLERANCE else progress
        at, before = self._find_equilibrium(here.at, step.change), self.slopes
        if at is None:
            return None
        try:
            self.slopes = self._compute_slopes(at, here.at)
            reached = self._correct(at, progress, here, step)
        except (SingularStiffnessError, NonFiniteError):
            self.failure, reached = "a motion of the structure meets no resistance", None
        if reached is None:
            self.slopes = before
        return reached

    def _correct(self, at: PlanPoint, progress: float, here: PathPoint, step: Step) -> PathPoint | None:
        """Return the point within all limits near an equilibrium, by programs with the same slopes."""
        least_progress = here.progress + MIN_CORRECTED_PART * step.progress
        for _ in range(MAX_CORRECTIONS):
            # Is the equilibrium stable, within all limits and on target?
            target = self.targets.evaluate(self.model.problem(at.change), at.coordinate)
            goal = self.first + progress * self.direction
            margins = compute_margins(self.limits, at)
            is_stable = len(at.eigenvalue) == 0 or float(at.eigenvalue[0]) > 0.0
            if self._is_inside(margins) and self._is_exact(target - goal) and is_stable:
                return PathPoint(at, progress, target, margins, step.binding, step.multiplier)
            # The smallest change that corrects it, with less progress if there is none.
            program = self._build_program(at, target, progress)
            better = program.find_step(0.0) or program.find_furthest(min(least_progress - progress, 0.0), 0.0)
            if better is None:
                self.failure = f"the limits are exceeded beyond the step: {self._name_worst(margins)}"
                return None
            progress += better.progress
            moved = self._find_equilibrium(at, better.change)
            if moved is None:
                return None
            at = moved
        # The error after all corrections.
        miss = target - goal
        if self._is_exact(miss):
            reason = "the equilibrium is unstable" if self._is_inside(margins) else self._name_worst(margins)
        else:
            worst = int(np.abs(miss).argmax())
            name, unit = self.targets.names[worst], self.targets.units[worst]
            reason = f"{name} is missed by {miss[worst]:.3g} {unit}".rstrip()
        self.failure = f"the corrections of the step do not converge: {reason}"
        return None

    def _name_worst(self, margins: Margins) -> str:
        return margins.kind[int(margins.excess.argmax())]

    def _find_equilibrium(self, at: PlanPoint, change: FloatArray) -> PlanPoint | None:
        """Return the equilibrium after a change of the inputs, None if it is not found."""
        moved = self.slopes.coordinate @ change
        carried = self.model.problem(at.change + change).move_coordinate(at.coordinate, moved)
        reach = SEARCH_PART * float(np.abs(moved).max(initial=0.0)) + SMALLEST_CHANGE * at.point.longest
        equilibrium = (
            None if carried is None else self.model.find_point(at.change + change, carried[0], reach)
        )
        if equilibrium is None:
            self.failure = "no equilibrium is found near the step"
        return equilibrium

    def _compute_slopes(self, at: PlanPoint, before: PlanPoint) -> Slopes:
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


# Branches: paths that begin otherwise, and ways over drawn shapes.

BuildPath = Callable[..., PlanPath]
Prove = Callable[[PlanPath], Cover | None]


@dataclass(frozen=True)
class Reached:
    """A shape of the tree: the points from the start to it, and the targets followed to it."""

    points: list[PathPoint]
    targets: Targets
    gap: float  # distance from the targets, as a part of their change


class Walk(PlanPath):
    """Steps along equilibria within all limits that no target leads; built with `Targets(())`."""

    def go(self, way: FloatArray, count: int) -> None:
        """Take up to `count` steps that differ least from a way, (n_actuators,), as limits let them slide.

        Changes of tensions weigh as in all steps, so that most of a way is a change of shape.
        """
        for _ in range(2 * count):
            here = self.points[-1]
            self.aimed_margin = AIMED_MARGIN
            program = self._build_program(here.at, here.target, 0.0)
            preferred = np.asarray(np.linalg.solve(program.hessian, way), dtype=np.float64)
            preferred = preferred * (self.radius / float(np.abs(preferred).max()))
            step = replace(program, preferred=preferred).find_step(0.0)
            if step is not None and np.abs(step.change).max() < MIN_CHANGE * self.radius:
                return
            reached = None if step is None else self._find_reached_point(here, step)
            if reached is None:
                if not self._shorten("a step of the walk fails"):
                    return
                continue
            self.points.append(reached)
            self.radius = min(2 * self.radius, self.most_radius)
            if len(self.points) > count:
                return


def find_path(
    build: BuildPath, max_steps: int, progress: Progress | None, attempts: int, seed: int, prove: Prove
) -> tuple[PlanPath, tuple[Branch, ...], Cover | None]:
    """Return a path to the targets, or the one that comes furthest, how each branch ended, and a proof.

    build(targets=, start=, preferred=, of=) makes a path of the class `of`; prove(path) finds the proof that
    there is no plan, from a blocked path; then no walk is drawn.
    """
    furthest = build()
    start, targets, draw = furthest.points[0], furthest.targets, np.random.default_rng(seed)
    is_blocked = take_steps(furthest, max_steps, progress)
    branches = [_record("smallest changes", furthest)]
    # Straight paths that begin with other changes, as far as targets and limits leave them free.
    count, tree = 0, [Reached([start], targets, 1.0), _reach(furthest, [], furthest)]
    while is_blocked and count < min(attempts, N_FIRST_CHANGES):
        preferred = FIRST_CHANGE * start.at.point.longest * draw.uniform(-1.0, 1.0, len(start.at.change))
        attempt, count = build(preferred=preferred), count + 1
        is_blocked = take_steps(attempt, max_steps, progress, furthest)
        branches.append(_record("other first changes", attempt))
        tree.append(_reach(attempt, [], furthest))
        if attempt.points[-1].progress > furthest.points[-1].progress + MIN_GAIN:
            furthest = attempt
    if is_blocked and count:
        furthest.failure += f"; {count} paths that begin with other changes end no further"
    # Ways over shapes that random walks lead to, where nothing proves that there are none.
    cover = prove(furthest) if is_blocked else None
    for _ in range(attempts - count if is_blocked and cover is None else 0):
        from_nearest = draw.random() < 0.5
        node = min(tree, key=lambda item: item.gap) if from_nearest else tree[draw.integers(len(tree))]
        try:
            trail, targets = _walk(build, node, draw)
            path = build(targets=targets, start=trail[-1].at)
        except (NonFiniteError, SingularStiffnessError):
            continue  # the targets have no values there, or a motion meets no resistance
        take_steps(path, max_steps, progress)
        branches.append(_record("random walk", path))
        if path.is_done:
            path.points = _join(trail, path.points)
            return path, tuple(branches), None
        tree += [Reached(trail, targets, 1.0), _reach(path, trail, furthest)]
    if is_blocked and len(branches) > 1 + N_FIRST_CHANGES:
        count = len(branches) - 1 - N_FIRST_CHANGES
        furthest.failure += (
            f", and of {count} over shapes drawn at random (seed {seed}) none reaches the target"
        )
    return furthest, tuple(branches), cover


def take_steps(
    path: PlanPath, max_steps: int, progress: Progress | None, rival: PlanPath | None = None
) -> bool:
    """Take steps until the path ends, or as many as allowed; return whether limits block it.

    A path that is behind its rival after twice as many steps and attempts is given up.
    """
    for count in range(max_steps):
        if path.is_done:
            return False
        if rival and count > 2 * len(rival.points) and path.points[-1].progress < rival.points[-1].progress:
            return True
        can_go_on = path.advance()
        if progress is not None:
            progress(len(path.points) - 1, path.points[-1].progress)
        if not can_go_on:
            return path.is_limited and not path.is_done
    if not path.is_done:
        path.failure = f"the target is not reached after {max_steps} steps and attempts (`max_steps`)"
    return False


def _walk(build: BuildPath, node: Reached, draw: np.random.Generator) -> tuple[list[PathPoint], Targets]:
    """Return the points from the start over a shape of the tree to the end of a walk; the targets there."""
    walk = build(of=Walk, targets=Targets(()), start=node.points[-1].at)
    assert isinstance(walk, Walk)
    way = draw.standard_normal(len(walk.points[0].at.change))
    walk.go(way, int(draw.integers(MIN_WALK, MAX_WALK + 1)))
    trail, targets = list(node.points), node.targets
    for point in walk.points[1:]:
        targets = targets.follow(point.at.position)
        value = targets.evaluate(walk.model.problem(point.at.change), point.at.coordinate)
        trail.append(replace(point, target=value))
    return trail, targets


def _reach(path: PlanPath, trail: list[PathPoint], straight: PlanPath) -> Reached:
    """Return the end of a path as a shape of the tree; its gap is over the change of the straight path."""
    units = np.array(path.targets.units)
    scale = np.array([np.abs(straight.direction[units == unit]).max() for unit in units])
    gap = np.abs(path.goal - path.points[-1].target) / np.maximum(scale, 1e-300)
    return Reached(trail + path.points[bool(trail) :], path.targets, float(gap.max(initial=0.0)))


def _join(trail: list[PathPoint], straight: list[PathPoint]) -> list[PathPoint]:
    """Return the points of a way, their progress by their number up to the last straight path."""
    before, total = len(trail) - 1, len(trail) + len(straight) - 2
    way = [replace(point, progress=k / total) for k, point in enumerate(trail)]
    remaining = 1.0 - before / total
    return way + [replace(point, progress=1.0 - remaining * (1.0 - point.progress)) for point in straight[1:]]


def _record(kind: str, path: PlanPath) -> Branch:
    reason = "reaches the target" if path.is_done else path.failure
    return Branch(kind, len(path.points) - 1, path.points[-1].progress, path.points[-1].target, reason)
