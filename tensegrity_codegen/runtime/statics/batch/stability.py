"""Stability of many configurations, and distances of nodes from the start without neutral motions.

For distances the start is moved along the neutral motions as near as possible to the end (neutral_motion.py).
For no neutral motion, slides alone, a turn with the slides across its axis, and all rigid motions that is the
mean displacement and the best turn (W. Kabsch, Acta Cryst. A 32, 1976).
"""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points
from tensegrity_codegen.runtime.statics.static_problem import RANK_TOLERANCE, ROUNDING, build_all_motions
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray

HELD = 1e-9  # of the size of a motion: what may move of held coordinates
TURN_TOLERANCE = 1e-8  # part of a unit turn that counts as none
PERPENDICULAR_TOLERANCE = 1e-6  # cosine of the angle up to which slides are across an axis


@dataclass(frozen=True)
class Stabilities:
    """As of `Stability`, one row a case; eigenvalues are NAN if the stiffness is not finite."""

    smallest_eigenvalue: FloatArray
    neutral_motions: IntArray
    rounding: FloatArray
    twist: FloatArray  # (count, 6, 6), turn and translation of the middle in neutral motions; other rows zero

    @property
    def is_unstable(self) -> BoolArray:
        """Whether the energy curves down, beyond rounding."""
        return np.asarray(self.smallest_eigenvalue < -self.rounding)

    @property
    def is_neutral(self) -> BoolArray:
        """Whether the smallest eigenvalue is zero to rounding."""
        return np.asarray(np.abs(self.smallest_eigenvalue) <= self.rounding)


def find_stabilities(problem: BatchProblem, points: Points, rows: IntArray) -> Stabilities:
    """Return the stability of each configuration, as `find_stability` does."""
    stiffness, is_finite = problem.find_stiffness(points.coordinate, rows)
    stiffness = np.where(is_finite[:, None, None], stiffness, 0.0)
    motions, fields = find_rigid_motions(problem, points.position)
    neutral, combinations, turned = find_idle_motions(stiffness, motions, points)
    number = (neutral != 0.0).any(axis=1).sum(axis=1)
    lowest = np.where(number < problem.size, _find_lowest(stiffness, neutral), np.inf)
    lowest[~is_finite] = np.nan
    number[~is_finite] = 0
    rounding = problem.bound_rounding(stiffness, points, rows) + turned
    twist = np.zeros((len(rows), 6, 6))
    twist[:, : combinations.shape[1]] = combinations @ fields.transpose(0, 2, 1)
    return Stabilities(lowest, number, rounding, twist)


def _find_lowest(stiffness: FloatArray, neutral: FloatArray) -> FloatArray:
    """Return the smallest eigenvalue of each stiffness orthogonal to its neutral motions."""
    if neutral.shape[2]:
        onto = neutral @ neutral.transpose(0, 2, 1)
        projector, size = np.eye(stiffness.shape[1]) - onto, np.abs(stiffness).sum(axis=1).max(axis=1)
        stiffness = projector @ stiffness @ projector + np.maximum(size, 1e-300)[:, None, None] * onto
    return np.asarray(np.linalg.eigvalsh(stiffness)[:, 0])


def find_idle_motions(
    stiffness: FloatArray, motions: FloatArray, points: Points
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rigid motions (count, n, k) that cost no force, as `newton.find_idle_motions` does.

    motions: orthonormal (count, n, k). In both, columns are zero if a case has fewer. Also how they are
    combined of `motions` (count, k, k), rows, and what may count as no stiffness of them, (count,) [N/m].
    """
    local = points.position - points.position.mean(axis=1, keepdims=True)
    spread = np.sqrt((local**2).sum(axis=(1, 2)))
    turned = 10 * np.linalg.norm(points.residual, axis=1) / np.maximum(spread, 1e-300)
    if not motions.shape[2]:
        return motions, np.zeros((len(motions), 0, 0)), turned
    size = np.abs(stiffness).sum(axis=1).max(axis=1)
    limit = ROUNDING * size * np.sqrt(stiffness.shape[1]) + turned
    image, is_none = stiffness @ motions, np.asarray(~motions.any(axis=1))
    combinations = np.eye(motions.shape[2]) * ~is_none[:, None, :]
    some = np.asarray(~(np.sqrt((image**2).sum(axis=(1, 2))) <= limit))
    if some.any():
        held = np.eye(motions.shape[2]) * np.where(is_none, 2 * limit[:, None] + 1.0, 0.0)[some, None, :]
        _, singular, right = np.linalg.svd(np.concatenate([image[some], held], axis=1), full_matrices=False)
        combinations[some] = np.where((singular <= limit[some, None])[:, :, None], right, 0.0)
    return motions @ combinations.transpose(0, 2, 1), combinations, turned


def find_rigid_motions(problem: BatchProblem, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return motions as of `build_rigid_motions` (count, n, k), zero if fewer, and their twists."""
    axes = list(problem.manifest.axes)
    motions, fields = build_all_motions(axes, position)
    free = np.zeros(position.shape[1:], dtype=bool)
    free[problem.node, problem.axis] = True
    chosen = free[:, axes].ravel()
    held, count = motions[:, ~chosen], motions.shape[2]
    if held.shape[1]:
        _, singular, right = np.linalg.svd(held, full_matrices=held.shape[1] < count)
        rank = (singular > RANK_TOLERANCE).sum(axis=1)
        is_permitted = np.arange(count) >= rank[:, None]
        null = np.where(is_permitted[:, :, None], right, 0.0).transpose(0, 2, 1)[
            :, :, rank.min(initial=count) :
        ]
        motions, fields = motions @ null, fields @ null
    permitted = motions[:, chosen]
    if not permitted.size:
        return np.zeros((len(position), problem.size, 0)), np.zeros((len(position), 6, 0))
    permitted_motions, singular, turn = np.linalg.svd(permitted, full_matrices=False)
    is_permitted = (singular > RANK_TOLERANCE)[:, None, :]
    twist = fields @ turn.transpose(0, 2, 1)
    scale = np.where(is_permitted, singular[:, None, :], 1.0)
    return np.where(is_permitted, permitted_motions, 0.0), np.where(is_permitted, twist / scale, 0.0)


def carry_motions(
    problem: BatchProblem, position: FloatArray, twist: FloatArray, middle: FloatArray
) -> FloatArray:
    """Return the motions of `find_rigid_motions` of twists (count, 6, k) about `middle` (count, 3)."""
    count, k = len(position), twist.shape[2]
    turn, shift = (
        twist[:, components].transpose(0, 2, 1)[:, :, None] for components in (slice(3), slice(3, 6))
    )
    field = np.cross(turn, (position - middle[:, None])[:, None]) + shift  # (count, k, n_nodes, 3)
    motions = np.zeros((count, problem.size, 6))
    motions[:, :, :k], upper = np.linalg.qr(field[:, :, problem.node, problem.axis].transpose(0, 2, 1))
    field[:, :, problem.node, problem.axis] = 0.0
    smallest_pivot = np.abs(np.diagonal(upper, axis1=1, axis2=2)).min(axis=1, initial=np.inf)
    is_changed = np.abs(field).max(axis=(1, 2, 3), initial=0.0) > HELD * smallest_pivot
    if is_changed.any():
        motions_anew, _ = find_rigid_motions(problem, position[is_changed])
        motions[is_changed] = 0.0
        motions[is_changed, :, : motions_anew.shape[2]] = motions_anew
    return motions


def find_distances(
    start: FloatArray, end: FloatArray, n_neutral: IntArray, twists: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return distances of nodes from the start moved along neutral motions, and where these are known."""
    distance = np.full(start.shape[:2], np.nan)
    _, size, axis = np.linalg.svd(twists[:, :, :3])
    n_turns = (size > TURN_TOLERANCE * np.maximum(size.max(axis=1, keepdims=True, initial=0.0), 1e-300)).sum(
        axis=1
    )
    n_turns[np.abs(twists[:, :, :3]).max(axis=(1, 2), initial=0.0) <= TURN_TOLERANCE] = 0
    slides = _find_slides(twists, n_neutral, n_turns)
    # Slides alone: the mean displacement along them is taken out.
    move = (end - start).mean(axis=1)
    sliding = np.flatnonzero(n_turns == 0)
    along = (slides[sliding] @ move[sliding][:, :, None])[:, :, 0]
    distance[sliding] = np.linalg.norm(end[sliding] - start[sliding] - along[:, None, :], axis=2)
    start_local, end_local = (points - points.mean(axis=1, keepdims=True) for points in (start, end))
    # One turn, with slides across its axis.
    across = (slides @ axis[:, 0][:, :, None])[:, :, 0]
    rank = np.trace(slides, axis1=1, axis2=2).round()
    is_across = (rank == 3) | ((rank == 2) & (np.linalg.norm(across, axis=1) <= PERPENDICULAR_TOLERANCE))
    is_turn = (n_turns == 1) & (n_neutral == 1 + rank) & is_across
    single = np.flatnonzero(is_turn)
    if len(single):
        turned = _turn_about(axis[single, 0], start_local[single], end_local[single])
        across_slides = move[single] - (slides[single] @ move[single][:, :, None])[:, :, 0]
        distance[single] = np.linalg.norm(end_local[single] + across_slides[:, None, :] - turned, axis=2)
    # All rigid motions.
    free = np.flatnonzero((n_turns == 3) & (n_neutral == 6))
    if len(free):
        distance[free] = np.linalg.norm(
            end_local[free] - _turn_freely(start_local[free], end_local[free]), axis=2
        )
    return distance, ~np.isnan(distance).any(axis=1)


def _find_slides(twists: FloatArray, n_neutral: IntArray, n_turns: IntArray) -> FloatArray:
    """Return projectors (count, 3, 3) onto the translations among neutral motions."""
    rotation, _, _ = np.linalg.svd(twists[:, :, :3])
    mixed = rotation.transpose(0, 2, 1) @ twists[:, :, 3:]  # rows behind `n_turns` have no turn
    pure = np.where((np.arange(6) >= n_turns[:, None])[:, :, None], mixed, 0.0)
    _, size, right = np.linalg.svd(pure)
    is_slide = (
        size
        > TURN_TOLERANCE * np.maximum(np.abs(twists[:, :, 3:]).max(axis=(1, 2), initial=0.0), 1e-300)[:, None]
    )
    basis = np.where(is_slide[:, :, None], right, 0.0)
    return np.asarray(basis.transpose(0, 2, 1) @ basis)


def _turn_about(axis: FloatArray, start_local: FloatArray, end_local: FloatArray) -> FloatArray:
    """Return points turned about axes through the origin, as near as possible to other points."""
    along = (start_local @ axis[:, :, None]) * axis[:, None, :]
    across = start_local - along
    normal = np.cross(axis[:, None, :], across)
    sine, cosine = (normal * end_local).sum(axis=(1, 2)), (across * end_local).sum(axis=(1, 2))
    angle = np.arctan2(sine, cosine)[:, None, None]
    return np.asarray(along + np.cos(angle) * across + np.sin(angle) * normal)


def _turn_freely(start_local: FloatArray, end_local: FloatArray) -> FloatArray:
    """Return points turned about the origin, as near as possible to other points."""
    rotation, _, right = np.linalg.svd(start_local.transpose(0, 2, 1) @ end_local)
    rotation[:, :, 2] *= np.sign(np.linalg.det(rotation) * np.linalg.det(right))[:, None]
    return np.asarray(start_local @ rotation @ right)
