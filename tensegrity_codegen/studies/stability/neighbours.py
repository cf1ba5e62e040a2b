"""Where a structure can snap through: a node off the plane of its neighbours."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

LEAST_HEIGHT = 1e-2  # off its neighbours, over the mean member length


def find_snap(structure: Structure) -> tuple[int, FloatArray] | None:
    """Return a free node and its height (3,) [m] over the plane of its neighbours, None if all lie in it.

    The plane, in a planar scene the line, is that of least squares; the node is the first off it.
    """
    axes = list(structure.axes)
    least = LEAST_HEIGHT * float(structure.member_length().mean())
    for node in np.flatnonzero(~structure.node_anchored[:, axes].any(axis=1)):
        touching = structure.connectivity[(structure.connectivity == node).any(axis=1)]
        others = structure.node_position[np.setdiff1d(touching, node)][:, axes]
        if not len(others):
            continue
        centre = others.mean(axis=0)
        _, _, directions = np.linalg.svd(others - centre)
        normal = directions[-1]
        height = np.zeros(3)
        height[axes] = normal * (normal @ (structure.node_position[node, axes] - centre))
        if np.linalg.norm(height) > least:
            return int(node), height
    return None
