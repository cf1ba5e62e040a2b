"""Distances of nodes from the start in many cases, without neutral motions, where that has a closed form.

The start is moved along the neutral motions as near as possible to what was found (neutral_motion.py). For
no neutral motion, slides alone, a turn with the slides across its axis, and all rigid motions that is the
mean displacement and the best turn (W. Kabsch, Acta Cryst. A 32, 1976).
"""

import numpy as np

from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray

RANK_TOLERANCE = 1e-8  # part of a unit turn that counts as none
PERPENDICULAR_TOLERANCE = 1e-6  # cosine of the angle up to which slides are across an axis


def find_distances(
    start: FloatArray, found: FloatArray, n_neutral: IntArray, twists: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return distances of nodes from the start moved along neutral motions, and where these are known."""
    distance = np.full(start.shape[:2], np.nan)
    _, size, axis = np.linalg.svd(twists[:, :, :3])
    n_turns = (size > RANK_TOLERANCE * np.maximum(size.max(axis=1, keepdims=True, initial=0.0), 1e-300)).sum(
        axis=1
    )
    n_turns[np.abs(twists[:, :, :3]).max(axis=(1, 2), initial=0.0) <= RANK_TOLERANCE] = 0
    slides = _find_slides(twists, n_neutral, n_turns)
    move = (found - start).mean(axis=1)
    sliding = np.flatnonzero(n_turns == 0)
    along = (slides[sliding] @ move[sliding][:, :, None])[:, :, 0]
    distance[sliding] = np.linalg.norm(found[sliding] - start[sliding] - along[:, None, :], axis=2)
    start_local, found_local = (place - place.mean(axis=1, keepdims=True) for place in (start, found))
    across = (slides @ axis[:, 0][:, :, None])[:, :, 0]
    rank = np.trace(slides, axis1=1, axis2=2).round()
    is_across = (rank == 3) | ((rank == 2) & (np.linalg.norm(across, axis=1) <= PERPENDICULAR_TOLERANCE))
    is_turn = (n_turns == 1) & (n_neutral == 1 + rank) & is_across
    one = np.flatnonzero(is_turn)
    if len(one):
        turned = _turn_about(axis[one, 0], start_local[one], found_local[one])
        kept = move[one] - (slides[one] @ move[one][:, :, None])[:, :, 0]
        distance[one] = np.linalg.norm(found_local[one] + kept[:, None, :] - turned, axis=2)
    free = np.flatnonzero((n_turns == 3) & (n_neutral == 6))
    if len(free):
        distance[free] = np.linalg.norm(
            found_local[free] - _turn_freely(start_local[free], found_local[free]), axis=2
        )
    return distance, ~np.isnan(distance).any(axis=1)


def _find_slides(twists: FloatArray, n_neutral: IntArray, n_turns: IntArray) -> FloatArray:
    """Return projectors (count, 3, 3) onto the translations among neutral motions."""
    left, _, _ = np.linalg.svd(twists[:, :, :3])
    mixed = left.transpose(0, 2, 1) @ twists[:, :, 3:]  # rows behind `n_turns` have no turn
    pure = np.where((np.arange(6) >= n_turns[:, None])[:, :, None], mixed, 0.0)
    _, size, right = np.linalg.svd(pure)
    is_slide = (
        size
        > RANK_TOLERANCE * np.maximum(np.abs(twists[:, :, 3:]).max(axis=(1, 2), initial=0.0), 1e-300)[:, None]
    )
    basis = np.where(is_slide[:, :, None], right, 0.0)
    return np.asarray(basis.transpose(0, 2, 1) @ basis)


def _turn_about(axis: FloatArray, start_local: FloatArray, found_local: FloatArray) -> FloatArray:
    """Return points turned about axes through the origin, as near as possible to other points."""
    along = (start_local @ axis[:, :, None]) * axis[:, None, :]
    across = start_local - along
    normal = np.cross(axis[:, None, :], across)
    sine, cosine = (normal * found_local).sum(axis=(1, 2)), (across * found_local).sum(axis=(1, 2))
    angle = np.arctan2(sine, cosine)[:, None, None]
    return np.asarray(along + np.cos(angle) * across + np.sin(angle) * normal)


def _turn_freely(start_local: FloatArray, found_local: FloatArray) -> FloatArray:
    """Return points turned about the origin, as near as possible to other points."""
    left, _, right = np.linalg.svd(start_local.transpose(0, 2, 1) @ found_local)
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    return np.asarray(start_local @ left @ right)
