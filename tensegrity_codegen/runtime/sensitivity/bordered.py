"""One sparse factorisation of a stiffness bordered by rigid bars and by a gauge.

    [K J^T C^T] [dx]   [right]        K R = 0, J R = 0: rigid motions that cost no force
    [J  0   0 ] [dt] = [dl   ]        C R regular: rows that hold them
    [C  0   0 ] [mu]   [0    ]        mu = 0 up to rounding: forces within the structure are orthogonal to R

The block of the inverse that belongs to dx, with R projected off, is Z (Z^T K Z)^-1 Z^T with Z the directions
orthogonal to J and R: its largest eigenvalue is one over the eigenvalue of the stiffness nearest zero.
"""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.system.arrays import FloatArray

LEAST_RAISE = float(np.finfo(np.float64).eps)  # [N/m], where a structure has no stiffness at all


class Bordered:
    """The factors of a stiffness with rows `border` (n_border, n), which hold the motions `held` (n, k)."""

    def __init__(self, stiffness: Any, border: Any, held: FloatArray) -> None:
        self._held = held  # orthonormal columns
        self.size, n_border = stiffness.shape[0], border.shape[0]
        self.unit = float(abs(stiffness).max()) if stiffness.nnz else 1.0  # of the border's rows [N/m]
        self.unit = self.unit or 1.0
        rows = scipy.sparse.csc_array(self.unit * border)
        corner = scipy.sparse.csc_array((n_border, n_border))
        self._matrix = scipy.sparse.block_array([[stiffness, rows.T], [rows, corner]], format="csc")
        self._factor = scipy.sparse.linalg.splu(self._matrix)

    def solve(self, right: FloatArray, border: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return dx (n, k), multipliers of the border (n_border, k) and what one refinement changed.

        right: (n, k) [N]; border: (n_border, k), what border dx shall be [m].
        """
        whole = np.vstack([right, self.unit * border])
        found = self._factor.solve(whole)
        change = self._factor.solve(whole - self._matrix @ found)
        found += change
        moved, part = np.abs(found[: self.size]), np.abs(change[: self.size])
        largest = float(moved.max(initial=0.0))
        relative = float(part.max(initial=0.0)) / largest if largest else 0.0
        return found[: self.size], self.unit * found[self.size :], relative

    def find_softest(self) -> tuple[float, FloatArray]:
        """Return the eigenvalue of the stiffness nearest zero, within the border [N/m], and its direction."""
        size = self.size
        if size <= DENSE_LIMIT:
            inverse = self._flexibility(np.eye(size))
            values, vectors = np.linalg.eigh((inverse + inverse.T) / 2)
            last = int(np.abs(values).argmax())
            value, vector = float(values[last]), vectors[:, last]
        else:
            operator = scipy.sparse.linalg.LinearOperator(
                (size, size), matvec=lambda v: self._flexibility(np.ravel(v)[:, None])[:, 0], dtype=float
            )
            start = np.random.default_rng(0).normal(size=size)
            found, columns = scipy.sparse.linalg.eigsh(operator, k=1, which="LM", v0=start, tol=1e-6)
            value, vector = float(found[0]), columns[:, 0]
        return (1.0 / value if value else float("inf")), vector

    def _flexibility(self, right: FloatArray) -> FloatArray:
        whole = np.zeros((self._matrix.shape[0], right.shape[1]))
        whole[: self.size] = self._project(right)
        return self._project(self._factor.solve(whole)[: self.size])

    def _project(self, columns: FloatArray) -> FloatArray:
        projected: FloatArray = columns - self._held @ (self._held.T @ columns)
        return projected


def factorise(stiffness: Any, border: Any, held: FloatArray, rounding: float) -> tuple[Bordered, bool]:
    """Return the factors, and whether the stiffness is regular on what the border leaves.

    Where a pivot is zero the factors are those of a stiffness with the eigenvalues raised by `rounding`
    [N/m] or more, which show the direction that nothing resists.
    """
    try:
        return Bordered(stiffness, border, held), True
    except RuntimeError:  # a pivot is zero
        return _factorise_raised(stiffness, border, held, rounding or LEAST_RAISE), False


def _factorise_raised(stiffness: Any, border: Any, held: FloatArray, raised: float) -> Bordered:
    try:
        whole = stiffness + raised * scipy.sparse.eye_array(stiffness.shape[0])
        return Bordered(scipy.sparse.csc_array(whole), border, held)
    except RuntimeError:  # a pivot is still zero, as where rounding takes away what was added
        return _factorise_raised(stiffness, border, held, 100 * raised)
