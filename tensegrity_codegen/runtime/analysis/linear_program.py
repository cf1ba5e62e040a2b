"""Linear programs to more digits than the solver's tolerances."""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

REFINEMENT_SCALE = 1e-6  # size of one refinement, next to that of the one before
ROUNDS = 2
ROUNDING = 1e-14  # violations that count as none
MAX_REFINEMENT = 1e3  # largest change in a refinement, in its own size
TOLERANCES = (1e-10, 1e-9, 1e-8, 1e-7)  # of HiGHS; the first is the least there is, the last the default
INFEASIBLE = 2  # status of scipy.optimize.linprog


def find_optimum(cost: FloatArray, rows: Any, limit: FloatArray) -> FloatArray | None:
    """Find x with the least cost . x and rows x <= limit, to rounding; None if there is no such x.

    The solver's tolerances would blur the ends of ranges. So where its solution is not exact to rounding, the
    problem is solved again for the change of x, with the slack of the inequalities magnified a million times,
    twice (A. M. Gleixner, D. E. Steffy and K. Wolter, "Iterative refinement for linear programming", INFORMS
    Journal on Computing 28, 2016).
    """
    optimum = _solve(cost, rows, limit, None)
    if optimum is None:
        return None
    for round_ in range(1, ROUNDS + 1):
        if float((rows @ optimum - limit).max(initial=0.0)) <= ROUNDING:
            break  # a vertex, exact to rounding
        zoom = REFINEMENT_SCALE**round_
        slack = np.minimum((limit - rows @ optimum) / zoom, MAX_REFINEMENT / REFINEMENT_SCALE)
        change = _solve(cost, rows, slack, MAX_REFINEMENT)
        if change is None:
            break  # rounding of the slack itself; what was found stays
        better = optimum + zoom * change
        # Better is what violates the limits less, or as much at a lower cost.
        excess = max(float((rows @ better - limit).max(initial=0.0)), ROUNDING)
        before = max(float((rows @ optimum - limit).max(initial=0.0)), ROUNDING)
        if excess < before or (excess == before and float(cost @ (better - optimum)) < 0.0):
            optimum = better
    return optimum


def _solve(cost: FloatArray, rows: Any, limit: FloatArray, most: float | None) -> FloatArray | None:
    """Return an optimum with all variables up to `most`, None if there is none; ConvergenceError."""
    bounds: Any = (None, None) if most is None else (-most, most)
    for tolerance in TOLERANCES:
        options: Any = {"primal_feasibility_tolerance": tolerance, "dual_feasibility_tolerance": tolerance}
        result = scipy.optimize.linprog(
            cost, A_ub=rows, b_ub=limit, bounds=bounds, method="highs", options=options
        )
        if result.status == 0:
            return np.asarray(result.x, dtype=float)
        if result.status == INFEASIBLE or most is not None:
            return None
    raise ConvergenceError(
        f"the linear program was not solved: {result.message}",
        evidence={"status": int(result.status)},
        where="HiGHS",
        hint="check that all positions and loads are of sensible size",
    )


def find_least_norm(rows: FloatArray, least: FloatArray) -> FloatArray | None:
    """Find the x of least norm with rows x >= least; None if there is none.

    C. L. Lawson and R. J. Hanson, "Solving least squares problems", 1974, chapter 23: least distance
    programming by non-negative least squares.
    """
    size = rows.shape[1]
    system = np.vstack([rows.T, least])
    target = np.zeros(size + 1)
    target[-1] = 1.0
    try:
        weight, _ = scipy.optimize.nnls(system, target)
    except RuntimeError:  # too many iterations
        return None
    residual = system @ weight - target
    if -residual[-1] <= 1e-12:
        return None
    return np.asarray(-residual[:-1] / residual[-1])
