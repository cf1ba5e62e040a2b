"""Discrete Riccati equations: the stationary solution, and the recursion backwards from it."""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_discrete_are

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

RESIDUAL = 1e-10  # of |P|
MOST_POLISHING = 20
MOST_DOUBLINGS, DOUBLED = 60, 1e-15


def compute_gain(p: FloatArray, a: FloatArray, b: FloatArray, r: FloatArray) -> FloatArray:
    """Return K = (R + B^T P B)^-1 B^T P A, shape (m, n)."""
    factor = cho_factor(r + b.T @ p @ b)
    return np.asarray(cho_solve(factor, b.T @ p @ a))


def step_back(
    p: FloatArray, a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return P one sample earlier, and the gain there.

    Parameters
    ----------
    p : ndarray, shape (n, n)
        Cost to go after the sample.
    a, b : ndarray, shape (n, n) and (n, m)
        x[k+1] = a x[k] + b u[k].
    q, r : ndarray, shape (n, n) and (m, m)
        Weights.

    Returns
    -------
    p : ndarray, shape (n, n)
        Q + K^T R K + (A - B K)^T P (A - B K), symmetric and positive semidefinite in rounded arithmetic too.
    gain : ndarray, shape (m, n)
        K, for u = -K x.
    """
    gain = compute_gain(p, a, b, r)
    closed = a - b @ gain
    earlier = q + gain.T @ r @ gain + closed.T @ p @ closed
    return 0.5 * (earlier + earlier.T), gain


def find_stationary(
    a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray, where: str
) -> tuple[FloatArray, float]:
    """Return the stabilising solution of the stationary Riccati equation, and its residual over |P|.

    Parameters
    ----------
    a, b, q, r : ndarray
        As in `step_back`.
    where : str
        For errors.

    Returns
    -------
    p : ndarray, shape (n, n)
        P = Q + K^T R K + (A - B K)^T P (A - B K).
    residual : float
        Largest entry of the difference of both sides over that of P.

    Raises
    ------
    ConvergenceError
        No solution was found whose residual is below RESIDUAL.

    Notes
    -----
    The structure-preserving doubling algorithm (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang,
    "Structure-preserving algorithms for periodic discrete-time algebraic Riccati equations", International
    Journal of Control 77, 2004): k steps of it are 2^k steps of the recursion. Where its solution does not
    stabilise the system (an unstable motion without weight), the ordered QZ decomposition of SciPy. Then the
    recursion itself, which contracts towards P.
    """
    p = _double(a, b, q, r)
    if p is None or not _is_stable(a - b @ compute_gain(p, a, b, r)):
        p = _decompose(a, b, q, r, where)
    best, residual = p, np.inf
    for _ in range(MOST_POLISHING):
        following, _ = step_back(p, a, b, q, r)
        now = float(np.abs(following - p).max() / np.abs(p).max())
        if now < residual:
            best, residual = p, now
        if residual < 0.01 * RESIDUAL:
            break
        p = following
    if not residual < RESIDUAL:
        raise ConvergenceError(
            "the stationary Riccati equation is not solved",
            evidence={"residual over |P|": residual, "allowed": RESIDUAL},
            where=where,
            hint="scale the weights nearer to each other",
        )
    return best, residual


def _double(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray | None:
    """Return the limit of the recursion from P = 0 backwards by doubling; None where it has none."""
    n = len(a)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            through, reach, cost = a, b @ cho_solve(cho_factor(r), b.T), q
        except (LinAlgError, ValueError):  # not definite, or not finite
            return None
    for _ in range(MOST_DOUBLINGS):
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                solved = np.linalg.solve(np.eye(n) + reach @ cost, np.hstack([through, reach]))
            except np.linalg.LinAlgError:
                return None
            added = through.T @ cost @ solved[:, :n]
            reach = reach + through @ solved[:, n:] @ through.T
            cost, through = cost + added, through @ solved[:, :n]
            reach, cost = 0.5 * (reach + reach.T), 0.5 * (cost + cost.T)
        if not all(np.isfinite(item).all() for item in (cost, reach, through)):
            return None
        size = float(np.abs(cost).max())
        if np.abs(added).max() <= DOUBLED * size:
            return cost
    return None


def _is_stable(closed: FloatArray) -> bool:
    return bool(np.abs(np.linalg.eigvals(closed)).max(initial=0.0) < 1.0)


def _decompose(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray, where: str) -> FloatArray:
    """Return the stabilising solution by the QZ decomposition; raises ConvergenceError without one."""
    try:
        p = np.asarray(solve_discrete_are(a, b, q, r), dtype=np.float64)
    except (LinAlgError, ValueError) as error:
        raise ConvergenceError(
            "the stationary Riccati equation has no solution that stabilises the system",
            evidence={"reason": str(error)},
            where=where,
            hint="give all states a weight, or scale the weights nearer to each other",
        ) from error
    return 0.5 * (p + p.T)
