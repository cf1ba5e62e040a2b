"""Numbers of self-stresses, mechanisms and rigid motions at the stated positions, without a model."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.statics.rigid_motion import build_rigid_motions
from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure

ZERO_TOLERANCE = 1e-6  # of the largest singular value: as the default tolerance of `analyse`
# Coordinates or members, of the smaller number, of a dense eigenvalue problem below a second.
MAX_DENSE_SIZE = 1500


@dataclass(frozen=True)
class Freedom:
    """Numbers of self-stresses, of mechanisms, and of rigid motions that the anchors permit."""

    n_selfstress: int
    n_mechanisms: int
    n_rigid_motions: int


def count_freedom(structure: Structure) -> Freedom | None:
    """Count self-stresses and motions at the stated positions by the rank of the equilibrium matrix.

    Returns the numbers; None for more than 1,500 coordinates and members.

    The rank is that of A A^T or A^T A, whichever is smaller: squares lose the digits by which `analyse`
    tells a singular value of 1e-9 from rounding, so both count as zero here.
    """
    free = structure.coordinate_node_axis
    n, m = len(free), structure.n_members
    if min(n, m) > MAX_DENSE_SIZE:
        return None
    strands = structure.strands
    first, second = strands.ends.T
    matrix = np.zeros((structure.n_nodes, m, 3))
    unit, _ = strands.directions(structure.node_position)
    for node, sign in ((first, 1.0), (second, -1.0)):
        np.add.at(matrix, (node, strands.member), sign * unit)
    matrix = matrix[free[:, 0], :, free[:, 1]]
    square = np.linalg.eigvalsh(matrix @ matrix.T if n < m else matrix.T @ matrix)
    rank = int((square > ZERO_TOLERANCE**2 * square.max(initial=0.0)).sum())
    piece = find_pieces(structure.n_nodes, first, second)[1]
    rigid = sum(
        build_rigid_motions(
            structure, structure.node_position, nodes=np.flatnonzero(piece == k).tolist()
        ).shape[1]
        for k in np.unique(piece[free[:, 0]])
    )
    return Freedom(m - rank, max(n - rank - rigid, 0), rigid)
