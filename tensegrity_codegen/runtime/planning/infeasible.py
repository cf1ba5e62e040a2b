"""Proofs that no plan exists: certificates of shapes, and targets that limits of one member contradict."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import NonFiniteError
from tensegrity_codegen.runtime.analysis.certificate import Certificate, find_certificate
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tensegrity_codegen.runtime.planning.limits import PlanLimits
from tensegrity_codegen.runtime.planning.plan_point import PlanModel
from tensegrity_codegen.runtime.planning.targets.targets import Targets
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, StaticProblem

__all__ = ["Contradiction", "find_contradiction", "find_fixed_shape", "find_shape_certificate"]

FloatArray = NDArray[np.float64]

ENTRY = re.compile(
    r"(member_length|member_tension|rest_length|bar_distance)\s*[(\[]\s*[\"']?([^\"'\])]+)[\"']?\s*[)\]]"
)
SURE = 1e-9  # of the size of a limit: a contradiction by less is left to the path
PROVED = 1e-6  # part of the largest shortening, or of the work that loads could do: a proof by less is none
STRAIGHT = 1e-5  # change of the targets' slopes, over the largest, that counts as none
MOST_ITERATIONS = 30
CONVERGED = 1e-10  # of the structure's size
RANK = 1e-8  # of the largest singular value
STEP = 1e-6  # of the structure's size


@dataclass(frozen=True)
class Contradiction:
    """A target and the limits of one member, or pair of bars, that exclude each other.

    Attributes
    ----------
    target : str
        The target.
    name : str
        Member or pair of bars.
    limit : str
        Which limit.
    given, allowed : float
        What the target makes necessary, and the limit itself.
    unit : str
        Their unit.
    message : str
        A sentence.
    """

    target: str
    name: str
    limit: str
    given: float
    allowed: float
    unit: str
    message: str


def find_contradiction(plan_model: PlanModel, limits: PlanLimits, targets: Targets) -> Contradiction | None:
    """Return a target that limits of one member contradict, whatever the path.

    Parameters
    ----------
    plan_model : PlanModel
        The model and its actuators.
    limits : PlanLimits
        The limits.
    targets : Targets
        The targets: those of a member's length, tension or rest length, or of a distance of two bars.

    Returns
    -------
    Contradiction or None
        None where no single target contradicts the limits.
    """
    manifest = plan_model.model.manifest
    for target in targets.parts:
        match = ENTRY.fullmatch(target.text.strip())
        if match is None or target.expression is None:
            continue
        quantity, word = match[1], match[2].strip()
        names = manifest.member_name if quantity != "bar_distance" else manifest.bar_pair_name
        index = int(word) % len(names) if re.fullmatch(r"-?\d+", word) else names.index(word)
        value = float(target.goal[0])
        found = _compare(plan_model, limits, quantity, index, value)
        if found is not None:
            limit, given, allowed, unit = found
            text = (
                f"the target {target.text} = {value:.6g} needs {given:.6g} {unit} of {names[index]}, "
                f"and the limit {limit} is {allowed:.6g} {unit}: off by {abs(given - allowed):.3g} {unit}"
            )
            return Contradiction(target.text, names[index], limit, float(given), float(allowed), unit, text)
    return None


def _compare(
    plan_model: PlanModel, limits: PlanLimits, quantity: str, index: int, value: float
) -> tuple[str, float, float, str] | None:
    """Return limit, what is necessary, what is allowed, and the unit, where they exclude each other."""
    if quantity == "bar_distance":
        return _below("clearance", value, limits.clearance, "m")
    low, high = _rest_lengths(plan_model, limits, index)
    if quantity == "rest_length":
        return _below("range", value, low, "m") or _above("range", value, high, "m")
    if quantity == "member_tension":
        least, most = value, value
    else:
        least, most = (_tension(plan_model, index, value, rest) for rest in (high, low))
    load = limits.buckling[index] / value**2 if quantity == "member_length" else math.inf
    return (
        _below("least_tension", most, limits.least_tension[index], "N")
        or _above("most_tension", least, limits.most_tension[index], "N")
        or _above("yield_stress", least, limits.yield_force[index], "N")
        or _below("yield_stress", most, -limits.yield_force[index], "N")
        or _below("buckling", most, -load, "N")
    )


def _rest_lengths(plan_model: PlanModel, limits: PlanLimits, index: int) -> tuple[float, float]:
    """Return the least and the largest rest length that the actuators of a plan give a member [m]."""
    structure = plan_model.model.structure
    assert structure is not None
    moving = np.flatnonzero(plan_model.incidence[index])
    rest = float(structure.rest_length[index])
    for item in structure.inputs:  # those that the plan holds
        if item.kind == "rest_length" and index in item.targets and item.name not in plan_model.columns:
            rest += float(plan_model.base[plan_model.model.manifest.input_name.index(item.name)])
    low, high = limits.ranges.of_member(index)
    return (
        max(rest + float(limits.least_change[moving].sum()), low),
        min(rest + float(limits.most_change[moving].sum()), high),
    )


def _tension(plan_model: PlanModel, index: int, length: float, rest_length: float) -> float:
    """Return the tension of a member of that length and rest length [N]; infinite at the ends of no limit."""
    structure = plan_model.model.structure
    assert structure is not None
    if not math.isfinite(rest_length):
        return 0.0 if structure.tension_only[index] else -math.inf
    if rest_length <= 0.0:
        return math.inf
    rest = np.array(structure.rest_length)
    rest[index] = rest_length
    changed = structure.with_changes(rest_length=rest)
    return float(changed.compute_static_tension(np.full(len(rest), length))[index])


def _below(limit: str, given: float, allowed: float, unit: str) -> tuple[str, float, float, str] | None:
    short = given < allowed - SURE * abs(allowed) if math.isfinite(allowed) else False
    return (limit, given, allowed, unit) if short else None


def _above(limit: str, given: float, allowed: float, unit: str) -> tuple[str, float, float, str] | None:
    over = given > allowed + SURE * abs(allowed) if math.isfinite(allowed) else False
    return (limit, given, allowed, unit) if over else None


def find_shape_certificate(
    plan_model: PlanModel, problem: StaticProblem, coordinate: FloatArray, required: NDArray[np.bool_]
) -> tuple[Certificate | None, bool]:
    """Return the proof that no tensions with some cables in tension, and no others in compression, balance.

    Parameters
    ----------
    plan_model : PlanModel
        The model.
    problem : StaticProblem
        Its static problem.
    coordinate : ndarray, shape (n_coordinates,)
        The shape.
    required : ndarray of bool, shape (n_members,)
        Members that must be in tension; other cables may be slack, and other bars have either sign.

    Returns
    -------
    certificate : Certificate or None
        None where such tensions exist, where the program cannot verify the proof, and for scenes of bodies.
    loaded : bool
        Whether there are loads.
    """
    model = plan_model.model
    structure = model.structure
    if structure is None or not model.has("equilibrium_matrix"):
        return None, False
    matrix = problem.compute("equilibrium_matrix", coordinate).toarray()
    _, tension = problem.forces(coordinate)
    force = matrix @ tension
    load = problem.residual(coordinate) + force
    noise = 1e-9 * (float(np.abs(matrix).max(initial=0.0)) * float(np.abs(tension).max(initial=0.0)))
    loaded = bool(np.abs(load).max(initial=0.0) > noise)
    length = np.asarray(problem.compute("member_length", coordinate))
    far = float(np.abs(problem.node_position(coordinate)).max(initial=0.0))
    rank = find_rank(matrix, rounding=EPSILON * max(far / float(length.min()), 1.0))
    pulled = np.asarray(structure.tension_only) | required
    found = find_certificate(matrix, pulled, load=load if loaded else None, rank=rank, required=required)
    return (found if found is not None and _is_sure(found, required, load) else None), loaded


def _is_sure(found: Certificate, required: NDArray[np.bool_], load: FloatArray) -> bool:
    """Return whether a proof holds beyond the error of the shape."""
    shortening = float(-found.elongation[required].min(initial=0.0))
    most_work = float(np.linalg.norm(load) * np.linalg.norm(found.displacement))
    return found.is_verified and (shortening > PROVED or found.load_work > PROVED * most_work)


def find_fixed_shape(
    problem: StaticProblem, targets: Targets, start: FloatArray, neutral: FloatArray
) -> FloatArray | None:
    """Return the coordinates that targets fix, where they fix the whole shape.

    Parameters
    ----------
    problem : StaticProblem
        The static problem.
    targets : Targets
        The targets.
    start : ndarray, shape (n_coordinates,)
        Where the search begins.
    neutral : ndarray, shape (n_coordinates, m)
        Rigid motions that the targets need not fix.

    Returns
    -------
    ndarray, shape (n_coordinates,), or None
        None where the targets leave the shape free, where no shape near the start has their values, and
        where they are not linear in the coordinates, as then other shapes may have their values too.
    """
    goal = targets.near(targets.goal, targets.evaluate(problem, start))
    free = len(start) - neutral.shape[1]
    if len(goal) < free or len(neutral) != len(start):
        return None
    place, size = start.copy(), problem.extent(start, np.asarray(problem.compute("member_length", start)))
    try:
        if not _is_linear(problem, targets, start, size):
            return None
        for _ in range(MOST_ITERATIONS):
            slope = _find_slope(problem, targets, place, size)
            if np.linalg.matrix_rank(slope, tol=RANK * float(np.linalg.norm(slope, 2))) < free:
                return None
            gap = goal - targets.near(targets.evaluate(problem, place), goal)
            step = np.linalg.lstsq(slope, gap, rcond=RANK)[0]
            place = place + step
            if np.abs(step).max(initial=0.0) <= CONVERGED * size:
                left = np.abs(goal - targets.near(targets.evaluate(problem, place), goal)).max()
                return place if left <= 1e-6 * max(float(np.abs(goal).max()), size) else None
    except (NonFiniteError, np.linalg.LinAlgError):
        return None
    return None


def _is_linear(problem: StaticProblem, targets: Targets, start: FloatArray, size: float) -> bool:
    """Return whether the slopes of the targets are the same at the start and at two shapes far from it."""
    first = _find_slope(problem, targets, start, size)
    largest = float(np.abs(first).max(initial=0.0))
    draw = np.random.default_rng(0)
    for _ in range(2):
        other = start + 0.3 * size * draw.uniform(-1.0, 1.0, len(start))
        bend = np.abs(_find_slope(problem, targets, other, size) - first).max(initial=0.0)
        if not bend <= STRAIGHT * largest:
            return False
    return True


def _find_slope(problem: StaticProblem, targets: Targets, place: FloatArray, size: float) -> FloatArray:
    """Return the derivatives of the targets, (n_targets, n_coordinates)."""
    return np.array([_difference(problem, targets, place, unit, size) for unit in np.eye(len(place))]).T


def _difference(
    problem: StaticProblem, targets: Targets, place: FloatArray, unit: FloatArray, size: float
) -> FloatArray:
    ends = [targets.evaluate(problem, place + sign * STEP * size * unit) for sign in (1, -1)]
    return (ends[0] - targets.near(ends[1], ends[0])) / (2 * STEP * size)
