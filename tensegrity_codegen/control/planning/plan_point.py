"""The model of a plan: its actuators, equilibria with all that limits look at, and their derivatives."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from tensegrity_codegen.control.planning.targets import MovedBy, Targets
from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_finite, to_sized
from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
from tensegrity_codegen.runtime.sensitivity.static_system import factorise
from tensegrity_codegen.runtime.statics.constrained_problems import BarProblem, BodyProblem
from tensegrity_codegen.runtime.statics.equilibrium import build_problem
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem, find_neutral_motions
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, StructureError, check_choice

MAX_ITERATIONS = 12
RESIDUAL_TOLERANCE = 1e-9  # node residual over the largest member force
RESIDUAL_GOAL = 1e-12
ROUNDING = 8 * float(np.finfo(float).eps)
N_EIGENVECTORS = 6  # eigenvectors kept
STEP = 3e-6  # of the longest member: length of differences
STILL_PART = 1e-4  # of the way, by inputs as large as the longest member: a target that does not move
RANK = 1e-6  # of the largest singular value


@dataclass(frozen=True)
class Actuation:
    """The actuators that a plan moves."""

    actuators: tuple[Actuator, ...]  # with names, members, rates and ranges
    place: NDArray[np.int64]  # (n_actuators,): indices of their inputs
    rest_length: FloatArray  # (n_actuators,) [m]: rest length of the first member of each in the scene
    least_change: FloatArray  # (n_actuators,) [m]: bounds of their inputs, from the ranges of rest lengths
    most_change: FloatArray  # (n_actuators,) [m]
    rate: FloatArray  # (n_actuators,) [m/s]: largest rates

    @property
    def members(self) -> dict[str, tuple[int, ...]]:
        """Indices of the members of each actuator."""
        return {actuator.name: actuator.members for actuator in self.actuators}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actuators."""
        return tuple(actuator.name for actuator in self.actuators)


def require_actuators(subject: Structure | BodySystem | None, scene: str) -> tuple[Actuator, ...]:
    """Return the actuators of a scene of this name; raises StructureError if it has none."""
    if subject is None or not subject.actuators:
        raise StructureError(
            "no actuators",
            where=f"{scene}: actuators",
            given="none",
            allowed="at least one table [[actuators]] with a name and members",
            hint="add [[actuators]] to the scene, or let each cable have one: `actuate=cables`",
        )
    return subject.actuators


def find_actuation(model: Described, names: Sequence[str] | None = None) -> Actuation:
    """Return the actuators of a model that a plan moves."""
    structure = model.structure
    actuators = require_actuators(structure, model.manifest.name)
    assert structure is not None
    by_name = {actuator.name: actuator for actuator in actuators}
    check_instance([] if names is None else names, (list, tuple), "actuators", "a list of names")
    selected = list(by_name) if names is None else list(names)
    for name in selected:
        check_choice(name, by_name, "actuator", "actuators")
        if selected.count(name) > 1:
            raise InvalidValueError(
                "an actuator is named twice", where="actuators", given=name, allowed="each actuator once"
            )
    # Bounds of their inputs: the range less the rest lengths in the scene.
    chosen = tuple(by_name[name] for name in selected)
    initial = [np.array([structure.rest_length[e] for e in item.members]) for item in chosen]
    return Actuation(
        chosen,
        np.array([model.manifest.input_name.index(item.name) for item in chosen], dtype=np.int64),
        np.array([lengths[0] for lengths in initial]),
        np.array([item.range[0] - lengths.min() for item, lengths in zip(chosen, initial, strict=True)]),
        np.array([item.range[1] - lengths.max() for item, lengths in zip(chosen, initial, strict=True)]),
        np.array([item.rate for item in chosen]),
    )


@dataclass(frozen=True)
class MemberRanges:
    """A row for each actuator with a range and each of its members that the plan moves."""

    name: tuple[str, ...]  # names of the actuators
    member: NDArray[np.int64]  # (n,): members
    rest_length: FloatArray  # (n,) [m]: rest lengths of the members where the actuators of the plan are at 0
    least: FloatArray  # (n,) [m]: bounds of the rest lengths
    most: FloatArray  # (n,) [m]
    pull: FloatArray  # (n, n_actuators): 1 if an actuator of the plan moves the member

    def of_member(self, index: int) -> tuple[float, float]:
        """Return the least and the largest rest length that the ranges permit a member [m]."""
        rows = self.member == index
        return float(self.least[rows].max(initial=-np.inf)), float(self.most[rows].min(initial=np.inf))

    def of_actuators(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the inputs (n_actuators,) by members that one actuator alone moves [m]."""
        alone = self.pull[self.pull.sum(axis=1) == 1] > 0
        is_moved_alone = self.pull.sum(axis=1) == 1
        low, high = ((bound - self.rest_length)[is_moved_alone, None] for bound in (self.least, self.most))
        return (
            np.where(alone, low, -np.inf).max(axis=0, initial=-np.inf),
            np.where(alone, high, np.inf).min(axis=0, initial=np.inf),
        )


def find_member_ranges(
    structure: Structure | BodySystem, incidence: FloatArray, held: Mapping[str, float]
) -> MemberRanges:
    """Return the ranges of the members that the actuators of a plan move."""
    rest_length = add_inputs_to_rest_length(structure, held)
    rows = [
        (item, e)
        for item in structure.actuators
        for e in item.members
        if incidence[e].any() and (np.isfinite(item.range[0]) or np.isfinite(item.range[1]))
    ]
    member = np.array([e for _, e in rows], dtype=np.int64)
    return MemberRanges(
        tuple(item.name for item, _ in rows),
        member,
        rest_length[member],
        np.array([item.range[0] for item, _ in rows], dtype=float),
        np.array([item.range[1] for item, _ in rows], dtype=float),
        incidence[member],
    )


# Equilibria on a path, with all that limits look at.


@dataclass(frozen=True)
class PlanPoint:
    """An equilibrium: inputs, coordinates, the values that limits bound."""

    change: FloatArray  # (n_actuators,) [m]: values of the actuators' inputs
    coordinate: FloatArray  # (n_coordinates,): coordinates of the static problem, and of the model
    model_coordinate: FloatArray  # (n_coordinates,)
    position: FloatArray  # (n_nodes, 3) [m]: node positions
    point: Point  # energy, residual and tensions
    length: FloatArray  # (n_members,) [m]: member lengths
    distance: FloatArray  # (n_bar_pairs,) [m]: distances between bars
    # (k,) [N/m]: the smallest eigenvalues of the stiffness without neutral rigid motions
    eigenvalue: FloatArray
    eigenvector: FloatArray  # (n_directions, k): their unit vectors
    neutral: FloatArray  # (n_directions, m): orthonormal neutral rigid motions
    stiffness: Any  # (n_directions, n_directions) [N/m]: tangent stiffness

    @property
    def tension(self) -> FloatArray:
        """Member tensions, (n_members,) [N]."""
        return self.point.tension


class PlanModel:
    """A model whose actuators are moved, all other arguments fixed.

    model: compiled for ``"plan"``.
    arguments: inputs and parameters by name, if they differ from the scene.
    incidence (n_members, n_actuators): one if an actuator changes the rest length of a member.
    columns: members of each actuator, by name.
    has_pairs: whether distances between bars are known.
    """

    def __init__(
        self, model: CompiledModel, actuation: Actuation, arguments: Mapping[str, Any] | None = None
    ) -> None:
        self.model, self.actuation = model, actuation
        self._scale: FloatArray | None = None
        self.arguments = merge_inputs(model.manifest, arguments)
        base, nominal = self.arguments.get(INPUT), model.nominal(INPUT).ravel()
        self.base = nominal if base is None else to_sized(base, nominal.shape, f"arguments.{INPUT}").ravel()
        check_finite(self.base, f"arguments.{INPUT}")
        self.has_pairs = bool(model.manifest.bar_pair) and model.has("bar_distance")
        names = model.manifest.member_name
        self.columns = {
            actuator.name: tuple(names[e] for e in actuator.members) for actuator in actuation.actuators
        }
        self.incidence = np.zeros((len(names), len(self.columns)))
        for column, actuator in enumerate(actuation.actuators):
            self.incidence[list(actuator.members), column] = 1.0
        held = {
            name: float(value)
            for name, value in zip(model.manifest.input_name, self.base, strict=True)
            if name not in self.columns
        }
        assert model.structure is not None  # find_actuation refuses models without
        self.structure = model.structure
        self.ranges = find_member_ranges(self.structure, self.incidence, held)
        pulled = [actuator.members[0] for actuator in actuation.actuators]
        self._held_rest = add_inputs_to_rest_length(self.structure, held)[pulled]
        self._pull = self.incidence[pulled]

    def rest_length(self, change: FloatArray) -> FloatArray:
        """Return the total rest lengths (..., n_actuators) of the first member of each actuator [m]."""
        return np.asarray(self._held_rest + change @ self._pull.T)

    @property
    def start(self) -> FloatArray:
        """Values of the actuators' inputs in the scene or arguments, (n_actuators,) [m]."""
        return np.array(self.base[self.actuation.place])

    def to_search_coordinate(self, coordinate: FloatArray) -> FloatArray:
        """Return coordinates of the model as those of the static problems, and fix their scale for bodies."""
        problem = self.problem(self.start)
        entered = problem.to_search_coordinate(coordinate)
        if isinstance(problem, BodyProblem):
            self._scale = problem.scale
        return entered

    def scale(self, slope: FloatArray) -> FloatArray:
        """Return derivatives (n_coordinates, k) of coordinates of the model as of the static problems."""
        return slope if self._scale is None else np.asarray(self._scale[:, None] * slope)

    def directions(self, at: PlanPoint, columns: FloatArray) -> FloatArray:
        """Return directions (n_directions, k) of the static problem at a point as (n_coordinates, k)."""
        problem = self.problem(at.change)
        if isinstance(problem, BarProblem):
            return np.asarray(problem.directions(at.coordinate) @ columns)
        return columns

    def inputs(self, change: FloatArray) -> FloatArray:
        """Return all inputs of the model, (n_inputs,)."""
        values = self.base.copy()
        values[self.actuation.place] = change
        return values

    def problem(self, change: FloatArray) -> StaticProblem:
        """Return the static problem at these inputs."""
        problem = build_problem(self.model, {**self.arguments, INPUT: self.inputs(change)})
        if isinstance(problem, BodyProblem) and self._scale is not None:
            problem.scale = self._scale
        return problem

    def find_point(self, change: FloatArray, coordinate: FloatArray, reach: float) -> PlanPoint | None:
        """Return the equilibrium within `reach` [m] of predicted coordinates; None without one."""
        # Newton's method, until the residual is small enough or falls no further.
        problem = self.problem(change)
        point, best, floor = problem.find_point(coordinate), None, 0.0
        for _ in range(MAX_ITERATIONS):
            if point is None or np.abs(point.coordinate - coordinate).max(initial=0.0) > reach:
                return None
            if best is not None and _is_balanced(best, floor) and point.node_force > best.node_force / 4:
                break
            best = point
            if point.node_force <= RESIDUAL_GOAL * point.largest_force:
                break
            point, floor = self._iterate(problem, point)
        final = point if point is not None and best and point.node_force <= best.node_force else best
        if final is None or not _is_balanced(final, floor):
            return None
        return self.complete(problem, change, final)

    def _iterate(self, problem: StaticProblem, point: Point) -> tuple[Point | None, float]:
        """Return the point after one Newton step, and the residual that rounding explains [N]."""
        try:
            stiffness = problem.stiffness(point.coordinate)
        except NonFiniteError:
            return None, 0.0
        neutral = self.neutral(problem, point, stiffness)
        # What the rounding of the coordinates alone explains [N].
        distance = max(float(np.abs(point.coordinate).max(initial=0.0)), point.longest)
        floor = ROUNDING * distance * float(np.abs(stiffness.diagonal()).max(initial=0.0))
        rounding = float(np.finfo(float).eps) * float(abs(stiffness).sum(axis=0).max(initial=0.0))
        factors, _ = factorise(stiffness, sparse.csc_array(neutral.T), neutral, rounding)
        force = problem.directional_residual(point)[:, None]
        force = force - neutral @ (neutral.T @ force)
        step = factors.solve(force, np.zeros((neutral.shape[1], 1)))[0][:, 0]
        return problem.find_displaced_point(point.coordinate, step) if np.all(
            np.isfinite(step)
        ) else None, floor

    def neutral(self, problem: StaticProblem, point: Point, stiffness: Any) -> FloatArray:
        """Return the rigid motions that cost no force at a point, (n_directions, m)."""
        position = problem.node_position(point.coordinate)
        spread = float(np.linalg.norm(position - position.mean(axis=0)))
        turned = 10 * float(np.linalg.norm(point.residual)) / max(spread, 1e-300)
        return find_neutral_motions(stiffness, problem.rigid_motions(point.coordinate), turned)

    def complete(self, problem: StaticProblem, change: FloatArray, point: Point) -> PlanPoint:
        """Return a point of a static problem with all that limits look at."""
        stiffness = problem.stiffness(point.coordinate)
        neutral = self.neutral(problem, point, stiffness)
        value, vector = find_lowest(stiffness, neutral)
        none = np.zeros(0)
        distance = np.asarray(problem.compute("bar_distance", point.coordinate)) if self.has_pairs else none
        return PlanPoint(
            change.copy(),
            point.coordinate,
            problem.to_model_coordinate(point.coordinate),
            problem.node_position(point.coordinate),
            point,
            np.array(problem.compute("member_length", point.coordinate)),
            distance.copy(),
            value,
            vector,
            neutral,
            stiffness,
        )


def _is_balanced(point: Point, floor: float) -> bool:
    return point.node_force <= max(RESIDUAL_TOLERANCE * point.largest_force, floor)


def find_lowest(stiffness: Any, neutral: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest eigenvalues [N/m] and their vectors over the directions orthogonal to `neutral`."""
    matrix = stiffness.toarray()
    matrix = (matrix + matrix.T) / 2
    if neutral.shape[1]:
        matrix = matrix + 2 * float(np.abs(matrix).sum(axis=0).max(initial=0.0)) * (neutral @ neutral.T)
    value, vector = np.linalg.eigh(matrix)
    count = min(N_EIGENVECTORS, max(len(value) - neutral.shape[1], 0))
    return value[:count], vector[:, :count]


# How an equilibrium follows the actuators: tensions, lengths, distances between bars, targets, stiffness.


@dataclass(frozen=True)
class Slopes:
    """Derivatives of an equilibrium with respect to the actuators' inputs, one column each."""

    coordinate: FloatArray  # (n_coordinates, n_actuators): of the coordinates
    # tension, length, extension (n_members, n_actuators) [N/m, 1, 1]: of tensions, lengths, and lengths minus
    # rest lengths of the members
    tension: FloatArray
    length: FloatArray
    extension: FloatArray
    distance: FloatArray  # (n_bar_pairs, n_actuators): of the distances between bars
    target: FloatArray  # (n_targets, n_actuators): of the target values
    # (k, n_actuators) [N/m2]: of the smallest eigenvalues; (0, n_actuators) unless asked for, and with rigid
    # bars
    eigenvalue: FloatArray


def compute_slopes(
    plan_model: PlanModel, at: PlanPoint, targets: Targets, *, with_stiffness: bool = False
) -> Slopes:
    """Return the derivatives of an equilibrium with respect to the actuators' inputs.

    dq/du and dt/du by equilibrium_sensitivity; distances between bars, expressions and eigenvalues, as
    v^T K v at constant v, by central differences along (dq/du, du).
    """
    manifest = plan_model.model.manifest
    arguments = {**plan_model.arguments, INPUT: plan_model.inputs(at.change)}
    # Coordinates, tensions and lengths, by the stiffness of the equilibrium.
    sensitivity = equilibrium_sensitivity(
        plan_model.model, at.model_coordinate, arguments, columns=plan_model.columns
    )
    strands = manifest.strands
    unit, _ = strands.directions(at.position)
    separation = sensitivity.node[strands.ends[:, 0]] - sensitivity.node[strands.ends[:, 1]]
    length = strands.add_up(np.einsum("ea,eak->ke", unit, separation)).T
    count = len(at.change)

    def move(column: int, step: float) -> tuple[StaticProblem, FloatArray]:
        change = at.change.copy()
        change[column] += step
        return plan_model.problem(change), at.coordinate + step * moving[:, column]

    moving = plan_model.scale(sensitivity.coordinate)
    # Distances between bars and eigenvalues, by differences.
    step = STEP * at.point.longest
    distance, eigenvalue = np.zeros((0, count)), np.zeros((0, count))
    if plan_model.has_pairs:
        distance = _difference_along(lambda problem, q: problem.compute("bar_distance", q), move, count, step)
    if with_stiffness and len(at.eigenvector) == len(at.coordinate):
        vector = at.eigenvector
        eigenvalue = _difference_along(
            lambda problem, q: np.einsum("ik,ik->k", vector, problem.stiffness(q) @ vector), move, count, step
        )
    return Slopes(
        moving,
        sensitivity.tension,
        length,
        length - plan_model.incidence,
        distance,
        targets.slopes(at.position, sensitivity.node, move, step),
        eigenvalue,
    )


def _difference_along(
    compute: Callable[[StaticProblem, FloatArray], FloatArray], move: MovedBy, count: int, step: float
) -> FloatArray:
    """Return the derivatives of an array along (dq/du, du), (n, count), by central differences."""
    columns = []
    for k in range(count):
        plus, minus = (np.array(compute(*move(k, sign * step))) for sign in (1, -1))
        columns.append((plus - minus) / (2 * step))
    return np.array(columns).T


def describe_immobility(
    names: Sequence[str], slope: FloatArray, direction: FloatArray, longest: float
) -> str:
    """Return why no change of the inputs moves targets along a direction, to first order."""
    effect = np.abs(slope).sum(axis=1) * longest
    still = effect <= STILL_PART * np.abs(direction)
    if np.any(still & (direction != 0)):
        who = ", ".join(name for name, is_still in zip(names, still, strict=True) if is_still)
        return f"no actuator changes {who} here, to first order: plan another target, or start elsewhere"
    moving = effect > 0
    scaled = slope[moving] / effect[moving, None]
    values = np.linalg.svd(scaled, compute_uv=False) if scaled.size else np.zeros(0)
    rank = int(np.sum(values > RANK * values.max(initial=0.0)))
    total, count = slope.shape
    if rank < total:
        return (
            f"the targets have {total} components ({', '.join(names)}), and the actuators ({count}) change "
            f"only {rank} of them independently here: no change of the rest lengths moves all targets along "
            "their way; use more actuators or fewer targets"
        )
    return (
        "no change of the rest lengths within a step moves the target along its way: use fewer steps "
        "(`steps`), or a nearer target"
    )
