"""Free motions of a structure, separated into rigid motions that the supports allow, and mechanisms."""

from dataclasses import dataclass

import numpy as np
import scipy

from tensegrity_codegen.runtime.analysis.rank import Rank
from tensegrity_codegen.runtime.statics.rigid_motion import build_rigid_motions
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest

ZERO_MOTION_TOLERANCE = 1e-6  # part of a unit motion that counts as none


@dataclass(frozen=True)
class FreeMotions:
    """Motions at which no member changes its length, to first order.

    rigid (n_coordinates, n_rigid): orthonormal rigid motions, those of each part by itself.
    mechanism (n_coordinates, n_mechanisms): orthonormal motions that change the shape of a part, orthogonal
        to the rigid ones.
    """

    rigid: FloatArray
    mechanism: FloatArray


def find_free_motions(rank: Rank, rigid: FloatArray) -> FreeMotions:
    """Return the free motions, given the rigid ones (n_coordinates, n_rigid), orthonormal."""
    free = rank.free_motion
    inner = free - rigid @ (rigid.T @ free)
    left, size, _ = np.linalg.svd(inner, full_matrices=False)
    count = max(free.shape[1] - rigid.shape[1], 0)
    count = min(count, int((size > ZERO_MOTION_TOLERANCE).sum()))
    return FreeMotions(rigid, left[:, :count])


def find_parts(manifest: Manifest) -> tuple[tuple[int, ...], ...]:
    """Return the nodes of each part of a structure that no members join to the others, by index."""
    count = len(manifest.node_name)
    ends = manifest.strands.ends
    graph = scipy.sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    free = np.zeros(count, dtype=bool)
    free[[node for node, _ in manifest.coordinate_node_axis]] = True
    parts = [np.flatnonzero(label == k) for k in range(int(label.max(initial=-1)) + 1)]
    return tuple(tuple(int(n) for n in part) for part in parts if free[part].any())


def build_part_motions(
    manifest: Manifest, position: FloatArray, parts: tuple[tuple[int, ...], ...]
) -> FloatArray:
    """Return an orthonormal basis of the rigid motions of each part, (n_coordinates, k).

    position: (n_nodes, 3) [m]; coordinates must be components of node positions.
    """
    whole = [build_rigid_motions(manifest, position, nodes=part) for part in parts]
    count = len(manifest.coordinate_node_axis)
    return np.hstack(whole) if whole else np.zeros((count, 0))
