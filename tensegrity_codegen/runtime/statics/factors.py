"""Cholesky factors of symmetric matrices: dense ones by LAPACK, sparse ones by SuperLU."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.system.arrays import FloatArray

DENSE_LIMIT = 200  # coordinates up to which a stiffness is treated as a dense matrix
SINGULAR_TOLERANCE = 1e-13  # of the norm of the stiffness: eigenvalues below are rounding

Solve = Callable[[FloatArray], FloatArray]


class Factoriser:
    """Factorises matrices of one size; n_factors: how often so far."""

    def __init__(self) -> None:
        self.n_factors = 0

    def factorise(self, matrix: Any) -> Solve | None:
        """Return the function b -> matrix^-1 b, None where the matrix is not positive definite.

        matrix: symmetric (n, n), an array or a sparse array.
        """
        self.n_factors += 1
        return _factorise_sparse(matrix) if scipy.sparse.issparse(matrix) else _factorise_dense(matrix)


def _factorise_dense(matrix: FloatArray) -> Solve | None:
    factor, failed = scipy.linalg.lapack.dpotrf(matrix, lower=1)
    if failed:
        return None

    def solve(right: FloatArray) -> FloatArray:
        return np.asarray(scipy.linalg.lapack.dpotrs(factor, right, lower=1)[0])

    return solve


def _factorise_sparse(matrix: Any) -> Solve | None:
    """Factorise by LU with pivots on the diagonal: by Sylvester's law of inertia their signs are those of the
    eigenvalues."""
    try:
        factor = scipy.sparse.linalg.splu(
            scipy.sparse.csc_array(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    if not np.array_equal(factor.perm_r, factor.perm_c) or factor.U.diagonal().min(initial=1.0) <= 0:
        return None
    solve: Solve = factor.solve
    return solve
