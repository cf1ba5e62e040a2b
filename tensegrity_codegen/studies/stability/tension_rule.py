"""How exactly tensions are known where a state is known within a tolerance, to first order."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

ROUNDING = 1e-15  # of positions, in lengths of members and so in their tensions


def tension_tolerance(
    structure: Structure, state: FloatArray, allowed: FloatArray, own: NDArray[np.bool_]
) -> FloatArray:
    """Return what errors `allowed` (n_t, n_states) of states come to in tensions, (n_t, n_members) [N].

    own: which members have tensions that do not follow from lengths, rigid ones at least.

        mu dl + c (dl' + 2 |d'| dl / l)      of a spring; of a damped cable near its kink c |l'| besides
        m (2 |d'| dl' / l + |d'|^2 dl / l^2) + what the others come to + sqrt(mu m) dl'      of these
    """
    position, velocity = np.split(state, 2, axis=1)
    place, speed = _of_nodes(structure, position, structure.node_position), _of_nodes(structure, velocity)
    far, fast = (_of_nodes(structure, part) for part in np.split(allowed, 2, axis=1))
    i, j = structure.connectivity.T
    vector, moving = place[:, i] - place[:, j], speed[:, i] - speed[:, j]
    length = np.maximum(np.linalg.norm(vector, axis=2), 1e-300)
    pace = np.linalg.norm(moving, axis=2)
    dl, dv = (np.linalg.norm(x[:, i], axis=2) + np.linalg.norm(x[:, j], axis=2) for x in (far, fast))
    dl = dl + ROUNDING * np.abs(place).max(axis=(1, 2), initial=0.0)[:, None]
    turned = dv + 2.0 * pace * dl / length
    mu, c = structure.mu, structure.damping
    springs = mu * dl + c * turned
    near = structure.tension_only & (np.abs(length - structure.rest_length) <= dl)
    springs += np.where(near, c * np.abs(np.sum(vector * moving, axis=2)) / length, 0.0)
    mass = structure.node_mass.copy()
    np.add.at(mass, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    rigid = (mass[i] + mass[j]) * (2.0 * pace * dv / length + (pace / length) ** 2 * dl)
    rigid += springs[:, ~own].sum(axis=1)[:, None]
    rigid += np.sqrt(mu * _reduced(structure, mass)) * dv.max(axis=0)
    found: FloatArray = np.where(own, rigid, springs)
    return found


def _reduced(structure: Structure, mass: FloatArray) -> FloatArray:
    """Return the masses (n_members,) with which members vibrate, 1 / (1 / m_i + 1 / m_j)."""
    held = structure.node_anchored[:, list(structure.axes)].all(axis=1)
    inverse = np.where(held, 0.0, 1.0 / np.maximum(mass, 1e-300))[structure.connectivity].sum(axis=1)
    return np.asarray(np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), 0.0))


def _of_nodes(structure: Structure, values: FloatArray, others: FloatArray | float = 0.0) -> FloatArray:
    """Return values (n_t, n_coordinates) as (n_t, n_nodes, 3), those of anchored axes as in `others`."""
    node, axis = structure.coordinate_node_axis.T
    found = np.zeros((len(values), structure.n_nodes, 3))
    found += others
    found[:, node, axis] = values
    return found
