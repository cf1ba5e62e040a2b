"""Paths through equilibria: their points, of a plan or of arrays, and the smooth path through them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint, find_actuation
from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape, to_doubles, to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, UnstableError
from tensegrity_codegen.system.summaries import Summarised

POINT_REACH = 1e-4  # of the longest member: how far given coordinates may be from the equilibrium
STEP_REACH = 0.1  # of the longest member: of one step from equilibrium to equilibrium
MIN_STEP = 1e-4  # of the whole way: shorter ones are not tried
N_STEPS = 16  # of the whole way between equilibria, where nothing makes them shorter
SPLINE_TOLERANCE = 1e-8  # of the longest member: distance of the spline from equilibria that counts as none
MAX_ROUNDS, MAX_KNOTS = 6, 1000
MIN_REACH = 1e-3  # of the longest member: least distance in which an equilibrium is searched


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumPath(Summarised):
    """Equilibria one after the other, from the start to the end of a motion, for `time_motion`.

    Attributes
    ----------
    change : array_like, shape (n_points, n_actuators) [m]
        Values of the actuators' inputs at two points or more, as `simulate` takes them.
    coordinate : array_like, shape (n_points, n_coordinates), optional
        Coordinates of the model at these points; by default they are found, from those of the scene on.
    progress : array_like, shape (n_points,), optional
        From 0 to 1, rising; by default the distance that nodes (without coordinates: inputs) have moved.
    actuators : tuple of str, optional
        Names of the actuators; by default all of the scene.
    """

    change: ArrayLike
    coordinate: ArrayLike | None = None
    progress: ArrayLike | None = None
    actuators: tuple[str, ...] | None = None


# The equilibria of a path that is put in time: of a plan, or of arrays.


@dataclass(frozen=True)
class PathKnots:
    """Equilibria on a path."""

    progress: FloatArray  # (n,): from 0 to 1
    change: FloatArray  # (n, n_actuators) [m]
    point: tuple[PlanPoint, ...]  # (n,): the equilibria


def find_knots(
    model: CompiledModel, path: PlanResult | EquilibriumPath, arguments: Mapping[str, Any] | None
) -> tuple[PlanModel, PathKnots]:
    """Return the model with the actuators of a path, and the equilibria of the path."""
    if isinstance(path, PlanResult):
        path = _read_plan(model, path)
    if not isinstance(path, EquilibriumPath):
        raise InvalidValueError(
            "not a path", where="path", given=path, allowed="a PlanResult of plan(), or an EquilibriumPath"
        )
    plan_model = PlanModel(model, find_actuation(model, path.actuators), arguments)
    check_shape(plan_model.base, (len(model.manifest.input_name),), "arguments.input")
    check_finite(plan_model.base, "arguments.input")
    change = _read_rows(path.change, len(plan_model.columns), "path.change")
    if path.coordinate is None:
        return plan_model, _follow_inputs(plan_model, change, path.progress)
    count = len(model.manifest.coordinate_name)
    coordinate = _read_rows(path.coordinate, count, "path.coordinate")
    check_shape(coordinate, (len(change), count), "path.coordinate")
    points = tuple(
        _check_point(plan_model, k, *row) for k, row in enumerate(zip(change, coordinate, strict=True))
    )
    moved = np.diff([point.position for point in points], axis=0).reshape(len(points) - 1, -1)
    return plan_model, PathKnots(_read_progress(path.progress, moved, change), change, points)


def _read_plan(model: CompiledModel, plan: PlanResult) -> EquilibriumPath:
    if not plan.is_found or plan.n_steps == 0:
        raise InvalidValueError(
            "the plan has no path to its target" if not plan.is_found else "the plan has no motion",
            where="path",
            given=f"status {plan.status!r}, {plan.n_steps} steps",
            allowed="a plan of status 'found' with one step or more",
            hint="make another plan, or time a part of it: EquilibriumPath(found.change, found.coordinate)",
        )
    if plan.coordinate.shape[1] != len(model.manifest.coordinate_name):
        raise InvalidValueError(
            "the plan was made with another model",
            where="path",
            given=f"{plan.coordinate.shape[1]} coordinates",
            allowed=f"{len(model.manifest.coordinate_name)} coordinates, as of {model.manifest.name}",
        )
    return EquilibriumPath(plan.change, plan.coordinate, plan.progress, plan.actuator_name)


def _read_rows(value: ArrayLike, width: int, where: str) -> FloatArray:
    """Return (n_points, width) finite numbers of two points or more."""
    allowed = f"numbers of shape (n_points, {width}), two points or more"
    rows = to_doubles(value, where, allowed)
    if rows.ndim != 2 or rows.shape[1] != width or len(rows) < 2:
        raise InvalidValueError("wrong shape", where=where, given=rows.shape, allowed=allowed)
    check_finite(rows, where)
    return rows


def _read_progress(value: ArrayLike | None, moved: FloatArray, change: FloatArray) -> FloatArray:
    """Return progress (n_points,) from 0 to 1: as given, else of the distances moved, else of the inputs."""
    if value is not None:
        progress = to_sized(value, (len(change),), "path.progress").ravel()
        check_finite(progress, "path.progress")
        if progress[0] != 0.0 or progress[-1] != 1.0 or np.any(np.diff(progress) <= 0):
            raise InvalidValueError(
                "the progress does not rise from 0 to 1", where="path.progress", given=progress.tolist(),
                allowed="0 at the first point, 1 at the last one, rising in between",
            )  # fmt: skip
        return progress
    way = np.linalg.norm(moved, axis=1)
    if not way.all():
        way = np.linalg.norm(np.diff(change, axis=0), axis=1)
    if not way.all():
        k = int(np.argmin(way))
        raise InvalidValueError(
            "two points in a row are the same", where="path.change", given=f"points {k} and {k + 1}",
            allowed="points that differ",
        )  # fmt: skip
    sums = np.concatenate([[0.0], np.cumsum(way)])
    return np.asarray(sums / sums[-1])


def _check_point(plan_model: PlanModel, k: int, change: FloatArray, coordinate: FloatArray) -> PlanPoint:
    """Return the equilibrium at given coordinates; raises InvalidValueError if they are none."""
    problem = plan_model.problem(change)
    point = problem.find_point(coordinate)
    longest = 1.0 if point is None else point.longest
    at = plan_model.find_point(change, coordinate, POINT_REACH * longest)
    if at is None:
        force = (
            "forces that are not finite" if point is None else f"a node residual of {point.node_force:.6g} N"
        )
        raise InvalidValueError(
            f"point {k} of the path is no equilibrium",
            where="path",
            given=force,
            allowed=f"coordinates within {POINT_REACH * longest:.3g} m of an equilibrium with these inputs",
            hint="pass the arguments (loads, other inputs) that the path was made with",
        )
    return at


def _follow_inputs(plan_model: PlanModel, change: FloatArray, progress: ArrayLike | None) -> PathKnots:
    """Return the equilibria along straight lines of the inputs, in steps short enough for Newton's method."""
    at = _find_first(plan_model, change[0])
    way = np.diff(change, axis=0)
    knot_progress = _read_progress(progress, way, change)
    knots, inputs, points = [0.0], [change[0]], [at]
    for k, step in enumerate(way):
        now, fraction = 0.0, min(1.0, 1.0 / (N_STEPS * (knot_progress[k + 1] - knot_progress[k])))
        while now < 1.0:
            fraction = min(fraction, 1.0 - now)
            next_change = change[k + 1] if now + fraction >= 1.0 else change[k] + (now + fraction) * step
            # The stable equilibrium near the last one, by shorter steps if there is none.
            reach = STEP_REACH * points[-1].point.longest
            equilibrium = plan_model.find_point(next_change, points[-1].coordinate, reach)
            if equilibrium is None or (len(equilibrium.eigenvalue) and not equilibrium.eigenvalue[0] > 0):
                fraction /= 2
                if fraction * (knot_progress[k + 1] - knot_progress[k]) < MIN_STEP:
                    raise ConvergenceError(
                        "no stable equilibrium continues the path",
                        evidence={
                            "point": k,
                            "progress": knot_progress[k] + now * (knot_progress[k + 1] - knot_progress[k]),
                        },
                        where=plan_model.model.manifest.name,
                        hint="give points nearer to each other, with coordinates, or use plan()",
                    )
                continue
            now = 1.0 if now + fraction >= 1.0 else now + fraction
            knots.append(knot_progress[k] + now * (knot_progress[k + 1] - knot_progress[k]))
            inputs.append(next_change)
            points.append(equilibrium)
    knots[-1] = 1.0
    return PathKnots(np.array(knots), np.array(inputs), tuple(points))


def _find_first(plan_model: PlanModel, change: FloatArray) -> PlanPoint:
    """Return the equilibrium that is found from the coordinates of the scene."""
    inputs = {**plan_model.arguments, "input": plan_model.inputs(change)}
    equilibrium = find_equilibrium(plan_model.model, arguments=inputs)
    at = plan_model.find_point(change, equilibrium.coordinate, STEP_REACH * float(equilibrium.extent))
    if at is None:
        raise ConvergenceError(
            "no equilibrium at the first point of the path",
            evidence={"residual": equilibrium.residual},
            where=plan_model.model.manifest.name,
            hint="give coordinates of the points, or anchor nodes that nothing holds",
        )
    return at


# A path through equilibria as a function of progress, with continuous second derivatives.
#
# Inputs are the cubic spline through the points of the path. Coordinates are the cubic spline through these
# points and the equilibria in between, which are added until the spline meets the equilibria.


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """Inputs, coordinates and tensions over progress s from 0 to 1.

    change, coordinate, tension: of the actuators' inputs (n_actuators,) [m], coordinates (n_coordinates,),
        tensions (n_members,) [N].
    knots (n,): progress of the equilibria.
    error [m]: largest distance of a node between the splines and the equilibria halfway between knots.
    """

    change: CubicSpline
    coordinate: CubicSpline
    tension: CubicSpline
    knots: FloatArray
    error: float


def build_smooth_path(plan_model: PlanModel, knots: PathKnots) -> SmoothPath:
    """Return the path through equilibria."""
    # The inputs, and the equilibria that are known.
    change = CubicSpline(knots.progress, knots.change)
    equilibria = dict(zip(knots.progress.tolist(), knots.point, strict=True))
    for s, at in equilibria.items():
        _check_stable(plan_model, s, at)
    # Equilibria halfway, until the spline of the coordinates meets them.
    open_, error = list(zip(knots.progress[:-1].tolist(), knots.progress[1:].tolist(), strict=True)), 0.0
    for _ in range(MAX_ROUNDS):
        progress = np.array(sorted(equilibria))
        coordinate = CubicSpline(progress, [equilibria[s].coordinate for s in progress])
        halves, error = [], 0.0
        for low, high in open_ if len(equilibria) + len(open_) <= MAX_KNOTS else []:
            middle = (low + high) / 2
            off = _add_equilibrium(plan_model, equilibria, change, coordinate, middle, (low, high))
            error = max(error, off)
            if off > SPLINE_TOLERANCE * equilibria[low].point.longest:
                halves += [(low, middle), (middle, high)]
        open_ = halves
        if not halves:
            break
    progress = np.array(sorted(equilibria))
    return SmoothPath(
        change,
        CubicSpline(progress, [equilibria[s].coordinate for s in progress]),
        CubicSpline(progress, [equilibria[s].tension for s in progress]),
        progress,
        error,
    )


def _add_equilibrium(
    plan_model: PlanModel,
    equilibria: dict[float, PlanPoint],
    change: CubicSpline,
    coordinate: CubicSpline,
    s: float,
    ends: tuple[float, float],
) -> float:
    """Add the equilibrium at progress s; return how far the spline is from it [m]."""
    low, high = (equilibria[end] for end in ends)
    predicted, inputs = np.asarray(coordinate(s)), np.asarray(change(s))
    moved = float(np.abs(high.coordinate - low.coordinate).max(initial=0.0))
    at = plan_model.find_point(inputs, predicted, moved / 2 + MIN_REACH * low.point.longest)
    if at is None:
        raise ConvergenceError(
            "no equilibrium continues the path between two points",
            evidence={"progress": s, "between": f"{ends[0]:.6g} and {ends[1]:.6g}"},
            where=plan_model.model.manifest.name,
            hint="give points nearer to each other: `plan SCENE --steps 100 --out plan.npz`, then "
            "`plan=plan.npz`",
        )
    _check_stable(plan_model, s, at)
    equilibria[s] = at
    position = plan_model.problem(inputs).node_position(predicted)
    return float(np.linalg.norm(position - at.position, axis=1).max(initial=0.0))


def _check_stable(plan_model: PlanModel, s: float, at: PlanPoint) -> None:
    if len(at.eigenvalue) and at.eigenvalue[0] <= 0:
        raise UnstableError(
            "the path leads through an unstable equilibrium",
            where=plan_model.model.manifest.name,
            evidence={"progress": s, "smallest_eigenvalue": float(at.eigenvalue[0])},
            hint="give a path through stable equilibria, as plan() finds them",
        )
