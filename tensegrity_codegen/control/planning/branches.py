"""Branches of a plan: the path of the smallest changes, paths that begin otherwise, ways over drawn shapes.

A straight path to the targets keeps to one branch of equilibria, and often to a symmetry of the structure.
Where limits block it, the next ones begin with other changes of the inputs. Then the search leaves the
straight line: from a shape that it has reached, it walks in a random direction along equilibria within all
limits, as far as they let it slide, and goes straight to the targets from there. The shapes that are reached
form a tree; half of the walks begin at the one that is nearest to the targets.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_codegen.control.planning.path import PathPoint, PlanPath, Progress
from tensegrity_codegen.control.planning.step_problem import AIMED_MARGIN
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.runtime.records.plan_result import Branch, Cover
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError, SingularStiffnessError

N_FIRST_CHANGES = 2  # attempts that begin with other changes, before those over drawn shapes
FIRST_CHANGE = 0.01  # of the longest member: largest of these changes
LEAST_GAIN = 1e-3  # progress by which another path comes further
LEAST_WALK, MOST_WALK = 2, 10  # steps of a walk
LEAST_CHANGE = 0.02  # of the largest change of a step: a walk that limits let move less has ended

BuildPath = Callable[..., PlanPath]
Prove = Callable[[PlanPath], Cover | None]


@dataclass(frozen=True)
class Reached:
    """A shape of the tree: the points from the start to it, and the targets followed to it.

    gap: distance from the targets, as a part of their change.
    """

    points: list[PathPoint]
    targets: Targets
    gap: float


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
            if step is not None and np.abs(step.change).max() < LEAST_CHANGE * self.radius:
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
    """Return a path to the targets; where limits block all, the one from the start that comes furthest.

    build: (targets=, start=, preferred=, of=) -> path, of the class `of`.
    attempts: largest number of other paths where limits block that of the smallest changes.
    seed: of the random changes and walks.
    prove: finds the proof that there is no plan, from a blocked path; then nothing is drawn.
    Returns: the path, how each branch that was tried ended, and the proof.
    """
    furthest = build()
    first, targets, draw = furthest.points[0], furthest.targets, np.random.default_rng(seed)
    is_blocked = take_steps(furthest, max_steps, progress)
    branches = [_record("smallest changes", furthest)]
    # Straight paths that begin with other changes, as far as targets and limits leave them free.
    count, tree = 0, [Reached([first], targets, 1.0), _reach(furthest, [], furthest)]
    while is_blocked and count < min(attempts, N_FIRST_CHANGES):
        preferred = FIRST_CHANGE * first.at.point.longest * draw.uniform(-1.0, 1.0, len(first.at.change))
        other, count = build(preferred=preferred), count + 1
        is_blocked = take_steps(other, max_steps, progress, furthest)
        branches.append(_record("other first changes", other))
        tree.append(_reach(other, [], furthest))
        if other.points[-1].progress > furthest.points[-1].progress + LEAST_GAIN:
            furthest = other
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
    walk.go(way, int(draw.integers(LEAST_WALK, MOST_WALK + 1)))
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


def _join(trail: list[PathPoint], rest: list[PathPoint]) -> list[PathPoint]:
    """Return the points of a way, their progress by their number up to the last straight path."""
    before, total = len(trail) - 1, len(trail) + len(rest) - 2
    way = [replace(point, progress=k / total) for k, point in enumerate(trail)]
    share = 1.0 - before / total
    return way + [replace(point, progress=1.0 - share * (1.0 - point.progress)) for point in rest[1:]]


def _record(kind: str, path: PlanPath) -> Branch:
    reason = "reaches the target" if path.is_done else path.failure
    return Branch(kind, len(path.points) - 1, path.points[-1].progress, path.points[-1].target, reason)
