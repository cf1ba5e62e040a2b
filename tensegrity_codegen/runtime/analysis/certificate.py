"""Proof that no tensions have all cables in tension: displacements that anyone can check.

If a motion changes the length of no bar, lengthens no cable and shortens at least one, then no self-stress
has all cables in tension: the work of its tensions, sum t_e dl_e = t . A^T d = (A t) . d, is zero as A t = 0,
but each shortening cable in tension makes it smaller, and nothing makes it larger. Where there are no such
tensions, there always is such a motion (Farkas, Gordan).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.runtime.analysis.linear_program import find_least_norm, find_optimum
from tensegrity_codegen.runtime.analysis.rank import Rank, find_rank
from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape
from tensegrity_codegen.system.arrays import FloatArray

CHANGE_TOLERANCE = 1e-9  # largest change that is not allowed, over the largest shortening
NULL_SPACE_TOLERANCE = 1e-8  # singular values of the restricted self-stresses that count as zero
# A cable counts as shortening from this part of a shortening of 1; the second where the first gives no proof.
CHOSEN = (1e-11, 1e-4)
OPTIMUM_RELAXATION = 1e-6  # part of the least shortening that is given up to find the least norm
OPTIMUM_TOLERANCE = 1e-5  # difference of shortenings, next to 1, that counts as none
MAX_EVEN = 400  # shortening cables up to which the least norm is found
BALANCE_TOLERANCE = 1e-9  # part of the loads that no tensions balance, up to which they count as balanced


@dataclass(frozen=True)
class Certificate:
    """Displacements which prove that no tensions have all cables in tension.

    Attributes
    ----------
    displacement : ndarray, shape (n_coordinates,)
        Displacements of the coordinates, scaled so that the largest shortening is 1; where no cable shortens
        (then loads do work) so that the largest displacement is 1.
    elongation : ndarray, shape (n_members,)
        Changes of length, A^T d; negative where a member shortens.
    shortening : tuple of int
        Indices of the cables that shorten: the tension of each is zero in every state of tension without
        negative cable tensions.
    bar_change, cable_lengthening : float
        Largest change of a bar and largest lengthening of a cable: both zero but for rounding.
    least_shortening : float
        Least shortening of the cables that shorten; nan if there are none.
    load_work : float
        Work of the loads [N] in this motion, not negative; 0 without loads.
    error : float
        The larger of `bar_change` and `cable_lengthening`, over the largest shortening (or displacement).
    is_verified : bool
        Whether `error` is below 1e-9, and a cable that must be in tension shortens or loads do work.
    """

    displacement: FloatArray
    elongation: FloatArray
    shortening: tuple[int, ...]
    bar_change: float
    cable_lengthening: float
    least_shortening: float
    load_work: float
    error: float
    is_verified: bool


def check_balanced(rank: Rank, load: FloatArray) -> bool:
    """Return whether some tensions of either sign balance a load [N], up to 1e-9 of it."""
    return rank.find_tension(load)[1] <= BALANCE_TOLERANCE * float(np.linalg.norm(load))


def find_certificate(
    equilibrium_matrix: FloatArray,
    tension_only: NDArray[np.bool_],
    *,
    load: FloatArray | None = None,
    rank: Rank | None = None,
    required: NDArray[np.bool_] | None = None,
) -> Certificate | None:
    """Find displacements which prove that no tensions have all cables in tension.

    Parameters
    ----------
    equilibrium_matrix : ndarray, shape (n_coordinates, n_members)
        A; A^T d are the changes of lengths in displacements d.
    tension_only : ndarray of bool, shape (n_members,)
        Members that cannot be in compression. The others are bars, which may have either sign.
    load : ndarray, shape (n_coordinates,) [N], optional
        Loads that the tensions balance: A t = load. By default there are none.
    rank : Rank, optional
        That of the matrix, if it is known.
    required : ndarray of bool, shape (n_members,), optional
        Those of `tension_only` that must be in tension; the others may be slack. By default all.

    Returns
    -------
    Certificate or None
        Displacements with as many shortening cables as possible, which shorten as equally as possible; None
        where tensions exist with all cables in tension.

    Raises
    ------
    ConvergenceError
        The solver of the linear program failed.
    InvalidValueError, NonFiniteError
        A wrong shape, or numbers that are not finite.

    Notes
    -----
    Exactly one of two statements is true (Farkas, Gordan). Tensions exist: A t = f, t_c > 0 for each cable.
    Or displacements exist: (A^T d)_b = 0 for bars, (A^T d)_c <= 0 for cables, f . d >= 0, and one of the
    inequalities is strict. For cables that may be slack the first is t_c >= 0, and theirs need not be strict.
    The elongations e = A^T d are the vectors with N e = 0, N the self-stresses; so
    the linear programs have the shortenings of cables for unknowns, and d follows from e.
    """
    check_shape(tension_only, (equilibrium_matrix.shape[1],), "tension_only")
    rank = rank or find_rank(equilibrium_matrix)
    force = np.zeros(len(equilibrium_matrix)) if load is None else np.asarray(load, dtype=float)
    check_shape(force, (len(equilibrium_matrix),), "load")
    check_finite(force, "load")
    if required is not None:
        check_shape(required, tension_only.shape, "required")
        required = required & tension_only
    if not check_balanced(rank, force):
        pushed = rank.free_motion @ (rank.free_motion.T @ force)
        return _describe(equilibrium_matrix, tension_only, pushed, force, required)
    certificate = None
    pull, any_slack = rank.find_tension(force)[0], required is not None
    for shortening in _find_shortenings(rank.selfstress, tension_only, pull, with_work=any_slack):
        motion = rank.find_displacement(-shortening)
        certificate = _describe(equilibrium_matrix, tension_only, motion, force, required)
        if certificate.is_verified:
            return certificate
    return certificate


def _find_shortenings(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], load_tension: FloatArray, *, with_work: bool
) -> Iterator[FloatArray]:
    """Return shortenings (n_members,), the largest 1, best first; with_work: last that of the most work."""
    cables = np.flatnonzero(tension_only)
    size = float(np.abs(load_tension).max(initial=0.0))
    pull = load_tension[cables] / size if size else np.zeros(len(cables))
    support = _find_support(selfstress[:, cables], pull)
    for threshold in CHOSEN:
        chosen = np.flatnonzero(support > threshold)
        shortening = _find_even(selfstress[:, cables[chosen]], pull[chosen])
        if shortening is not None and shortening.max() > 0.0:
            result = np.zeros(len(tension_only))
            result[cables[chosen]] = shortening / shortening.max()
            yield result
    worked = _find_most_work(selfstress[:, cables], pull) if with_work and pull.any() else None
    if worked is not None and worked.max() > 0.0:
        result = np.zeros(len(tension_only))
        result[cables] = worked / worked.max()
        yield result


def _find_most_work(modes: FloatArray, pull: FloatArray) -> FloatArray | None:
    """Return the shortenings from 0 to 1 in which loads do the most work -pull . y, (n,)."""
    basis = _find_null_space(modes)
    count, free = basis.shape
    if free == 0:
        return None
    limit = np.repeat([0.0, 1.0], count)
    weights = find_optimum(pull @ basis, scipy.sparse.csr_array(scipy.sparse.vstack([-basis, basis])), limit)
    return None if weights is None else np.asarray(np.clip(basis @ weights, 0.0, None))


def _find_support(modes: FloatArray, pull: FloatArray) -> FloatArray:
    """Return for each cable its largest shortening up to 1 in a motion that proves it, (n,)."""
    basis = _find_null_space(modes)
    count, free = basis.shape
    largest = np.zeros(count)
    if free == 0:
        return largest
    rows = scipy.sparse.csr_array(
        scipy.sparse.vstack([-basis, basis, scipy.sparse.coo_array((pull @ basis)[None, :])])
    )
    limit = np.append(np.repeat([0.0, 1.0], count), 0.0)
    for _ in range(count):
        missing = largest <= CHOSEN[0]
        weights = find_optimum(-(basis.T @ missing.astype(float)), rows, limit)
        shortening = np.zeros(count) if weights is None else basis @ weights
        if not missing.any() or shortening[missing].max() <= CHOSEN[0]:
            break
        largest = np.maximum(largest, shortening)
    return largest


def _find_even(modes: FloatArray, pull: FloatArray) -> FloatArray | None:
    """Return shortenings up to 1 whose least one is largest, of least norm; None if there are none."""
    basis = _find_null_space(modes)
    count, free = basis.shape
    if free == 0:
        return None
    # Maximise s subject to s <= y <= 1 and pull . y <= 0, with y = basis x.
    column = np.ones((count, 1))
    blocks: Any = [
        [-basis, column],
        [basis, 0 * column],
        [scipy.sparse.coo_array((pull @ basis)[None, :]), None],
    ]
    limit = np.append(np.repeat([0.0, 1.0], count), 0.0)
    cost = np.append(np.zeros(free), -1.0)
    optimum = find_optimum(cost, scipy.sparse.csr_array(scipy.sparse.block_array(blocks)), limit)
    if optimum is None:
        return None
    best: FloatArray = basis @ optimum[:-1]
    if best.min() > 1 - OPTIMUM_TOLERANCE or count > MAX_EVEN:
        return best
    # Among all optima the one of least norm.
    square = np.linalg.qr(basis.toarray())[0]
    bounds = np.vstack([square, -square, -(pull @ square)[None, :]])
    floor = np.concatenate(
        [np.full(count, best.min() * (1 - OPTIMUM_RELAXATION)), np.full(count, -1.0), [0.0]]
    )
    weights = find_least_norm(bounds, floor)
    if weights is None:
        return best
    smallest: FloatArray = square @ weights
    return best if np.abs(smallest - best).max() <= OPTIMUM_TOLERANCE else smallest


def _find_null_space(modes: FloatArray) -> Any:
    """Return a sparse basis (n, k) of the vectors y with modes y = 0, modes (n_modes, n)."""
    count = modes.shape[1]
    if modes.size == 0:
        return scipy.sparse.csc_array(scipy.sparse.eye_array(count))
    _, upper, order = scipy.linalg.qr(modes, mode="economic", pivoting=True)
    rank = int((np.abs(np.diagonal(upper)) > NULL_SPACE_TOLERANCE).sum())
    dependent = -scipy.linalg.solve_triangular(upper[:rank, :rank], upper[:rank, rank:])
    blocks: Any = [scipy.sparse.coo_array(dependent), scipy.sparse.eye_array(count - rank)]
    return scipy.sparse.csc_array(scipy.sparse.csr_array(scipy.sparse.vstack(blocks))[np.argsort(order)])


def _describe(
    matrix: FloatArray,
    tension_only: NDArray[np.bool_],
    motion: FloatArray,
    load: FloatArray,
    required: NDArray[np.bool_] | None = None,
) -> Certificate:
    """Return the certificate of a motion, everything measured from the motion itself."""
    elongation = matrix.T @ motion
    shortest = float(-elongation[tension_only].min(initial=0.0))
    largest = float(np.abs(motion).max(initial=0.0))
    scale = shortest if shortest > CHANGE_TOLERANCE * largest else largest
    motion, elongation = motion / scale, elongation / scale
    cable = elongation[tension_only]
    shortening = np.flatnonzero(tension_only & (elongation < -CHANGE_TOLERANCE))
    bar_change = float(np.abs(elongation[~tension_only]).max(initial=0.0))
    lengthening = float(cable.max(initial=0.0))
    work, error = float(load @ motion), max(bar_change, lengthening)
    scale_of_work = float(np.linalg.norm(load) * np.linalg.norm(motion))
    does_work = work > CHANGE_TOLERANCE * scale_of_work
    shortens = len(shortening) > 0 if required is None else bool(required[shortening].any())
    is_proof = (shortens or does_work) and work >= -CHANGE_TOLERANCE * scale_of_work
    return Certificate(
        displacement=motion,
        elongation=elongation,
        shortening=tuple(int(e) for e in shortening),
        bar_change=bar_change,
        cable_lengthening=lengthening,
        least_shortening=float(-elongation[shortening].max()) if len(shortening) else float("nan"),
        load_work=max(work, 0.0) if does_work else 0.0,
        error=error,
        is_verified=bool(is_proof and error < CHANGE_TOLERANCE),
    )
