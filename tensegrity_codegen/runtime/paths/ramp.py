"""Loads that grow from a base to their full size, followed as far as the structure is stable."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import STABILITY_LOSS_EVENTS, LoadPath
from tensegrity_codegen.runtime.paths.model_path import ModelPath, build_path
from tensegrity_codegen.runtime.paths.watches import watch_slack, watch_switch
from tensegrity_codegen.runtime.statics.equilibrium import build_problem, find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.newton import find_stability
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem, build_rigid_motions
from tensegrity_codegen.system.arrays import FloatArray

TRIAL_MOTION_RATIO = 0.1  # of the structure's size: trial motion, after which forces are computed
ZERO_FORCE_TOLERANCE = 1e-7  # part of the forces along rigid motions that counts as none
MAX_FOLLOWED = 3000  # coordinates up to which a path is followed
MAX_STEPS = 300  # of small structures
MAX_WORK = 30_000  # steps times coordinates of large ones
LARGEST_STEP, COARSE_STEP = 0.1, 0.25  # of small and of large structures
FINEST_COARSE_STEP = 1e-5
# Of the loads, by which a structure without stiffness is pushed to see where it goes.
FIRST_LOAD_FACTOR = 1e-4
# Motion, as part of the structure's size, that counts as a collapse under the first part.
COLLAPSE_MOTION_RATIO = 0.1
BALANCE_TOLERANCE = 1e-9  # of the largest member force
# Part of the smallest eigenvalue at the start that counts as none if a path stalls.
ZERO_EIGENVALUE_RATIO = 1e-3
# Load factors of the way back: from the second to the last the distance from the start falls to a half
# at least, or to this part of the largest distance, beside a part of the coordinates.
RETURN_FACTORS, RETURN_TOLERANCE, RETURN_ROUNDING = (1.0, 1e-2, 1e-4), 1e-2, 1e-7
END_DISTANCE = 1e-5  # distance from the full load at which a loss of stability may be one of the end itself
# Motion, as part of the structure's size, up to which the end is where stability was lost.
MAX_END_MOTION_RATIO = 1e-3


class PinnedPath:
    """The equilibria of a path with the rigid motions held that its anchors permit.

    With N an orthonormal basis of these motions at the start and P = 1 - N N^T,

        g_pinned(q, lambda) = P g(q, lambda),   N^T dq = 0

    The pins carry moments of the loads; they carry nothing where all forces are internal, so that the ends
    of the path are equilibria of the structure itself.
    """

    def __init__(self, path: ModelPath, start: FloatArray) -> None:
        self.path, self.start = path, start
        self.basis = build_rigid_motions(path.model.manifest, place_nodes(path.model, start))

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return P g, (n,)."""
        return self._project(self.path.residual(coordinate, load_factor))

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return K of the path itself, (n, n); it is used beside the pinned motions only."""
        return self.path.stiffness(coordinate, load_factor)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return P f, (n,)."""
        return self._project(self.path.load_vector(coordinate, load_factor))

    def motions(self, coordinate: FloatArray, stiffness: Any = None) -> FloatArray:
        """Return the pinned motions N, (n, k), whatever stiffness the loads give them."""
        del coordinate, stiffness
        return self.basis

    def move_to_pins(self, coordinate: FloatArray) -> FloatArray:
        """Return the nearest coordinates that the pins let the structure reach from its start."""
        return np.asarray(coordinate - self.basis @ (self.basis.T @ (coordinate - self.start)))

    def _project(self, force: FloatArray) -> FloatArray:
        return np.asarray(force - self.basis @ (self.basis.T @ force))


def pin_path(path: ModelPath, start: FloatArray) -> PinnedPath | None:
    """Return the path with its rigid motions held; None without such motions, or with forces along them."""
    if not path.model.manifest.coordinate_node_axis:
        return None
    pinned = PinnedPath(path, start)
    rigid_motions = pinned.basis
    if rigid_motions.shape[1] == 0:
        return None
    # Move the structure as a whole, by a trial motion of all rigid motions together.
    position = place_nodes(path.model, start)
    size = float(np.ptp(position, axis=0).max(initial=0.0)) * np.sqrt(len(position))
    moved = start + TRIAL_MOTION_RATIO * size * rigid_motions.sum(axis=1) / rigid_motions.shape[1]
    # Forces between its own members have no component along rigid motions there either.
    force = path.static_force(moved, 1.0)
    force_along = np.linalg.norm(PinnedPath(path, moved).basis.T @ force)
    return pinned if force_along <= ZERO_FORCE_TOLERANCE * np.linalg.norm(force) else None


@dataclass(frozen=True)
class Way:
    """The end of growing loads."""

    coordinate: FloatArray = field(default_factory=lambda: np.zeros(0))  # (n,), where they lead to
    member_length: FloatArray = field(default_factory=lambda: np.zeros(0))
    node_position: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    limit: float | None = None  # load factor beyond which they do not lead
    failed: bool = False  # the path was not followed
    message: str = ""  # why, or what happened at the limit


class Ramp:
    """Loads base + lambda pattern of one model, by names of arguments; other arguments stay as given."""

    def __init__(
        self,
        model: Model,
        base: Mapping[str, FloatArray],
        pattern: Mapping[str, FloatArray],
        cables: Sequence[str] = (),
        arguments: Mapping[str, Any] | None = None,
    ) -> None:
        self.model, self.base, self.pattern = model, dict(base), dict(pattern)
        self.cables = tuple(cables)
        self.arguments = dict(arguments or {})

    def arguments_at(self, load_factor: float) -> dict[str, Any]:
        """Return all arguments at a load factor, by name."""
        grown = {name: self.base[name] + load_factor * value for name, value in self.pattern.items()}
        return {**self.arguments, **self.base, **grown}

    def settle(self, start: FloatArray, near: FloatArray) -> Way:
        """Return where prestress leads from `start` as balancing loads are let go; near: the end's guess."""
        problem = build_problem(self.model, self.arguments_at(0.0))
        point = problem.find_point(problem.to_search_coordinate(start))
        if point is None:
            return Way(failed=True, message="the forces at the start are not finite")
        floor = problem.rounding_floor(problem.stiffness(point.coordinate), point)
        if point.is_balanced(BALANCE_TOLERANCE, floor):
            if find_stability(problem, point).is_unstable:
                return Way(
                    limit=0.0, message="the given shape is in an unstable equilibrium before any load acts"
                )
            length = np.array(problem.compute("member_length", point.coordinate))
            position = problem.node_position(point.coordinate)
            return Way(problem.to_model_coordinate(point.coordinate), length, position)
        if "node_load" not in self.pattern:
            return Way(
                failed=True,
                message="the start is not in equilibrium without loads, and no node loads can balance it",
            )
        held = _find_holding_loads(self.model, problem, point, self.arguments_at(0.0))
        arguments = self.arguments_at(0.0)
        arguments["node_load"] = arguments["node_load"] + held
        path = build_path(self.model, -held, arguments)
        begun = problem.to_model_coordinate(point.coordinate)
        way = self._lead_back(path, begun, near)
        return self._follow(path, begun, 0.0, "prestress") if way is None else way

    def follow(self, start: FloatArray) -> Way:
        """Return where the loads lead from `start`, an equilibrium under the base."""
        problem = build_problem(self.model, self.arguments_at(0.0))
        point = problem.find_point(problem.to_search_coordinate(start))
        if point is None:
            return Way(failed=True, message="the forces at the start are not finite")
        # A start that is unstable, or has no stiffness until a first load pushes it.
        stability = find_stability(problem, point)
        if stability.is_unstable:
            return Way(limit=0.0, message="the structure is in an unstable equilibrium before the loads act")
        lower = 0.0
        if stability.is_neutral or stability.neutral_motions:
            pushed = find_equilibrium(
                self.model,
                arguments=self.arguments_at(FIRST_LOAD_FACTOR),
                coordinate=start,
                raise_on_failure=False,
            )
            if pushed.status == "unstable":
                state = f"in an unstable equilibrium under {FIRST_LOAD_FACTOR:g} of the loads"
                return Way(limit=0.0, message=f"the structure is {state}")
            if not pushed.is_found:
                return Way(
                    failed=True,
                    message=f"no equilibrium under {FIRST_LOAD_FACTOR:g} of the loads: {pushed.message}",
                )
            if pushed.change > COLLAPSE_MOTION_RATIO * pushed.extent:
                moved = f"node {pushed.changed_node} by {pushed.change:.6g} m"
                return Way(limit=0.0, message=f"{FIRST_LOAD_FACTOR:g} of the loads move {moved}")
            start, lower = pushed.coordinate, FIRST_LOAD_FACTOR
        path = build_path(self.model, self.pattern, self.arguments_at(0.0))
        has_weight = bool(np.any(self.pattern.get("gravity", 0.0)))
        return self._follow(path, start, lower, "load and weight" if has_weight else "load")

    def _follow(self, path: ModelPath, start: FloatArray, least: float, growing: str = "load") -> Way:
        """Return the end of a path of stable equilibria."""
        if len(start) > MAX_FOLLOWED:
            return Way(failed=True, message=f"more than {MAX_FOLLOWED} coordinates: the path is not followed")
        pinned = pin_path(path, start) if growing == "prestress" else None
        way = self._trace(path, pinned, start, (least, 1.0))
        return _judge(path, way, growing)

    def _lead_back(self, path: ModelPath, start: FloatArray, near: FloatArray) -> Way | None:
        """Return the end of a path that leads back to `start`, which has no stiffness, or None."""
        if path.memory is not None or len(start) > MAX_FOLLOWED:
            return None
        end = _find_equilibrium(path, 1.0, near)
        if not end.is_found:
            return None
        pinned, coordinate = pin_path(path, start), end.coordinate
        if pinned is not None:
            coordinate = pinned.move_to_pins(coordinate)
        distance = []
        for span in pairwise(RETURN_FACTORS):
            way = self._trace(path, pinned, coordinate, span)
            if way.status != "completed" or _find_unstable(path, way) is not None:
                return None
            coordinate = way.coordinate[-1]
            distance.append(np.abs(coordinate - start))
        largest = max(float(distance[0].max()), float(np.abs(start).max()) * RETURN_ROUNDING)
        if (distance[1] > np.maximum(distance[0] / 2, RETURN_TOLERANCE * largest)).any():
            return None
        return Way(end.coordinate, np.asarray(end.member_length), end.node_position)

    def _trace(
        self, path: ModelPath, pinned: PinnedPath | None, start: FloatArray, span: tuple[float, float]
    ) -> LoadPath:
        """Return the path between two load factors, as far as it is stable."""
        large = len(start) > DENSE_LIMIT
        control = StepControl(
            largest=COARSE_STEP if large else LARGEST_STEP,
            smallest=FINEST_COARSE_STEP if large else StepControl.smallest,
            most_steps=max(20, MAX_WORK // len(start)) if large else MAX_STEPS,
        )
        return follow_path(
            pinned or path,
            start,
            least=span[0],
            most=span[1],
            watches=[*([watch_slack(path, self.cables)] if self.cables else []), *watch_switch(path)],
            neutral=pinned.motions if pinned else path.neutral_motions(),
            control=control,
            stop_at=STABILITY_LOSS_EVENTS,
        )


def _find_equilibrium(path: ModelPath, load_factor: float, start: FloatArray) -> Equilibrium:
    """Return the equilibrium at a load factor near a start (n,); its status tells whether there is one."""
    arguments = path.static_arguments(load_factor)
    return find_equilibrium(path.model, arguments=arguments, coordinate=start, raise_on_failure=False)


def find_pushed_start(path: ModelPath, start: FloatArray, most: float) -> tuple[FloatArray, float] | None:
    """Return (n,) and load factor where the path of a structure without stiffness begins; None if far."""
    load_factor = FIRST_LOAD_FACTOR * most
    pushed = _find_equilibrium(path, load_factor, start)
    is_near = pushed.is_found and pushed.change <= COLLAPSE_MOTION_RATIO * pushed.extent
    return (pushed.coordinate, load_factor) if is_near else None


def _find_unstable(path: ModelPath, way: LoadPath) -> float | None:
    """Return the load factor of the first point of a path with a negative stiffness, None without one."""
    for coordinate, load_factor, lowest in zip(
        way.coordinate, way.load_factor.tolist(), way.smallest_eigenvalue.tolist(), strict=True
    ):
        if lowest < 0.0 and lowest < -_bound_rounding(path, coordinate, load_factor):
            return float(load_factor)
    return None


def _bound_rounding(path: ModelPath, coordinate: FloatArray, load_factor: float) -> float:
    """Return the size of eigenvalues of the stiffness that count as zero [N/m]."""
    stiffness = path.stiffness(coordinate, load_factor)
    return SINGULAR_TOLERANCE * float(abs(stiffness).sum(axis=0).max(initial=0.0))


def _is_singular(path: ModelPath, way: LoadPath) -> bool:
    """Return whether the stiffness at the end of a path is singular to rounding, which ends the search."""
    if not len(way.load_factor):
        return False
    rounding = _bound_rounding(path, way.coordinate[-1], float(way.load_factor[-1]))
    return float(way.smallest_eigenvalue[-1]) <= max(
        rounding, ZERO_EIGENVALUE_RATIO * float(way.smallest_eigenvalue[0])
    )


def _judge(path: ModelPath, way: LoadPath, growing: str) -> Way:
    """Return where a path of stable equilibria ended."""
    if way.status == "stopped":
        event = way.find_events(*STABILITY_LOSS_EVENTS)[0]
        end = _find_end(path, way) if abs(event.load_factor - 1.0) <= END_DISTANCE else None
        if end is not None:
            return end
        rounding = _bound_rounding(path, way.coordinate[0], float(way.load_factor[0]))
        if event.load_factor <= FIRST_LOAD_FACTOR and abs(way.smallest_eigenvalue[0]) <= rounding:
            return Way(failed=True, message="the stiffness along some motion is zero at the start")
        return Way(limit=event.load_factor, message=_describe_loss(event.kind, event.load_factor, growing))
    unstable = _find_unstable(path, way)
    if unstable is not None:
        return Way(
            limit=unstable, message=f"the path of the increasing {growing} is unstable at {unstable:.6g}"
        )
    if way.status == "stalled" and way.load_factor[-1] > FIRST_LOAD_FACTOR and _is_singular(path, way):
        reached = float(way.load_factor[-1])
        return Way(limit=reached, message=_describe_loss("singular", reached, growing))
    if way.status != "completed":
        return Way(failed=True, message=way.message)
    end = way.coordinate[-1]
    length = np.asarray(path.compute("member_length", end, 1.0))
    arguments = {**path.arguments, **path.loads(1.0)}
    position = place_nodes(path.model, end, path.arguments.get("anchor_position"), arguments=arguments)
    return Way(end, length, position)


def _find_end(path: ModelPath, way: LoadPath) -> Way | None:
    """Return the end of a path that seems to lose its stability just there; None if it does.

    A free structure held by loads resists rotation until they are gone: its rotations become neutral at the
    end, and rounding decides on which side of it their eigenvalues cross zero.
    """
    equilibrium = _find_equilibrium(path, 1.0, way.coordinate[-1])
    if not equilibrium.is_found or equilibrium.change > MAX_END_MOTION_RATIO * equilibrium.extent:
        return None
    return Way(
        np.asarray(equilibrium.coordinate), np.asarray(equilibrium.member_length), equilibrium.node_position
    )


def _describe_loss(kind: str, load_factor: float, growing: str) -> str:
    load = f"{load_factor:.6g} of its full size"
    if kind == "limit":
        return f"the path of the increasing {growing} turns back at {load}"
    if kind == "bifurcation":
        return f"the path of the increasing {growing} becomes unstable at a bifurcation, at {load}"
    if kind == "singular":
        return f"the stiffness along one motion vanishes under the increasing {growing}, at {load}"
    return (
        f"the path of the increasing {growing} becomes unstable where a cable goes slack or taut, at {load}"
    )


def _find_holding_loads(
    model: Model, problem: StaticProblem, point: Point, arguments: Mapping[str, Any]
) -> FloatArray:
    """Return the least node loads that hold the structure where it is, in the shape of node_load [N]."""
    manifest = model.manifest
    held = np.zeros((len(manifest.node_name), len(manifest.axes)))
    if manifest.coordinate_node_axis:
        column = {axis: k for k, axis in enumerate(manifest.axes)}
        for (node, axis), force in zip(manifest.coordinate_node_axis, point.residual, strict=True):
            held[node, column[axis]] = -force
    else:
        jacobian = np.asarray(problem.compute("node_jacobian", point.coordinate).toarray())
        force = np.asarray(problem.compute(problem.residual_quantity, point.coordinate))
        held.ravel()[:] = -np.linalg.lstsq(jacobian.T, force, rcond=None)[0]
    rows = [manifest.node_name.index(name) for name in manifest.argument("node_load").over]
    return held[rows]
