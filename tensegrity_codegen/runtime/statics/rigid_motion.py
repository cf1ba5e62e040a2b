"""Rigid motions of the free coordinates: which the anchors permit, and which of them cost no force."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest

RANK_TOLERANCE = 1e-10  # of motions scaled to unit size
ROUNDING = 1e-13  # of the norm of the stiffness


def build_rigid_motions(
    manifest: Manifest | Structure, position: FloatArray, *, nodes: Sequence[int] | None = None
) -> FloatArray:
    """Return an orthonormal basis of the rigid motions that the anchors permit, (n_coordinates, k).

    One translation along each modelled axis and one infinitesimal rotation in each plane of two modelled
    axes, combined so that every anchored coordinate rests. position: (n_nodes, 3) [m]. Motions that move
    nothing (a rod about its own axis) are dropped. nodes: those that move, by default all; the others rest.
    """
    axes = manifest.axes
    moved = list(range(len(position)) if nodes is None else nodes)
    motions, _ = build_all_motions(axes, position[moved])
    free = np.zeros((len(position), 3), dtype=bool)
    for node, axis in manifest.coordinate_node_axis:
        free[node, axis] = True
    chosen = free[np.ix_(moved, axes)].ravel()
    permitted = motions[chosen] @ _null_space(motions[~chosen])
    moves = np.zeros(len(position), dtype=bool)
    moves[moved] = True
    places = [k for k, (node, _) in enumerate(manifest.coordinate_node_axis) if moves[node]]
    if permitted.size == 0:
        return np.zeros((len(manifest.coordinate_node_axis), 0))
    left, singular, _ = np.linalg.svd(permitted, full_matrices=False)
    left = left[:, singular > RANK_TOLERANCE]
    basis: FloatArray = np.zeros((len(manifest.coordinate_node_axis), left.shape[1]))
    basis[places] = left
    return basis


def find_neutral_motions(stiffness: Any, motions: FloatArray, force_noise: float) -> FloatArray:
    """Return a basis of those `motions` that the stiffness annihilates to rounding, (n_coordinates, m).

    stiffness: (n_coordinates, n_coordinates) [N/m], sparse or dense. force_noise [N]: the change of force
    that a unit motion may cause and still count as none, on top of rounding. A rotation that tilts loads,
    such as a pendulum's, is no neutral motion.
    """
    if motions.shape[1] == 0:
        return motions
    size = float(abs(stiffness).sum(axis=0).max(initial=0.0))
    threshold = ROUNDING * size * np.sqrt(len(motions)) + force_noise
    _, singular, right = np.linalg.svd(np.asarray(stiffness @ motions), full_matrices=False)
    neutral: FloatArray = motions @ right[singular <= threshold].T
    return neutral


def build_all_motions(axes: Sequence[int], position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return translations and rotations about the middle, each of unit size, and their twists.

    position: (..., n_nodes, 3) [m]. Motions (..., n_nodes * n_axes, k); twists (..., 6, k): turn, and
    translation of the middle.
    """
    local = position[..., list(axes)]
    local = local - local.mean(axis=-2, keepdims=True)
    columns, twists = [], []
    for number, axis in enumerate(axes):
        shift, twist = np.zeros_like(local), np.zeros(6)
        shift[..., number], twist[3 + axis] = 1.0, 1.0
        columns.append(shift)
        twists.append(twist)
    for first, second in combinations(range(len(axes)), 2):
        turn = np.zeros_like(local)
        turn[..., first], turn[..., second] = -local[..., second], local[..., first]
        columns.append(turn)
        twists.append(np.append(np.cross(np.eye(3)[axes[first]], np.eye(3)[axes[second]]), np.zeros(3)))
    motions = np.stack([column.reshape(*position.shape[:-2], -1) for column in columns], axis=-1)
    norm = np.linalg.norm(motions, axis=-2, keepdims=True)
    norm = np.where(norm > 0, norm, 1.0)
    return motions / norm, np.stack(twists, axis=-1) / norm


def _null_space(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the null space of a tall or empty matrix, by SVD."""
    count = matrix.shape[1]
    if matrix.shape[0] == 0:
        return np.eye(count)
    _, singular, right = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < count)
    rank = int((singular > RANK_TOLERANCE).sum())
    null: FloatArray = right[rank:].T
    return null
