"""Convex quadratic programs by DAQP, every answer checked; the most progress by HiGHS.

DAQP (D. Arnström, A. Bemporad, D. Axehill, "A dual active-set solver for embedded quadratic programming using
recursive LDL^T updates", IEEE Transactions on Automatic Control 67, 2022) does not write the multipliers of
infeasible programs, and has reported an optimum of one. So answers count only if the constraints hold.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import linprog

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import CONTROL, import_extra

FEASIBLE = 1e-7  # violation of rows scaled to unit norm, up to which they count as satisfied
# Of both solvers, far below `FEASIBLE`: with 1e-7, good answers of HiGHS were refused.
PRIMAL_TOLERANCE = 1e-9
ZERO_NORM = 1e-14  # norm of a row, next to the largest, that counts as zero
INFINITE = 1e30  # of DAQP
EQUALITY, INEQUALITY = 5, 0  # of DAQP


@dataclass(frozen=True)
class Solution:
    """Minimiser (n,) and multipliers of the rows (n_rows,), positive at lower bounds."""

    x: FloatArray
    multiplier: FloatArray


@dataclass(frozen=True)
class _Scaled:
    """Constraints whose rows have unit norm; rows of zeros are left out."""

    kept: NDArray[np.bool_]
    norm: FloatArray
    rows: FloatArray
    lower: FloatArray
    upper: FloatArray

    def is_satisfied(self, x: FloatArray, tolerance: float) -> bool:
        reached = self.rows @ x
        return bool(np.all(reached >= self.lower - tolerance) and np.all(reached <= self.upper + tolerance))

    def answer(self, x: FloatArray, multiplier: FloatArray, tolerance: float = FEASIBLE) -> Solution | None:
        """Return the minimiser x with the multipliers of scaled rows; None unless it is one."""
        if not np.all(np.isfinite(x)) or not self.is_satisfied(x, tolerance):
            return None
        multipliers = np.zeros(len(self.kept))
        multipliers[self.kept] = multiplier / self.norm
        return Solution(x, multipliers)


def require_solver() -> None:
    """Raise MissingExtraError if DAQP is not installed."""
    import_extra("daqp", CONTROL)


def find_minimum(
    hessian: FloatArray, gradient: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> Solution | None:
    """Return the minimiser of x.H x / 2 + g.x with lower <= rows x <= upper, None without one."""
    scaled = _scale(rows, lower, upper)
    if scaled is None:
        return None
    x, is_found, multiplier = _solve(hessian, gradient, scaled.rows, scaled, PRIMAL_TOLERANCE)
    return scaled.answer(x, multiplier) if is_found else None


def find_nearest(
    matrix: FloatArray,  # (n_rows, n), of rank n
    target: FloatArray,  # (n_rows,)
    rows: FloatArray,  # (n_constraints, n)
    lower: FloatArray,  # (n_constraints,): bounds; equal ones are equations, infinite ones none
    upper: FloatArray,
    *,
    tolerance: float = PRIMAL_TOLERANCE,  # violation of rows scaled to unit norm that DAQP accepts
) -> Solution | None:
    """Return the minimiser of |matrix x - target|^2 / 2 with lower <= rows x <= upper, None without one.

    matrix = Q R; DAQP finds y = R x, the nearest to Q^T target. The square of the matrix, whose rounding
    errors are larger, is not formed.
    """
    scaled = _scale(rows, lower, upper)
    if scaled is None:
        return None
    q, r = np.linalg.qr(matrix)
    if not np.all(np.isfinite(r)) or not np.all(np.diag(r)):
        return None
    turned = solve_triangular(r, scaled.rows.T, trans="T").T
    y, is_found, multiplier = _solve(np.eye(len(r)), -(q.T @ target), turned, scaled, tolerance)
    if not is_found or not np.isfinite(y).all():
        return None
    return scaled.answer(solve_triangular(r, y), multiplier, max(FEASIBLE, 1e3 * tolerance))


def _solve(
    hessian: FloatArray, gradient: FloatArray, rows: FloatArray, scaled: _Scaled, tolerance: float
) -> tuple[FloatArray, bool, FloatArray]:
    """Return the answer of DAQP for the bounds of constraints, whether it is one, and the multipliers."""
    daqp = import_extra("daqp", CONTROL)
    sense = np.where(scaled.lower == scaled.upper, EQUALITY, INEQUALITY).astype(np.int32)
    x, _, flag, info = daqp.solve(
        np.ascontiguousarray(hessian),
        np.ascontiguousarray(gradient),
        np.ascontiguousarray(rows),
        np.minimum(scaled.upper, INFINITE),
        np.maximum(scaled.lower, -INFINITE),
        sense,
        primal_tol=tolerance,
    )
    return np.array(x, dtype=float), flag >= 1, -np.array(info["lam"], dtype=float)


def find_largest(gain: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray) -> Solution | None:
    """Return the x with the largest gain.x and lower <= rows x <= upper, by HiGHS; None without one.

    Multipliers are the gain for a unit less of a lower bound (positive) or more of an upper one (negative).
    """
    scaled = _scale(rows, lower, upper)
    if scaled is None:
        return None
    # Equations and inequalities, as HiGHS takes them.
    same = scaled.lower == scaled.upper
    low, high = ~same & np.isfinite(scaled.lower), ~same & np.isfinite(scaled.upper)
    optimum = linprog(
        -gain,
        A_ub=np.vstack([-scaled.rows[low], scaled.rows[high]]),
        b_ub=np.concatenate([-scaled.lower[low], scaled.upper[high]]),
        A_eq=scaled.rows[same],
        b_eq=scaled.lower[same],
        bounds=(None, None),
        method="highs",
        options={
            "primal_feasibility_tolerance": PRIMAL_TOLERANCE,
            "dual_feasibility_tolerance": PRIMAL_TOLERANCE,
        },
    )
    if optimum.status != 0 or optimum.x is None or not scaled.is_satisfied(optimum.x, FEASIBLE):
        return None
    # Multipliers of the rows as they were given.
    marginal = np.zeros(len(scaled.rows))
    marginal[low] -= optimum.ineqlin.marginals[: int(low.sum())]
    marginal[high] += optimum.ineqlin.marginals[int(low.sum()) :]
    multiplier = np.zeros(len(rows))
    multiplier[scaled.kept] = marginal / scaled.norm
    return Solution(np.asarray(optimum.x, dtype=float), multiplier)


def _scale(rows: FloatArray, lower: FloatArray, upper: FloatArray) -> _Scaled | None:
    """Return the constraints with rows of unit norm, None if a row contradicts itself."""
    norm = np.linalg.norm(rows, axis=1)
    is_nonzero = norm > ZERO_NORM * float(norm.max(initial=0.0))
    if np.any(lower[~is_nonzero] > FEASIBLE) or np.any(upper[~is_nonzero] < -FEASIBLE):
        return None
    norm = norm[is_nonzero]
    low, high = lower[is_nonzero] / norm, upper[is_nonzero] / norm
    if np.any(low > high + FEASIBLE):
        return None
    return _Scaled(
        is_nonzero, norm, np.ascontiguousarray(rows[is_nonzero] / norm[:, None]), low, np.maximum(low, high)
    )
