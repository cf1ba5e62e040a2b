"""What a run is judged by besides its error, from its positions: the lengths of rigid bars."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray


def find_length_error(structure: Structure, node_position: FloatArray) -> float | None:
    """Return the largest change of length of a rigid bar [m] over the samples, None without rigid bars."""
    rigid = structure.is_rigid
    if not rigid.any() or not len(node_position):
        return None
    ends = structure.connectivity[rigid]
    length = np.linalg.norm(node_position[:, ends[:, 0]] - node_position[:, ends[:, 1]], axis=2)
    return float(np.abs(length - structure.rest_length[rigid]).max())
