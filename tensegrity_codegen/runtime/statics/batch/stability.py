"""Stability of many configurations: neutral rigid motions and the smallest eigenvalue off them."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points
from tensegrity_codegen.runtime.statics.factors import SINGULAR_TOLERANCE
from tensegrity_codegen.runtime.statics.rigid_motion import RANK_TOLERANCE, ROUNDING, build_all_motions
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Stabilities:
    """As of `Stability`, one row a case; eigenvalues are NAN where the stiffness is not finite.

    twist: (count, 6, 6): of the neutral motions, first `neutral_motions` rows of each case: turn, and
    translation of the middle of all nodes; other rows are zero.
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


def find_stabilities(problem: BatchProblem, points: Points, cases: IntArray) -> Stabilities:
    """Return the stability of each configuration, as `find_stability` does."""
    count = len(cases)
    stiffness, is_finite = problem.find_stiffness(points.coordinate, cases)
    stiffness = np.where(is_finite[:, None, None], stiffness, 0.0)
    position = problem.place(points.coordinate, cases)
    spread = np.linalg.norm((position - position.mean(axis=1, keepdims=True)).reshape(count, -1), axis=1)
    turned = 10 * np.linalg.norm(points.residual, axis=1) / np.maximum(spread, 1e-300)
    size = np.abs(stiffness).sum(axis=1).max(axis=1, initial=0.0)
    limit = ROUNDING * size * np.sqrt(problem.size) + turned
    lowest, number = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    twist = np.zeros((count, 6, 6))
    for rows, motions, fields in _find_rigid_motions(problem, position):
        for own, neutral, parts in _find_neutral(stiffness[rows], motions, fields, limit[rows]):
            at = rows[own]
            number[at] = neutral.shape[2]
            twist[at, : neutral.shape[2]] = parts.transpose(0, 2, 1)
            if neutral.shape[2] < problem.size:
                lowest[at] = _find_lowest(stiffness[at], neutral, size[at])
    lowest[~is_finite] = np.nan
    number[~is_finite] = 0
    return Stabilities(lowest, number, SINGULAR_TOLERANCE * size + turned, twist)


def _find_lowest(stiffness: FloatArray, neutral: FloatArray, size: FloatArray) -> FloatArray:
    """Return the smallest eigenvalue of each stiffness over what is orthogonal to its neutral motions."""
    if neutral.shape[2]:
        onto = neutral @ neutral.transpose(0, 2, 1)
        rest = np.eye(stiffness.shape[1]) - onto
        stiffness = rest @ stiffness @ rest + np.maximum(size, 1e-300)[:, None, None] * onto
    return np.asarray(np.linalg.eigvalsh(stiffness)[:, 0])


Group = tuple[IntArray, FloatArray, FloatArray]


def _find_neutral(
    stiffness: FloatArray, motions: FloatArray, fields: FloatArray, limit: FloatArray
) -> list[Group]:
    """Return groups of cases with as many neutral motions: rows, motions, twists (count, 6, m)."""
    if motions.shape[2] == 0:
        return [(np.arange(len(motions)), motions, fields)]
    _, singular, right = np.linalg.svd(stiffness @ motions, full_matrices=False)
    is_neutral = singular <= limit[:, None]  # the last ones: singular values fall
    found = []
    for number in np.unique(is_neutral.sum(axis=1)):
        rows = np.flatnonzero(is_neutral.sum(axis=1) == number)
        chosen = right[rows][:, right.shape[1] - number :].transpose(0, 2, 1)
        found.append((rows, motions[rows] @ chosen, fields[rows] @ chosen))
    return found


def _find_rigid_motions(problem: BatchProblem, position: FloatArray) -> list[Group]:
    """Return groups of cases with as many rigid motions that the anchors permit, as `build_rigid_motions`.

    Each with its rows, orthonormal motions (count, n_coordinates, k) and twists (count, 6, k).
    """
    axes = list(problem.manifest.axes)
    motions, fields = build_all_motions(axes, position)
    free = np.zeros(position.shape[1:], dtype=bool)
    free[problem.node, problem.axis] = True
    chosen = free[:, axes].ravel()
    count, columns = len(position), motions.shape[2]
    held = motions[:, ~chosen]
    right, rank = np.broadcast_to(np.eye(columns), (count, columns, columns)), np.zeros(count, dtype=np.int64)
    if held.shape[1]:
        _, singular, right = np.linalg.svd(held, full_matrices=True)
        rank = (singular > RANK_TOLERANCE).sum(axis=1)
    found = []
    for number in np.unique(rank):
        rows = np.flatnonzero(rank == number)
        null = right[rows][:, number:].transpose(0, 2, 1)
        permitted = motions[rows][:, chosen] @ null
        if permitted.size == 0:
            found.append((rows, np.zeros((len(rows), problem.size, 0)), np.zeros((len(rows), 6, 0))))
            continue
        left, singular, turn = np.linalg.svd(permitted, full_matrices=False)
        kept = (singular > RANK_TOLERANCE).sum(axis=1)
        for width in np.unique(kept):
            own = np.flatnonzero(kept == width)
            scale = singular[own][:, None, :width]
            parts = fields[rows[own]] @ null[own] @ turn[own][:, :width].transpose(0, 2, 1) / scale
            found.append((rows[own], left[own][:, :, :width], parts))
    return found
