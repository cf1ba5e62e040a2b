"""Stiffness of the free motions of a structure by its tensions, and a search for such tensions."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.analysis.configuration import Configuration
from tensegrity_codegen.runtime.analysis.linear_program import find_optimum
from tensegrity_codegen.runtime.analysis.mechanisms import FreeMotions
from tensegrity_codegen.runtime.analysis.prestress import Prestress
from tensegrity_codegen.system.arrays import FloatArray

MIN_STIFFNESS_RATIO = 1e-9  # least eigenvalue, over the largest force density, that counts as stiff
KEPT_TENSION_RATIO = 0.1  # part of the largest least tension that stabilising tensions keep
MOST_CUTS = 60


@dataclass(frozen=True)
class PrestressStability:
    """Stiffness that tensions give to the free motions.

    is_stable: whether the tensions stiffen every free motion, apart from rigid motions that cost no energy.
    smallest_eigenvalue: smallest eigenvalue of the geometric stiffness along these motions, over the largest
        force density; inf where there are none.
    eigenvalue (k,): all of them, ascending.
    direction (n_directions,): the unit motion of the smallest one; empty where there are none.
    """

    is_stable: bool
    smallest_eigenvalue: float
    eigenvalue: FloatArray
    direction: FloatArray


def find_prestress_stability(
    at: Configuration, motions: FreeMotions, tension: FloatArray, *, loaded: bool
) -> PrestressStability:
    """Find the least stiffness that tensions give to the free motions.

    at: the configuration.
    motions: its rigid motions and mechanisms.
    tension (n_members,): member tensions, in equilibrium.
    loaded: whether the loads belong to the tensions: these turn with bodies, and may hold rigid motions.
    Returns eigenvalues of sum t_e d2l_e/dx2 along the mechanisms; under loads along rigid motions too, as far
    as these cost energy.

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
        direction = np.zeros(0) if none else directions[:, 0]
        return PrestressStability(none, float("inf") if none else 0.0, value, direction)
    stiffness = at.geometric_stiffness(tension, directions) / size
    if loaded:
        stiffness = stiffness + at.load_stiffness(directions) / size
        kept = _leave_neutral(stiffness, motions)
        directions, stiffness = directions @ kept, kept.T @ stiffness @ kept
        if directions.shape[1] == 0:
            return PrestressStability(True, float("inf"), np.zeros(0), np.zeros(0))
    value, vector = np.linalg.eigh(stiffness)
    return PrestressStability(
        bool(value[0] > MIN_STIFFNESS_RATIO), float(value[0]), value, directions @ vector[:, 0]
    )


def find_stabilising_prestress(
    at: Configuration, motions: FreeMotions, selfstress: FloatArray, prestress: Prestress
) -> FloatArray | None:
    """Find self-stresses that stiffen all mechanisms, with every cable in tension.

    at: the configuration; motions: its mechanisms; selfstress (n_selfstress, n_members): basis of the
    self-stresses; prestress: tensions with all cables in tension that do not stiffen them.
    Returns (n_members,): tensions, the largest force 1, or None where none were found.

    The largest smallest eigenvalue of a matrix that is linear in the tensions, by cutting planes: each linear
    program has the constraints v . K(t) v >= s for the eigenvectors v found so far.
    """
    basis, modes = motions.mechanism, selfstress.T
    least = KEPT_TENSION_RATIO * prestress.least_tension if at.tension_only.any() else 0.0
    only, zero = modes[at.tension_only], np.zeros((len(modes), 1))
    rows = [np.hstack([-only, zero[: len(only)]]), np.hstack([modes, zero]), np.hstack([-modes, zero])]
    limit = [np.full(len(only), -least), np.ones(len(modes)), np.ones(len(modes))]
    cost = np.append(np.zeros(len(selfstress)), -1.0)
    cuts = [basis[:, k] for k in range(basis.shape[1])]
    for _ in range(MOST_CUTS):
        bends = np.array([at.curvature(v) for v in cuts])
        cut_rows = np.hstack([-bends @ modes, np.ones((len(cuts), 1))])
        found = find_optimum(
            cost, np.vstack([*rows, cut_rows]), np.concatenate([*limit, np.zeros(len(cuts))])
        )
        if found is None or found[-1] <= 0.0:
            return None
        tension = modes @ found[:-1]
        stability = find_prestress_stability(at, motions, tension, loaded=False)
        if stability.is_stable:
            return np.asarray(tension / np.abs(tension).max())
        cuts.append(stability.direction)
    return None


def _leave_neutral(stiffness: FloatArray, motions: FreeMotions) -> FloatArray:
    """Return an orthonormal basis of all combinations but the rigid motions without any stiffness, (k, j)."""
    mechanisms, rigid = motions.mechanism.shape[1], motions.rigid.shape[1]
    if rigid == 0:
        return np.eye(mechanisms)
    _, value, right = np.linalg.svd(stiffness[:, mechanisms:], full_matrices=True)
    size = np.concatenate([value, np.zeros(rigid - len(value))])
    kept = right[size > MIN_STIFFNESS_RATIO].T
    result = np.zeros((mechanisms + rigid, mechanisms + kept.shape[1]))
    result[:mechanisms, :mechanisms] = np.eye(mechanisms)
    result[mechanisms:, mechanisms:] = kept
    return result
