"""The smallest eigenvalue of a stiffness off given motions: dense if small, by Lanczos if large."""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, SINGULAR_TOLERANCE, Factoriser, Solve
from tensegrity_codegen.system.arrays import FloatArray


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


def find_lowest_dense(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] and unit eigenvector orthogonal to the columns of `neutral`."""
    matrix = np.asarray(stiffness.toarray())
    complement = np.eye(len(matrix))
    if neutral.shape[1]:
        full, _ = np.linalg.qr(neutral, mode="complete")
        complement = full[:, neutral.shape[1] :]
    reduced = complement.T @ matrix @ complement
    value, vector = np.linalg.eigh((reduced + reduced.T) / 2)
    return float(value[0]), complement @ vector[:, 0]


def find_lowest_sparse(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] and unit eigenvector orthogonal to the columns of `neutral`.

    Lanczos iterations on P (K + shift I)^-1 P, with P the projector off `neutral` and a shift that makes
    the matrix positive definite: the largest eigenvalue nu there is lambda = 1/nu - shift.
    """
    matrix = scipy.sparse.csc_array(stiffness)
    size = matrix.shape[0]
    shift = 10 * SINGULAR_TOLERANCE * float(abs(matrix).sum(axis=0).max(initial=0.0))
    if shift == 0.0:
        return 0.0, np.zeros(size)
    solve = _factorise_shifted(matrix, shift)
    inverse = scipy.sparse.linalg.LinearOperator(
        (size, size),
        matvec=lambda v: _project(solve(_project(np.ravel(v), neutral)), neutral),
        dtype=float,
    )
    start = _project(np.random.default_rng(0).normal(size=size), neutral)
    _, vectors = scipy.sparse.linalg.eigsh(inverse, k=1, which="LA", v0=start, tol=1e-6)
    vector = _project(vectors[:, 0], neutral)
    vector /= np.linalg.norm(vector)
    return float(vector @ (matrix @ vector)), vector


def _factorise_shifted(matrix: Any, shift: float) -> Solve:
    """Return the solution with matrix + s I, with s of shift, 10 shift, ... the first that is enough."""
    factoriser, eye = Factoriser(), scipy.sparse.eye_array(matrix.shape[0], format="csc")
    while (solve := factoriser.factorise(matrix + shift * eye)) is None:
        shift *= 10
    return solve


def _project(vector: FloatArray, neutral: FloatArray) -> FloatArray:
    """Take the part along the columns of `neutral` out of a vector."""
    projected: FloatArray = vector - neutral @ (neutral.T @ vector)
    return projected
