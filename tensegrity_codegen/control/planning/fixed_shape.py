"""Proofs that no plan exists by the shape: no tensions are in balance there as the limits want them."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.plan_point import PlanModel
from tensegrity_codegen.control.planning.targets.targets import Targets
from tensegrity_codegen.runtime.analysis.certificate import Certificate, find_certificate
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

PROVED = 1e-6  # part of the largest shortening, or of the work that loads could do: a proof by less is none
STRAIGHT = 1e-5  # change of the targets' slopes, over the largest, that counts as none
MOST_ITERATIONS = 30
CONVERGED = 1e-10  # of the structure's size
RANK = 1e-8  # of the largest singular value
STEP = 1e-6  # of the structure's size


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
    goal = targets.goal
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
            gap = goal - targets.evaluate(problem, place)
            step = np.linalg.lstsq(slope, gap, rcond=RANK)[0]
            place = place + step
            if np.abs(step).max(initial=0.0) <= CONVERGED * size:
                left = np.abs(goal - targets.evaluate(problem, place)).max()
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
    return np.asarray((ends[0] - ends[1]) / (2 * STEP * size))
