"""Limits of a plan, and the programs of one step: small changes of the inputs that keep tensions.

At an equilibrium with margins m to all limits and values g of the targets, for changes du and progress ds:

    minimise |du|^2 + w |de|^2   subject to   dg/du du = g(s + ds) - g,  m + dm/du du >= 0,  |du_j| <= r

with e the extensions of all members (lengths minus rest lengths, which tensions follow): of the many changes
of rest lengths that lead to the next target it takes those that change tensions least. ds is as large as
asked; where that has no solution, as large as possible.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from tensegrity_codegen.control.planning.plan_point import MemberRanges, PlanPoint, Slopes
from tensegrity_codegen.control.planning.quadratic_program import find_largest, find_minimum
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.limits import MEMBER_LIMITS, Limits
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import InvalidValueError

EXTENSION_WEIGHT = 50.0  # w: weight of changes of extensions next to changes of rest lengths
# Weight of both next to progress, where progress is what is sought. It should not cut it, so changes of more
# units than the second number weigh no more than these.
CHANGE_WEIGHT, MAX_WEIGHTED_UNITS = 1e-6, 50.0
AIMED_MARGIN = 1e-7  # of the size of a limit: where steps aim
FINAL_MARGIN = -1e-7  # the same, of a last step that ends on a limit; limits count as satisfied to 5e-7
WITHIN = 1e-9  # of the size of a limit: what rounding exceeds it by
BINDING_PART = 1e-7  # of the largest multiplier
SAME_PROGRESS, SAME_PART = 1e-6, 1e-3  # progress, and its part, by which two steps count as equal
MAX_DEMANDS = 40

LIMIT_TOLERANCE = 5e-7  # of the size of a limit: excess that counts as none
MIN_SIZE = 1e-4  # of the largest force or the longest member: size of limits near zero
MIN_STIFFNESS = 1e-3  # [N/m]: size of the limit of the smallest eigenvalue where it is near zero


@dataclass(frozen=True)
class PlanLimits:
    """The limits that every equilibrium of a plan satisfies; infinities stand for no limit."""

    least_tension: FloatArray  # (n_members,) [N]: bounds of the member tensions
    most_tension: FloatArray  # (n_members,) [N]
    # (n_members,) [N]: largest force in tension and compression, from the yield stress
    yield_force: FloatArray
    # (n_members,) [N m2]: pi^2 E I over the safety factor: the compression is at most this over the squared
    # length
    buckling: FloatArray
    clearance: float  # [m]: least distance between bars
    # [N/m]: least smallest eigenvalue of the stiffness; 0 if the limits are below: plans are stable
    least_stiffness: float
    # least_change, most_change (n_actuators,) [m]: range of the actuators' inputs, by members that one
    # actuator alone moves
    least_change: FloatArray
    most_change: FloatArray
    ranges: MemberRanges  # ranges of the rest lengths of all members that move


@dataclass(frozen=True)
class Margins:
    """Margins to all limits, positive inside; one row each."""

    # "least_tension", "most_tension", "yield", "buckling", "clearance", "least_stiffness", "range"
    kind: tuple[str, ...]
    index: NDArray[np.int64]  # (n,): member, pair of bars, eigenvalue or row of the ranges
    value: FloatArray  # (n,) [N, m, N/m]: margins
    size: FloatArray  # (n,): size of each limit, for tolerances
    bound: FloatArray  # (n,) [N, m, N/m]: the limits themselves; of ranges, the value of the input
    # (n, n_actuators) or None: derivatives of the margins with respect to the inputs
    slope: FloatArray | None = None

    @property
    def excess(self) -> FloatArray:
        """How far each limit is exceeded, as a part of its size; negative inside."""
        return np.asarray(-self.value / self.size)


def build_limits(model: CompiledModel, ranges: MemberRanges, limits: Limits | None = None) -> PlanLimits:
    """Return the limits of a structure and of its actuators, as bounds of forces and inputs."""
    structure = model.structure
    assert structure is not None
    limits = _read_limits(structure.limits if limits is None else limits, len(structure.member_name))
    area = np.where(structure.section_area > 0, structure.section_area, math.inf)
    flexural = math.pi**2 * structure.flexural_rigidity
    with np.errstate(divide="ignore", invalid="ignore"):
        buckling = np.where(limits.buckling > 0, flexural / limits.buckling, math.inf)
    return PlanLimits(
        np.array(limits.least_tension),
        np.array(limits.most_tension),
        limits.yield_stress * area,
        buckling,
        limits.clearance,
        max(limits.least_stiffness, 0.0),
        *ranges.of_actuators(),
        ranges,
    )


def _read_limits(limits: Limits, count: int) -> Limits:
    """Return limits of `count` members, as arrays of doubles; raises InvalidValueError for others."""
    if not isinstance(limits, Limits):
        raise InvalidValueError(
            "not limits", where="limits", given=limits, allowed="an object Limits, or None"
        )
    for key in ("clearance", "least_stiffness"):
        value = getattr(limits, key)
        if not is_number(value) and not (isinstance(value, float) and math.isinf(value)):
            raise InvalidValueError("not a limit", where=f"limits.{key}", given=value, allowed="a number")
    allowed = f"{count} numbers, without NaN"
    arrays = {key: to_doubles(getattr(limits, key), f"limits.{key}", allowed) for key in MEMBER_LIMITS}
    shapes = {(count,)} if any(array.size for array in arrays.values()) else {(0,), (count,)}
    for key, array in arrays.items():
        if array.shape not in shapes or np.isnan(array).any():
            raise InvalidValueError(
                "not a limit of each member",
                where=f"limits.{key}",
                given=getattr(limits, key),
                allowed=allowed,
            )
    read = Limits(**arrays, clearance=limits.clearance, least_stiffness=limits.least_stiffness)
    return read.for_members(count)


def keep_taut(limits: PlanLimits, at: PlanPoint, tension_only: NDArray[np.bool_]) -> PlanLimits:
    """Return the limits with least tension 0 for cables without one that are in tension at the start."""
    free = tension_only & (at.tension > 0) & ~np.isfinite(limits.least_tension)
    return replace(limits, least_tension=np.where(free, 0.0, limits.least_tension))


def compute_margins(limits: PlanLimits, at: PlanPoint, slopes: Slopes | None = None) -> Margins:
    """Return the margins of an equilibrium to all limits that exist."""
    tension, load, count = at.tension, limits.buckling / at.length**2, len(at.change)
    ranges = limits.ranges
    change = ranges.pull @ at.change
    shortest, longest = ranges.least - ranges.rest_length, ranges.most - ranges.rest_length
    clearance = np.full(at.distance.shape, limits.clearance)
    stiff = np.full(at.eigenvalue.shape, limits.least_stiffness)
    # Margins and limits, kind by kind.
    rows = [
        ("least_tension", tension - limits.least_tension, limits.least_tension),
        ("most_tension", limits.most_tension - tension, limits.most_tension),
        ("yield", limits.yield_force - tension, limits.yield_force),
        ("yield", limits.yield_force + tension, limits.yield_force),
        ("buckling", tension + load, load),
        ("clearance", at.distance - clearance, clearance),
        ("range", change - shortest, shortest),
        ("range", longest - change, longest),
        ("least_stiffness", at.eigenvalue - stiff, stiff),
    ]
    # Their derivatives; buckling loads fall with the length.
    sloping: list[FloatArray | None] = [None] * len(rows)
    if slopes is not None:
        curve = np.where(np.isfinite(limits.buckling), -2 * limits.buckling / at.length**3, 0.0)
        bent = slopes.tension + curve[:, None] * slopes.length
        pull, pulled = ranges.pull, slopes.tension
        soft = slopes.eigenvalue if len(slopes.eigenvalue) else np.zeros((len(stiff), count))
        sloping = [pulled, -pulled, -pulled, pulled, bent, slopes.distance, pull, -pull, soft]
    # Sizes of limits near zero.
    force = max(at.point.largest_force, 1e-300)
    reference = {"clearance": at.point.longest, "range": at.point.longest, "least_stiffness": MIN_STIFFNESS}
    return _stack(rows, sloping, {kind: MIN_SIZE * reference.get(kind, force) for kind, *_ in rows})


def _stack(
    rows: list[tuple[str, FloatArray, FloatArray]], sloping: list[FloatArray | None], floor: dict[str, float]
) -> Margins:
    """Return the finite rows, one after the other."""
    kinds: list[str] = []
    index, value, size, bound, slope = [], [], [], [], []
    for (kind, margin, limit), derivative in zip(rows, sloping, strict=True):
        finite = np.flatnonzero(np.isfinite(margin))
        kinds += [kind] * len(finite)
        index.append(finite)
        value.append(margin[finite])
        size.append(np.maximum(np.abs(limit[finite]), floor[kind]))
        bound.append(limit[finite])
        if derivative is not None:
            slope.append(derivative[finite])
    return Margins(
        tuple(kinds),
        np.concatenate(index).astype(np.int64),
        np.concatenate(value),
        np.concatenate(size),
        np.concatenate(bound),
        np.concatenate(slope) if slope else None,
    )


# The programs of one step.


@dataclass(frozen=True)
class Step:
    """A step: changes of the inputs (n_actuators,) [m], progress, the margins that bind, their multipliers.

    In the step with the most progress, a multiplier is the progress gained for a unit of the margin.
    """

    change: FloatArray
    progress: float
    binding: NDArray[np.int64]
    multiplier: FloatArray


@dataclass(frozen=True)
class Program:
    """The quadratic program of a step from one equilibrium."""

    margins: Margins  # margins to all limits, with slopes
    slopes: Slopes  # derivatives of targets and extensions
    defect: FloatArray  # (n_targets,): g(s) - g
    direction: FloatArray  # (n_targets,): dg/ds
    radius: float  # [m]: largest change of an input
    unit: float  # [m]: scale of the changes
    aimed_margin: float = AIMED_MARGIN  # margin that is left to each limit, as a part of its size
    # (n_actuators,) [m]: the changes of the inputs from which a step differs least, instead of 0
    preferred: FloatArray | None = None

    def find_step(self, progress: float) -> Step | None:
        """Return the step with this progress, None if there is none."""
        rows, lower, upper = self._constraints(progress)
        hessian = self.hessian
        gradient = np.zeros(len(hessian)) if self.preferred is None else -hessian @ self.preferred / self.unit
        optimum = find_minimum(hessian, gradient, rows, lower, upper)
        return None if optimum is None else self._build_step(optimum.x, progress, optimum.multiplier)

    def find_furthest(self, least: float, most: float) -> Step | None:
        """Return the step with the most progress within [least, most], None if there is none."""
        rows, lower, upper = self._constraints_with_progress(least, most)
        count = rows.shape[1] - 1
        hessian = np.diag(np.append(np.zeros(count), 1.0))
        weight = CHANGE_WEIGHT * min((MAX_WEIGHTED_UNITS * self.unit / self.radius) ** 2, 1.0)
        hessian[:count, :count] = weight * self.hessian
        gradient = np.append(np.zeros(count), -1.0)
        optimum = find_minimum(hessian, gradient, rows, lower, upper)
        if optimum is None:
            return None
        progress = least + (most - least) * float(optimum.x[-1])
        return self._build_step(optimum.x[:count], progress, optimum.multiplier)

    def find_unlimited_progress(self, most: float) -> float:
        """Return the most progress within [0, most] that the bound of the step permits without limits."""
        margins = replace(self.margins, value=np.full(len(self.margins.value), np.inf))
        step = replace(self, margins=margins).find_bound(most)
        return 0.0 if step is None else min(step.progress, most)

    def find_bound(self, most: float = np.inf) -> Step | None:
        """Return the step with the most progress up to `most`, of the limits linearised; None without one."""
        rows, lower, upper = self._constraints_with_progress(0.0, 1.0)
        lower[-1], upper[-1] = -np.inf, most
        best = find_largest(np.append(np.zeros(rows.shape[1] - 1), 1.0), rows, lower, upper)
        return None if best is None else self._build_step(best.x[:-1], float(best.x[-1]), best.multiplier)

    def is_within(self, change: FloatArray) -> NDArray[np.bool_]:
        """Return whether changes of the inputs (n_actuators,) keep to each margin, linearised."""
        assert self.margins.slope is not None
        margin = self.margins.value + self.margins.slope @ change - self.aimed_margin * self.margins.size
        return np.asarray(margin >= -WITHIN * self.margins.size)

    @property
    def reachable_rows(self) -> NDArray[np.int64]:
        """Rows of the margins that a step within the radius can reach."""
        assert self.margins.slope is not None
        reach = np.abs(self.margins.slope).sum(axis=1) * self.radius
        return np.flatnonzero(self.margins.value - self.aimed_margin * self.margins.size < reach)

    @property
    def _goal_unit(self) -> float:
        return max(float(np.abs(self.direction).max(initial=0.0)), 1e-300)

    @property
    def hessian(self) -> FloatArray:
        """Matrix of the objective over du / unit, (n_actuators, n_actuators)."""
        count = self.slopes.extension.shape[1]
        return np.asarray(np.eye(count) + EXTENSION_WEIGHT * self.slopes.extension.T @ self.slopes.extension)

    def _constraints(self, progress: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows over du / unit and their bounds: targets, limits that are near, the box."""
        reachable, count = self.reachable_rows, len(self.slopes.target.T)
        # Targets are scaled by the largest of their changes, inputs by their unit.
        assert self.margins.slope is not None
        goal = (self.defect + progress * self.direction) / self._goal_unit
        aim = (self.aimed_margin * self.margins.size - self.margins.value)[reachable]
        box = np.full(count, self.radius / self.unit)
        targets = self.slopes.target * (self.unit / self._goal_unit)
        rows = np.vstack([targets, self.margins.slope[reachable] * self.unit, np.eye(count)])
        return (
            rows,
            np.concatenate([goal, aim, -box]),
            np.concatenate([goal, np.full(len(reachable), np.inf), box]),
        )

    def _constraints_with_progress(
        self, least: float, most: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows over (du / unit, z), progress least + z (most - least) with 0 <= z <= 1, and their bounds."""
        rows, lower, upper = self._constraints(least)
        column = np.zeros(len(rows))
        column[: len(self.direction)] = -self.direction * ((most - least) / self._goal_unit)
        unit_row = np.eye(rows.shape[1] + 1)[-1:]
        rows = np.vstack([np.hstack([rows, column[:, None]]), unit_row])
        return rows, np.append(lower, 0.0), np.append(upper, 1.0)

    def _build_step(self, x: FloatArray, progress: float, multiplier: FloatArray) -> Step:
        reachable, n_targets = self.reachable_rows, len(self.direction)
        weight = multiplier[n_targets : n_targets + len(reachable)]
        active = np.flatnonzero(weight > BINDING_PART * float(weight.max(initial=0.0)))
        return Step(self.unit * x, progress, reachable[active], weight[active])


# The fewest limits that alone block a path as much as all limits do, of the limits linearised at its end.
#
# A set of limits blocks where the step of most progress within them makes no more than within all. The limits
# with multipliers are such a set. A deletion filter (J. W. Chinneck, "Feasibility and Infeasibility in
# Optimization", 2008) leaves out what can be spared. Other sets may be smaller: of each set that does not
# block, a blocking one has a limit outside it. The smallest set that meets all these demands either blocks,
# and then none is smaller, or gives another demand (A. Ignatiev et al., "Smallest MUS extraction with minimal
# hitting set dualization", 2015).


def find_fewest_limits(program: Program, bound: Step) -> tuple[NDArray[np.int64], bool]:
    """Return the fewest limits that block a step as much as all limits."""
    most = bound.progress + max(SAME_PROGRESS, SAME_PART * bound.progress)
    rows = program.reachable_rows

    def find_free_step(selected: NDArray[np.bool_]) -> Step | None:
        """Return a step that makes more progress within some of `rows` than within all; None without one."""
        value = np.full(len(program.margins.value), np.inf)
        value[rows[selected]] = program.margins.value[rows[selected]]
        step = replace(program, margins=replace(program.margins, value=value)).find_bound(2.0 * most)
        return None if step is None or step.progress <= most else step

    # Spare limits one by one, those with the least weight first.
    fewest = np.isin(rows, bound.binding)
    if find_free_step(fewest) is not None:
        fewest[:] = True
    weight = np.zeros(len(program.margins.value))
    weight[bound.binding] = bound.multiplier * program.margins.size[bound.binding]
    for index in np.argsort(weight[rows], kind="stable"):
        if fewest[index]:
            fewest[index] = False
            fewest[index] = find_free_step(fewest) is not None
    # Look for a smaller set by demands that all blocking sets meet.
    demands = np.zeros((0, len(rows)))
    for _ in range(MAX_DEMANDS):
        chosen = _find_smallest(demands)
        if chosen.sum() >= fewest.sum():
            return rows[fewest], True
        step = find_free_step(chosen)
        if step is None:
            return rows[chosen], True
        # As many limits as still do not block: first all that the step keeps to.
        non_blocking = chosen | program.is_within(step.change)[rows]
        for index in np.flatnonzero(~non_blocking):
            non_blocking[index] = True
            non_blocking[index] = find_free_step(non_blocking) is not None
        demands = np.vstack([demands, ~non_blocking])
    return rows[fewest], False


def _find_smallest(demands: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the smallest choice (n,) with at least one in each of the demands (n_demands, n)."""
    count = demands.shape[1]
    if not len(demands):
        return np.zeros(count, dtype=bool)
    optimum = milp(
        np.ones(count),
        constraints=LinearConstraint(demands, lb=1.0),
        integrality=np.ones(count, dtype=np.int64),
        bounds=Bounds(0.0, 1.0),
    )
    return np.ones(count, dtype=bool) if optimum.x is None else np.asarray(optimum.x > 0.5)
