"""Stability of many configurations: neutral rigid motions and the smallest eigenvalue off them."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points
from tensegrity_codegen.runtime.statics.rigid_motion import RANK_TOLERANCE, ROUNDING, build_all_motions
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray

HELD = 1e-9  # of the size of a motion: what may move of held coordinates


@dataclass(frozen=True)
class Stabilities:
    """As of `Stability`, one row a case; eigenvalues are NAN where the stiffness is not finite.

    twist: (count, 6, 6): of the neutral motions: turn, and translation of the middle of all nodes; as many
    rows as there are, others are zero.
    """

    smallest_eigenvalue: FloatArray
    neutral_motions: IntArray
    rounding: FloatArray
    twist: FloatArray

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
    neutral, parts, turned = find_idle_motions(stiffness, motions, points)
    number = (neutral != 0.0).any(axis=1).sum(axis=1)
    lowest = np.where(number < problem.size, _find_lowest(stiffness, neutral), np.inf)
    lowest[~is_finite] = np.nan
    number[~is_finite] = 0
    rounding = problem.bound_rounding(stiffness, points, rows) + turned
    twist = np.zeros((len(rows), 6, 6))
    twist[:, : parts.shape[1]] = parts @ fields.transpose(0, 2, 1)
    return Stabilities(lowest, number, rounding, twist)


def _find_lowest(stiffness: FloatArray, neutral: FloatArray) -> FloatArray:
    """Return the smallest eigenvalue of each stiffness over what is orthogonal to its neutral motions."""
    if neutral.shape[2]:
        onto = neutral @ neutral.transpose(0, 2, 1)
        rest, size = np.eye(stiffness.shape[1]) - onto, np.abs(stiffness).sum(axis=1).max(axis=1)
        stiffness = rest @ stiffness @ rest + np.maximum(size, 1e-300)[:, None, None] * onto
    return np.asarray(np.linalg.eigvalsh(stiffness)[:, 0])


def find_idle_motions(
    stiffness: FloatArray, motions: FloatArray, points: Points
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rigid motions (count, n, k) that cost no force, as `newton.find_idle_motions` does.

    motions: orthonormal (count, n, k). In both, columns are zero where a case has fewer. Also how they are
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
    parts = np.eye(motions.shape[2]) * ~is_none[:, None, :]
    some = np.asarray(~(np.sqrt((image**2).sum(axis=(1, 2))) <= limit))
    if some.any():
        held = np.eye(motions.shape[2]) * np.where(is_none, 2 * limit[:, None] + 1.0, 0.0)[some, None, :]
        _, singular, right = np.linalg.svd(np.concatenate([image[some], held], axis=1), full_matrices=False)
        parts[some] = np.where((singular <= limit[some, None])[:, :, None], right, 0.0)
    return motions @ parts.transpose(0, 2, 1), parts, turned


def find_rigid_motions(problem: BatchProblem, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rigid motions that the anchors permit, orthonormal (count, n, k), as `build_rigid_motions`.

    Also their twists (count, 6, k). Columns are zero where a case has fewer.
    """
    axes = list(problem.manifest.axes)
    motions, fields = build_all_motions(axes, position)
    free = np.zeros(position.shape[1:], dtype=bool)
    free[problem.node, problem.axis] = True
    chosen = free[:, axes].ravel()
    held, count = motions[:, ~chosen], motions.shape[2]
    if held.shape[1]:
        _, singular, right = np.linalg.svd(held, full_matrices=held.shape[1] < count)
        rank = (singular > RANK_TOLERANCE).sum(axis=1)
        kept = np.arange(count) >= rank[:, None]
        null = np.where(kept[:, :, None], right, 0.0).transpose(0, 2, 1)[:, :, rank.min(initial=count) :]
        motions, fields = motions @ null, fields @ null
    permitted = motions[:, chosen]
    if not permitted.size:
        return np.zeros((len(position), problem.size, 0)), np.zeros((len(position), 6, 0))
    left, singular, turn = np.linalg.svd(permitted, full_matrices=False)
    kept = (singular > RANK_TOLERANCE)[:, None, :]
    twist = fields @ turn.transpose(0, 2, 1)
    scale = np.where(kept, singular[:, None, :], 1.0)
    return np.where(kept, left, 0.0), np.where(kept, twist / scale, 0.0)


def carry_motions(
    problem: BatchProblem, position: FloatArray, twist: FloatArray, middle: FloatArray
) -> FloatArray:
    """Return the rigid motions that the anchors permit, as `find_rigid_motions`, of twists found elsewhere.

    twist: (count, 6, k): turn, and velocity of the point `middle` (count, 3).
    """
    count, k = len(position), twist.shape[2]
    turn, shift = (twist[:, part].transpose(0, 2, 1)[:, :, None] for part in (slice(3), slice(3, 6)))
    field = np.cross(turn, (position - middle[:, None])[:, None]) + shift  # (count, k, n_nodes, 3)
    motions = np.zeros((count, problem.size, 6))
    motions[:, :, :k], upper = np.linalg.qr(field[:, :, problem.node, problem.axis].transpose(0, 2, 1))
    field[:, :, problem.node, problem.axis] = 0.0
    least = np.abs(np.diagonal(upper, axis1=1, axis2=2)).min(axis=1, initial=np.inf)
    other = np.abs(field).max(axis=(1, 2, 3), initial=0.0) > HELD * least
    if other.any():
        found, _ = find_rigid_motions(problem, position[other])
        motions[other] = 0.0
        motions[other, :, : found.shape[2]] = found
    return motions
