"""Reactions at anchored nodes: what balances members, loads and weight there."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray


def compute_reactions(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray,
    held: NDArray[np.int64],
    load: FloatArray | None = None,
    joints: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Return the forces [N] of supports on nodes, along the anchored axes.

    Parameters
    ----------
    structure : Structure
        Anchors, loads, masses.
    position : ndarray, shape (n_t, n_nodes, 3) [m]
        Positions.
    tension : ndarray, shape (n_t, n_members) [N]
        Tensions; NaN where unknown.
    held : ndarray of int, shape (n_held,)
        Anchored nodes.
    load : ndarray, shape (n_t, n_nodes, 3) [N], optional
        Loads on nodes, by default those of the structure.
    joints : ndarray of int, optional
        Nodes on which forces act that no member shows, such as those of bars of body scenes.

    Returns
    -------
    ndarray, shape (n_t, n_held, 3) [N]
        Reactions, NaN at joints and at nodes with a member of unknown tension; without the inertia of bars.
    """
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    weight = mass[:, None] * structure.gravity
    row = np.full(structure.n_nodes, -1)
    row[held] = np.arange(len(held))
    pushed = np.broadcast_to(structure.node_load if load is None else load, position.shape)
    acting = pushed[:, held] + weight[held]
    for end, sign in ((0, -1.0), (1, 1.0)):
        members = np.flatnonzero(row[structure.connectivity[:, end]] >= 0)
        if not members.size:
            continue
        pair = structure.connectivity[members]
        vector = position[:, pair[:, 0]] - position[:, pair[:, 1]]
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        unit = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
        pull = sign * tension[:, members, None] * unit
        np.add.at(acting.swapaxes(0, 1), row[pair[:, end]], pull.swapaxes(0, 1))
    if joints is not None:
        acting[:, np.isin(held, joints)] = np.nan
    reaction: FloatArray = np.where(structure.node_anchored[held], -acting, 0.0)
    return reaction
