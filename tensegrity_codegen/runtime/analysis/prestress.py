"""Tensions with every cable in tension, by linear programming, and their stiffness of free motions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.analysis.configuration import Configuration
from tensegrity_codegen.runtime.analysis.linear_program import find_least_norm, find_optimum
from tensegrity_codegen.runtime.analysis.rank import FreeMotions
from tensegrity_codegen.system.arrays import FloatArray

# Least tension, over the largest member force, from which a cable counts as in tension.
MIN_TENSION_RATIO = 1e-10
MAX_FORCE_RATIO = 2.0  # largest member force allowed under loads, over the least that carries them
OPTIMUM_TOLERANCE = 1e-5  # difference of two optimal solutions, over the largest force, that counts as none
OPTIMUM_RELAXATION = 1e-6  # part of the least tension that is given up to find the least norm
MIN_STIFFNESS_RATIO = 1e-9  # least eigenvalue, over the largest force density, that counts as stiff
KEPT_TENSION_RATIO = 0.1  # part of the largest least tension that stabilising tensions keep
MAX_CUTS = 60
MOST_NAMES = 3  # of nodes that move most
SAME_MOTION = 1e-6  # of the largest motion of a node: differences that are rounding


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
        Least tension of the tension-only members, in the same unit; inf if there are none.
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
    """Find the tensions whose least cable tension is largest; load_tension: any that balance the loads.

    Maximise s subject to t = t_load + N^T x, t_c >= s for each cable c, |t_e| <= T for each member e. Without
    loads T = 1; with loads T is twice the least for which such tensions exist with slack cables allowed.
    Cables count as in tension from s = 1e-10 T. Among all optimal tensions those of least norm are taken,
    which have the symmetry of the structure.
    """
    base = np.zeros(selfstress.shape[1]) if load_tension is None else load_tension
    size = float(np.abs(base).max(initial=0.0))
    if not tension_only.any():
        if base.any() or len(selfstress) != 1:  # the least tensions that balance the loads
            return _describe(base - selfstress.T @ (selfstress @ base), tension_only)
        mode = selfstress[0]  # without loads the only self-stress, scaled to 1
        return _describe(np.asarray(mode / mode[np.abs(mode).argmax()]), tension_only)
    if len(selfstress) == 0:
        return _describe(base, tension_only)
    if size == 0.0:
        return _describe(_find_best(selfstress, tension_only, base, 1.0), tension_only)
    least_force = _find_least_force(selfstress, tension_only, base / size)
    if least_force is None:
        return _describe(base, tension_only)
    return _describe(
        _find_best(selfstress, tension_only, base / size, MAX_FORCE_RATIO * least_force) * size, tension_only
    )


def _describe(tension: FloatArray, tension_only: NDArray[np.bool_]) -> Prestress:
    largest = float(np.abs(tension).max(initial=0.0))
    least_tension = float(tension[tension_only].min(initial=np.inf))
    return Prestress(least_tension > MIN_TENSION_RATIO * largest, tension, least_tension, largest)


def _find_least_force(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], base: FloatArray
) -> float | None:
    """Return the least T with t_c >= 0 and |t_e| <= T; None if there are no such tensions."""
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
    optimum = find_optimum(cost, rows, limit)
    return None if optimum is None else float(optimum[-1])


def _find_best(
    selfstress: FloatArray, tension_only: NDArray[np.bool_], base: FloatArray, most: float
) -> FloatArray:
    """Return the tensions with the largest least cable tension and |t_e| <= most."""
    modes = selfstress.T
    cables, zero = modes[tension_only], np.zeros((len(modes), 1))
    rows = np.vstack(
        [np.hstack([-cables, np.ones((len(cables), 1))]), np.hstack([modes, zero]), np.hstack([-modes, zero])]
    )
    limit = np.concatenate([base[tension_only], most - base, most + base])
    cost = np.zeros(rows.shape[1])
    cost[-1] = -1.0
    optimum = find_optimum(cost, rows, limit)
    assert optimum is not None, "slack cables are allowed, so that there is an optimum"
    best: FloatArray = base + modes @ optimum[:-1]
    least_tension = float(best[tension_only].min())
    if least_tension <= MIN_TENSION_RATIO * most:
        return best
    bounds = np.vstack([cables, modes, -modes])
    floor = np.concatenate(
        [least_tension * (1 - OPTIMUM_RELAXATION) - base[tension_only], -most - base, -most + base]
    )
    weights = find_least_norm(bounds, floor)
    if weights is None:
        return best
    smallest: FloatArray = base + modes @ weights
    return best if np.abs(smallest - best).max() <= OPTIMUM_TOLERANCE * most else smallest


@dataclass(frozen=True)
class PrestressStability:
    """Stiffness that tensions give to the free motions."""

    is_stable: bool  # every free motion is stiff, apart from rigid motions that cost no energy
    smallest_eigenvalue: float  # of their geometric stiffness over the largest force density, or inf
    eigenvalue: FloatArray  # (k,), all of them, ascending
    direction: FloatArray  # (n_directions, k), their unit motions


def find_prestress_stability(
    at: Configuration, motions: FreeMotions, tension: FloatArray, *, loaded: bool
) -> PrestressStability:
    """Find the least stiffness that tensions, with their loads if `loaded`, give to the free motions.

    These are the eigenvalues of sum t_e d2l_e/dx2 along the mechanisms; under loads along rigid motions too,
    as far as these cost energy.
    Along a mechanism the second variation of the energy at large axial stiffness is that of the tensions
    (R. Connelly and W. Whiteley, "Second-order rigidity and prestress stability for tensegrity frameworks",
    SIAM Journal on Discrete Mathematics 9, 1996).
    """
    directions = np.hstack([motions.mechanism, motions.rigid]) if loaded else motions.mechanism
    density = np.abs(tension) / np.where(at.is_absent, np.inf, at.length)
    size = float(density.max(initial=0.0))
    if directions.shape[1] == 0 or size == 0.0:
        none = directions.shape[1] == 0
        value = np.zeros(directions.shape[1])
        return PrestressStability(none, float("inf") if none else 0.0, value, directions)
    stiffness = at.geometric_stiffness(tension, directions) / size
    if loaded:
        stiffness = stiffness + at.load_stiffness(directions) / size
        basis = _leave_neutral(stiffness, motions)
        directions, stiffness = directions @ basis, basis.T @ stiffness @ basis
        if directions.shape[1] == 0:
            return PrestressStability(True, float("inf"), np.zeros(0), directions)
    value, vector = np.linalg.eigh(stiffness)
    is_stable = bool(value[0] > MIN_STIFFNESS_RATIO)
    return PrestressStability(is_stable, float(value[0]), value, directions @ vector)


def name_moving(node_name: Sequence[str], motion: FloatArray) -> str:
    """Return the names of the nodes that move most in motions (n_nodes, 3) or (n_nodes, 3, k)."""
    size = np.linalg.norm(motion.reshape(len(motion), -1), axis=1)
    ratio = size / (size.max(initial=0.0) or 1.0)
    order = np.argsort(-np.round(ratio / SAME_MOTION), kind="stable").tolist()
    return ", ".join([*dict.fromkeys(node_name[n] for n in order if ratio[n] > SAME_MOTION)][:MOST_NAMES])


def find_stabilising_prestress(
    at: Configuration, motions: FreeMotions, selfstress: FloatArray, prestress: Prestress
) -> FloatArray | None:
    """Find self-stresses (n_members,) that stiffen all mechanisms, with every cable in tension, or None.

    The largest smallest eigenvalue of a matrix that is linear in the tensions, by cutting planes: each linear
    program has the constraints v . K(t) v >= s for the eigenvectors v found so far.
    """
    basis, modes = motions.mechanism, selfstress.T
    least_tension = KEPT_TENSION_RATIO * prestress.least_tension if at.tension_only.any() else 0.0
    only, zero = modes[at.tension_only], np.zeros((len(modes), 1))
    rows = [np.hstack([-only, zero[: len(only)]]), np.hstack([modes, zero]), np.hstack([-modes, zero])]
    limit = [np.full(len(only), -least_tension), np.ones(len(modes)), np.ones(len(modes))]
    cost = np.append(np.zeros(len(selfstress)), -1.0)
    cuts = [basis[:, k] for k in range(basis.shape[1])]
    for _ in range(MAX_CUTS):
        bends = np.array([at.curvature(v) for v in cuts])
        cut_rows = np.hstack([-bends @ modes, np.ones((len(cuts), 1))])
        optimum = find_optimum(
            cost, np.vstack([*rows, cut_rows]), np.concatenate([*limit, np.zeros(len(cuts))])
        )
        if optimum is None or optimum[-1] <= 0.0:
            return None
        tension = modes @ optimum[:-1]
        stability = find_prestress_stability(at, motions, tension, loaded=False)
        if stability.is_stable:
            return np.asarray(tension / np.abs(tension).max())
        cuts.append(stability.direction[:, 0])
    return None


def _leave_neutral(stiffness: FloatArray, motions: FreeMotions) -> FloatArray:
    """Return an orthonormal basis of all combinations but the rigid motions without any stiffness, (k, j)."""
    mechanisms, rigid = motions.mechanism.shape[1], motions.rigid.shape[1]
    if rigid == 0:
        return np.eye(mechanisms)
    _, value, right = np.linalg.svd(stiffness[:, mechanisms:], full_matrices=True)
    size = np.concatenate([value, np.zeros(rigid - len(value))])
    stiff_rigid = right[size > MIN_STIFFNESS_RATIO].T
    result = np.zeros((mechanisms + rigid, mechanisms + stiff_rigid.shape[1]))
    result[:mechanisms, :mechanisms] = np.eye(mechanisms)
    result[mechanisms:, mechanisms:] = stiff_rigid
    return result
