"""Cholesky factors and smallest eigenvalues of stiffnesses: dense by LAPACK, sparse by CHOLMOD or SuperLU."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.system.arrays import FloatArray, IntArray

DENSE_LIMIT = 200  # coordinates up to which a stiffness is treated as a dense matrix
SINGULAR_TOLERANCE = 1e-13  # of the norm of the stiffness: eigenvalues below are rounding

Solve = Callable[[FloatArray], FloatArray]


class Factoriser:
    """Factorises matrices of one size, and orders those of one pattern once; n_factors: how often so far."""

    def __init__(self) -> None:
        self.n_factors = 0
        self._sparse: _Cholmod | _SuperLU | None = None

    def factorise(self, matrix: Any) -> Solve | None:
        """Return b -> matrix^-1 b of a symmetric matrix (n, n); None if it is not positive definite."""
        self.n_factors += 1
        if isinstance(matrix, np.ndarray):
            return _factorise_dense(matrix)
        matrix = scipy.sparse.csc_array(matrix)
        if self._sparse is None or not self._sparse.fits(matrix):
            self._sparse = _analyse(matrix)
        return self._sparse.factorise(matrix)


def _factorise_dense(matrix: FloatArray) -> Solve | None:
    factor, failed = scipy.linalg.lapack.dpotrf(matrix, lower=1)
    if failed:
        return None

    def solve(right: FloatArray) -> FloatArray:
        return np.asarray(scipy.linalg.lapack.dpotrs(factor, right, lower=1)[0])

    return solve


def _analyse(matrix: Any) -> "_Cholmod | _SuperLU":
    """Return the factoriser of matrices of the pattern of a sparse one."""
    try:
        from sksparse import cholmod  # of scikit-sparse, extra [sparse]
    except ImportError:
        return _SuperLU(matrix)
    return _Cholmod(cholmod, matrix)


class _Pattern:
    """The pattern of a sparse matrix in compressed columns."""

    def __init__(self, matrix: Any) -> None:
        self.indptr, self.indices = matrix.indptr, matrix.indices

    def fits(self, matrix: Any) -> bool:
        """Whether a matrix has this pattern."""
        return np.array_equal(self.indptr, matrix.indptr) and np.array_equal(self.indices, matrix.indices)


class _Cholmod(_Pattern):
    """CHOLMOD's Cholesky factors; supernodes and its ordering make it the faster one of large matrices."""

    def __init__(self, cholmod: Any, matrix: Any) -> None:
        super().__init__(matrix)
        self.error = cholmod.CholmodNotPositiveDefiniteError
        # Supernodal factors are L L^T, which tell indefinite matrices; simplicial ones are L D L^T.
        self.ordered = cholmod.analyze(_shorten(matrix), mode="supernodal")

    def factorise(self, matrix: Any) -> Solve | None:
        try:
            solve: Solve = self.ordered.cholesky(_shorten(matrix))
        except self.error:
            return None
        return solve


def _shorten(matrix: Any) -> Any:
    """Return a matrix with indices of 32 bits, as CHOLMOD takes them."""
    arrays = (matrix.data, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32))
    return scipy.sparse.csc_matrix(arrays, shape=matrix.shape)


class _SuperLU(_Pattern):
    """LU with pivots on the diagonal: as many are negative as eigenvalues are (Sylvester)."""

    def __init__(self, matrix: Any) -> None:
        super().__init__(matrix)
        self.order: IntArray | None = None

    def factorise(self, matrix: Any) -> Solve | None:
        order = self.order
        ordered = matrix if order is None else scipy.sparse.csc_array(matrix[order][:, order])
        try:
            factor = scipy.sparse.linalg.splu(
                ordered,
                permc_spec="MMD_AT_PLUS_A" if order is None else "NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            return None
        if order is None:
            self.order = np.argsort(factor.perm_c)
        if not np.array_equal(factor.perm_r, factor.perm_c) or factor.U.diagonal().min(initial=1.0) <= 0:
            return None
        if order is None:
            solve: Solve = factor.solve
            return solve

        def solve_ordered(right: FloatArray) -> FloatArray:
            solution = np.empty_like(right)
            solution[order] = factor.solve(right[order])
            return solution

        return solve_ordered


def find_lowest_curvature(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] orthogonal to columns `neutral`, or inf, and its vector."""
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
        (size, size), matvec=lambda v: project(solve(project(np.ravel(v), neutral)), neutral), dtype=float
    )
    start = project(np.random.default_rng(0).normal(size=size), neutral)
    _, vectors = scipy.sparse.linalg.eigsh(inverse, k=1, which="LA", v0=start, tol=1e-6)
    vector = project(vectors[:, 0], neutral)
    vector /= np.linalg.norm(vector)
    return float(vector @ (matrix @ vector)), vector


def _factorise_shifted(matrix: Any, shift: float) -> Solve:
    """Return the solution with matrix + s I, with s of shift, 10 shift, ... the first that is enough."""
    factoriser, eye = Factoriser(), scipy.sparse.eye_array(matrix.shape[0], format="csc")
    while (solve := factoriser.factorise(matrix + shift * eye)) is None:
        shift *= 10
    return solve


def project(vector: FloatArray, neutral: FloatArray) -> FloatArray:
    """Take the part along the columns of `neutral` out of a vector."""
    projected: FloatArray = vector - neutral @ (neutral.T @ vector)
    return projected
