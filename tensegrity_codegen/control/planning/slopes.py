"""How an equilibrium follows the actuators: tensions, lengths, distances between bars, targets, stiffness."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.control.planning.targets.targets import MovedBy, Targets
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.system.arrays import FloatArray

STEP = 3e-6  # of the longest member: length of differences
STILL = 1e-4  # of the way, by inputs as large as the longest member: a target that does not move
RANK = 1e-6  # of the largest singular value


@dataclass(frozen=True)
class Slopes:
    """Derivatives of an equilibrium with respect to the actuators' inputs, one column each.

    Attributes
    ----------
    coordinate : ndarray, shape (n_coordinates, n_actuators)
        Of the coordinates.
    tension, length, extension : ndarray, shape (n_members, n_actuators) [N/m, 1, 1]
        Of tensions, lengths, and lengths minus rest lengths of the members.
    distance : ndarray, shape (n_bar_pairs, n_actuators)
        Of the distances between bars.
    target : ndarray, shape (n_targets, n_actuators)
        Of the target values.
    eigenvalue : ndarray, shape (k, n_actuators) [N/m2]
        Of the smallest eigenvalues; (0, n_actuators) unless asked for, and with rigid bars.
    """

    coordinate: FloatArray
    tension: FloatArray
    length: FloatArray
    extension: FloatArray
    distance: FloatArray
    target: FloatArray
    eigenvalue: FloatArray


def compute_slopes(
    plan_model: PlanModel, at: PlanPoint, targets: Targets, *, with_stiffness: bool = False
) -> Slopes:
    """Return the derivatives of an equilibrium with respect to the actuators' inputs.

    Parameters
    ----------
    plan_model : PlanModel
        The model and its actuators.
    at : PlanPoint
        The equilibrium.
    targets : Targets
        Targets bound to the model.
    with_stiffness : bool
        Whether to include those of the smallest eigenvalues.

    Returns
    -------
    Slopes
        Derivatives.

    Raises
    ------
    SingularStiffnessError
        A motion that is not rigid meets no resistance.

    Notes
    -----
    dq/du and dt/du by equilibrium_sensitivity; distances between bars, expressions and eigenvalues, as
    v^T K v at constant v, by central differences along (dq/du, du).
    """
    manifest = plan_model.model.manifest
    arguments = {**plan_model.arguments, INPUT: plan_model.inputs(at.change)}
    found = equilibrium_sensitivity(
        plan_model.model, at.model_coordinate, arguments, columns=plan_model.columns
    )
    ends = np.array(manifest.connectivity, dtype=np.int64).reshape(-1, 2)
    vector = at.position[ends[:, 0]] - at.position[ends[:, 1]]
    apart = found.node[ends[:, 0]] - found.node[ends[:, 1]]
    length = np.einsum("ea,eak->ek", vector / at.length[:, None], apart)
    count = len(at.change)

    def move(column: int, step: float) -> tuple[StaticProblem, FloatArray]:
        change = at.change.copy()
        change[column] += step
        return plan_model.problem(change), at.coordinate + step * moving[:, column]

    moving = plan_model.scale(found.coordinate)
    step = STEP * at.point.longest
    distance, eigenvalue = np.zeros((0, count)), np.zeros((0, count))
    if plan_model.has_pairs:
        distance = _difference(lambda problem, q: problem.compute("bar_distance", q), move, count, step)
    if with_stiffness and len(at.eigenvector) == len(at.coordinate):
        vector = at.eigenvector
        eigenvalue = _difference(
            lambda problem, q: np.einsum("ik,ik->k", vector, problem.stiffness(q) @ vector), move, count, step
        )
    return Slopes(
        moving,
        found.tension,
        length,
        length - plan_model.incidence,
        distance,
        targets.slopes(at.position, found.node, move, step),
        eigenvalue,
    )


def _difference(
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
    """Return why no change of the inputs moves targets along a direction, to first order.

    Parameters
    ----------
    names : sequence of str
        Names of the components of the targets.
    slope : ndarray, shape (n_targets, n_actuators)
        Derivatives of the targets with respect to the inputs.
    direction : ndarray, shape (n_targets,)
        Changes of the targets that are wanted.
    longest : float [m]
        The longest member.

    Returns
    -------
    str
        The targets that no actuator changes; or how many components the actuators change independently.
    """
    effect = np.abs(slope).sum(axis=1) * longest
    still = effect <= STILL * np.abs(direction)
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
