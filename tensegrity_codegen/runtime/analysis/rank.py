"""Rank of an equilibrium matrix, by its singular values; free motions; numbers without a model."""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.arrays import check_finite
from tensegrity_codegen.runtime.statics.static_problem import build_rigid_motions
from tensegrity_codegen.structure.pieces import find_pieces
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Manifest

MAX_ROWS = 3000  # coordinates or members; the dense decomposition of so many takes about a minute
RANK_TOLERANCE = 1e-6  # of the largest singular value: those up to it count as zero
MIN_CLEAR_GAP = 1e3  # ratio of the two singular values at the gap from which the rank is clear
NEAR_ZERO_FACTOR = 1e2  # times the tolerance: a value below that which counts is near to being zero
EPSILON = float(np.finfo(float).eps)
ZERO_MOTION_TOLERANCE = 1e-6  # part of a unit motion that counts as none
ZERO_TOLERANCE = 1e-6  # of the largest singular value: as the default tolerance of `analyse`
# Coordinates or members, of the smaller number, of a dense eigenvalue problem below a second.
MAX_DENSE_SIZE = 1500


@dataclass(frozen=True)
class Rank:
    """Rank of an equilibrium matrix A (n_coordinates, n_members), and the spaces that belong to it.

    Attributes
    ----------
    rank, largest_rank : int
        The rank, and the smaller number of rows and columns.
    singular_value : ndarray, shape (largest_rank,)
        Singular values, descending.
    tolerance, rounding : float
        Singular values up to `tolerance`, times the largest, count as zero; rounding is up to `rounding`,
        times the largest.
    above, below : float
        The least singular value that counts, and the largest that counts as zero; nan if there is none.
    gap : float
        Their ratio, the lower one at least the rounding; inf if no value counts as zero.
    warning : str
        Why the rank is not clear, or an empty text.
    selfstress : ndarray, shape (n_selfstress, n_members)
        Orthonormal self-stresses: A t = 0.
    free_motion : ndarray, shape (n_coordinates, n_coordinates - rank)
        Orthonormal motions at which no member changes its length: A^T d = 0.
    left, right : ndarray, shape (n_coordinates, rank) and (rank, n_members)
        The other singular vectors.
    """

    rank: int
    largest_rank: int
    singular_value: FloatArray
    tolerance: float
    rounding: float
    above: float
    below: float
    gap: float
    warning: str
    selfstress: FloatArray
    free_motion: FloatArray
    left: FloatArray
    right: FloatArray

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates, the rows of the matrix."""
        return len(self.free_motion)

    @property
    def n_members(self) -> int:
        """Number of members, the columns of the matrix."""
        return int(self.selfstress.shape[1])

    def find_tension(self, load: FloatArray) -> tuple[FloatArray, float]:
        """Return the least tensions t (n_members,) [N] with A t = load, and the norm of the remainder [N]."""
        tension = ((self.left.T @ load) / self.singular_value[: self.rank]) @ self.right
        return tension, float(np.linalg.norm(self.free_motion.T @ load))

    def find_displacement(self, elongation: FloatArray) -> FloatArray:
        """Return the least displacements d (n_coordinates,) with A^T d = elongation (n_members,)."""
        displacement: FloatArray = self.left @ ((self.right @ elongation) / self.singular_value[: self.rank])
        return displacement


def find_rank(
    matrix: FloatArray,
    *,
    tolerance: float = RANK_TOLERANCE,
    rounding: float = 0.0,
    absent: NDArray[np.bool_] | None = None,
) -> Rank:
    """Find the rank of an equilibrium matrix (n_coordinates, n_members), self-stresses and free motions.

    rounding: relative error of the entries where it is above that of double precision. absent: members
    without length, and so without direction, that carry no tension. Counted as zero are all values up to the
    tolerance (S. Pellegrino, "Structural computations with the singular value decomposition of the
    equilibrium matrix", International Journal of Solids and Structures 30, 1993).
    """
    check_finite(matrix, "equilibrium_matrix")
    _check_size(matrix)
    n, m = matrix.shape
    # Singular values of the columns of members that have a direction.
    present = np.ones(m, dtype=bool) if absent is None else ~absent
    left, value, own = np.linalg.svd(matrix[:, present], full_matrices=True)
    right = np.zeros((len(own), m))
    right[:, present] = own
    # Values that count, and zeros.
    largest = float(value.max(initial=0.0))
    rounding_bound = max(rounding, EPSILON) * 8 * max(n, m, 1)
    relative = value / largest if largest else value
    rank = int((relative > max(tolerance, rounding_bound)).sum())
    above = float(value[rank - 1]) if rank else float("nan")
    below = float(value[rank]) if rank < len(value) else float("nan")
    gap = above / max(below, rounding_bound * largest) if rank and rank < len(value) else float("inf")
    return Rank(
        rank=rank,
        largest_rank=len(value),
        singular_value=value,
        tolerance=tolerance,
        rounding=rounding_bound,
        above=above,
        below=below,
        gap=gap,
        warning=_describe_doubt(relative, rank, gap, tolerance),
        selfstress=right[rank:],
        free_motion=left[:, rank:],
        left=left[:, :rank],
        right=right[:rank],
    )


def _describe_doubt(relative: FloatArray, rank: int, gap: float, tolerance: float) -> str:
    """Return why the rank is not clear, an empty text if it is."""
    if gap < MIN_CLEAR_GAP:
        return (
            f"the rank is not clear: the singular values at the gap, {relative[rank - 1]:.3g} and "
            f"{relative[rank]:.3g} of the largest, differ by a factor of {gap:.3g} only"
        )
    if rank and relative[rank - 1] <= NEAR_ZERO_FACTOR * tolerance:
        return (
            f"the rank is not clear: the smallest singular value that counts as not zero is "
            f"{relative[rank - 1]:.3g} of the largest, next to the tolerance of {tolerance:g}; in a rounded "
            f"shape it may be zero: `rank_tolerance={_round_up(relative[rank - 1])}` counts it so"
        )
    return ""


def _round_up(value: float) -> str:
    """Return a power of ten above a positive number, as a text."""
    return f"1e{math.floor(math.log10(value)) + 1:d}"


def _check_size(matrix: FloatArray) -> None:
    if max(matrix.shape, default=0) > MAX_ROWS:
        raise FormulationError(
            "the structure is too large for this analysis, which decomposes a dense matrix",
            where="equilibrium_matrix",
            given=f"{matrix.shape[0]} coordinates, {matrix.shape[1]} members",
            allowed=f"up to {MAX_ROWS} of each",
            hint="analyse a part of it, for example one module with its ends anchored",
        )


@dataclass(frozen=True)
class FreeMotions:
    """Orthonormal motions at which no member changes its length, to first order."""

    rigid: FloatArray  # (n_coordinates, n_rigid), those of each part by itself
    mechanism: FloatArray  # (n_coordinates, n_mechanisms), changes of shape, orthogonal to the rigid ones


def find_free_motions(rank: Rank, rigid: FloatArray) -> FreeMotions:
    """Return the free motions, given the rigid ones (n_coordinates, n_rigid), orthonormal."""
    free = rank.free_motion
    inner = free - rigid @ (rigid.T @ free)
    directions, size, _ = np.linalg.svd(inner, full_matrices=False)
    count = max(free.shape[1] - rigid.shape[1], 0)
    count = min(count, int((size > ZERO_MOTION_TOLERANCE).sum()))
    return FreeMotions(rigid, directions[:, :count])


def find_parts(manifest: Manifest) -> tuple[tuple[int, ...], ...]:
    """Return the nodes of each part of a structure that no members join to the others, by index."""
    count = len(manifest.node_name)
    ends = manifest.joined
    graph = scipy.sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    free = np.zeros(count, dtype=bool)
    free[[node for node, _ in manifest.coordinate_node_axis]] = True
    pieces = [np.flatnonzero(label == k) for k in range(int(label.max(initial=-1)) + 1)]
    return tuple(tuple(int(n) for n in piece) for piece in pieces if free[piece].any())


def build_part_motions(
    manifest: Manifest, position: FloatArray, parts: tuple[tuple[int, ...], ...]
) -> FloatArray:
    """Return an orthonormal basis of the rigid motions of each part at node positions, (n_coordinates, k)."""
    motions = [build_rigid_motions(manifest, position, nodes=piece) for piece in parts]
    count = len(manifest.coordinate_node_axis)
    return np.hstack(motions) if motions else np.zeros((count, 0))


@dataclass(frozen=True)
class Freedom:
    """Numbers of self-stresses, of mechanisms, and of rigid motions that the anchors permit."""

    n_selfstress: int
    n_mechanisms: int
    n_rigid_motions: int


def count_freedom(structure: Structure) -> Freedom | None:
    """Count self-stresses and motions at the stated positions; None above 1,500 coordinates and members.

    The rank is that of A A^T or A^T A, whichever is smaller: squares lose the digits by which `analyse`
    tells a singular value of 1e-9 from rounding, so both count as zero here.
    """
    free = structure.coordinate_node_axis
    n, m = len(free), structure.n_members
    if min(n, m) > MAX_DENSE_SIZE:
        return None
    strands = structure.strands
    start, end = strands.ends.T
    matrix = np.zeros((structure.n_nodes, m, 3))
    unit, _ = strands.directions(structure.node_position)
    for node, sign in ((start, 1.0), (end, -1.0)):
        np.add.at(matrix, (node, strands.member), sign * unit)
    for body in structure.body_places:
        body.gather(np.swapaxes(matrix, 0, 1))
    matrix = matrix[free[:, 0], :, free[:, 1]]
    square = np.linalg.eigvalsh(matrix @ matrix.T if n < m else matrix.T @ matrix)
    rank = int((square > ZERO_TOLERANCE**2 * square.max(initial=0.0)).sum())
    piece = find_pieces(structure.n_nodes, *structure.joined.T)[1]
    rigid = sum(
        build_rigid_motions(
            structure, structure.node_position, nodes=np.flatnonzero(piece == k).tolist()
        ).shape[1]
        for k in np.unique(piece[free[:, 0]])
    )
    return Freedom(m - rank, max(n - rank - rigid, 0), rigid)
