"""The treatment of the stiffness by its size: dense eigenvectors or sparse factors."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.statics.dense_curvature import DenseCurvature, find_lowest_dense
from tensegrity_codegen.runtime.statics.sparse_curvature import SparseCurvature, find_lowest_sparse
from tensegrity_codegen.runtime.statics.step import Curvature
from tensegrity_codegen.system.arrays import FloatArray

DENSE_LIMIT = 200  # coordinates up to which the stiffness is diagonalised


def build_curvature(stiffness: Any, noise: float, shift: float = 0.0) -> Curvature:
    """Return the step finder of a (n_coordinates, n_coordinates) stiffness.

    noise [N]: gradients below it are rounding. shift [N/m]: where the search of a large problem begins,
    such as the last iteration's shift.
    """
    if stiffness.shape[0] <= DENSE_LIMIT:
        return DenseCurvature(stiffness, noise)
    return SparseCurvature(stiffness, shift)


def find_lowest_curvature(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] and its unit vector, over what is orthogonal to `neutral`.

    neutral: (n_coordinates, k) orthonormal columns. Where nothing is left the eigenvalue is infinite.
    """
    size = stiffness.shape[0]
    if neutral.shape[1] >= size:
        return float("inf"), np.zeros(size)
    if size <= DENSE_LIMIT:
        return find_lowest_dense(stiffness, neutral)
    return find_lowest_sparse(stiffness, neutral)
