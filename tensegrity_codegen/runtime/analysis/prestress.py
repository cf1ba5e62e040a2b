"""Tensions with every cable in tension, by linear programming."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.analysis.linear_program import find_least_norm, find_optimum
from tensegrity_codegen.system.arrays import FloatArray

# Least tension, over the largest member force, from which a cable counts as in tension.
MIN_TENSION_RATIO = 1e-10
MAX_FORCE_RATIO = 2.0  # largest member force allowed under loads, over the least that carries them
OPTIMUM_TOLERANCE = 1e-5  # difference of two optimal solutions, over the largest force, that counts as none
OPTIMUM_RELAXATION = 1e-6  # part of the least tension that is given up to find the least norm


@dataclass(frozen=True)
class Prestress:
    """The tensions whose least cable tension is largest.

    Attributes
    ----------
    is_found : bool
        Whether every cable is in tension.
    tension : ndarray, shape (n_members,)
        Member tensions: without loads scaled so that the largest force is 1, under loads in [N].
    least_tension : float
        Least tension of the tension-only members, in the same unit; inf where there are none.
    largest_force : float
        Largest force of a member, in the same unit.
    """

    is_found: bool
    tension: FloatArray
    least_tension: float
    largest_force: float


def find_prestress(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], *, load_tension: FloatArray | None = None
) -> Prestress:
    """Find the tensions whose least cable tension is largest.

    Parameters
    ----------
    selfstress : ndarray, shape (n_selfstress, n_members)
        Basis of the self-stresses, see `find_rank`.
    tension_only : ndarray of bool, shape (n_members,)
        Members that must be in tension; the others may have either sign.
    load_tension : ndarray, shape (n_members,), optional
        Any tensions [N] that balance the loads; by default there are no loads.

    Returns
    -------
    Prestress
        The tensions; `is_found` is False where some cable cannot be in tension.

    Raises
    ------
    ConvergenceError
        The solver of the linear program failed.

    Notes
    -----
    Maximise s subject to t = t_load + N^T x, t_c >= s for each cable c, |t_e| <= T for each member e. Without
    loads T = 1; with loads T is twice the least for which such tensions exist with slack cables allowed.
    Cables count as in tension from s = 1e-10 T. Among all optimal tensions those of least norm are taken,
    which have the symmetry of the structure.
    """
    base = np.zeros(selfstress.shape[1]) if load_tension is None else load_tension
    size = float(np.abs(base).max(initial=0.0))
    if not tension_only.any():
        return _describe(_find_smallest(selfstress, base), tension_only)
    if len(selfstress) == 0:
        return _describe(base, tension_only)
    if size == 0.0:
        return _describe(_find_best(selfstress, tension_only, base, 1.0), tension_only)
    least = _find_least_force(selfstress, tension_only, base / size)
    if least is None:
        return _describe(base, tension_only)
    return _describe(
        _find_best(selfstress, tension_only, base / size, MAX_FORCE_RATIO * least) * size, tension_only
    )


def _describe(tension: FloatArray, tension_only: NDArray[np.bool_]) -> Prestress:
    largest = float(np.abs(tension).max(initial=0.0))
    least = float(tension[tension_only].min(initial=np.inf))
    return Prestress(least > MIN_TENSION_RATIO * largest, tension, least, largest)


def _find_smallest(selfstress: FloatArray, base: FloatArray) -> FloatArray:
    """Return the least tensions that balance the loads; without loads the only self-stress, scaled to 1."""
    if base.any() or len(selfstress) != 1:
        smallest: FloatArray = base - selfstress.T @ (selfstress @ base)
        return smallest
    mode = selfstress[0]
    return np.asarray(mode / mode[np.abs(mode).argmax()])


def _find_least_force(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], base: FloatArray
) -> float | None:
    """Return the least T with t_c >= 0 and |t_e| <= T; None where there are no such tensions."""
    modes = selfstress.T
    column = np.ones((len(modes), 1))
    cables = modes[tension_only]
    rows = np.vstack(
        [
            np.hstack([modes, -column]),
            np.hstack([-modes, -column]),
            np.hstack([-cables, np.zeros((len(cables), 1))]),
        ]
    )
    limit = np.concatenate([-base, base, base[tension_only]])
    cost = np.zeros(rows.shape[1])
    cost[-1] = 1.0
    found = find_optimum(cost, rows, limit)
    return None if found is None else float(found[-1])


def _find_best(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], base: FloatArray, most: float
) -> FloatArray:
    """Return the tensions with the largest least cable tension and |t_e| <= most."""
    modes = selfstress.T
    cables, zero = modes[tension_only], np.zeros((len(modes), 1))
    rows = np.vstack(
        [
            np.hstack([-cables, np.ones((len(cables), 1))]),
            np.hstack([modes, zero]),
            np.hstack([-modes, zero]),
        ]
    )
    limit = np.concatenate([base[tension_only], most - base, most + base])
    cost = np.zeros(rows.shape[1])
    cost[-1] = -1.0
    found = find_optimum(cost, rows, limit)
    assert found is not None, "slack cables are allowed, so that there is an optimum"
    best: FloatArray = base + modes @ found[:-1]
    least = float(best[tension_only].min())
    if least <= MIN_TENSION_RATIO * most:
        return best
    bounds = np.vstack([cables, modes, -modes])
    floor = np.concatenate(
        [least * (1 - OPTIMUM_RELAXATION) - base[tension_only], -most - base, -most + base]
    )
    part = find_least_norm(bounds, floor)
    if part is None:
        return best
    smallest: FloatArray = base + modes @ part
    return best if np.abs(smallest - best).max() <= OPTIMUM_TOLERANCE * most else smallest
