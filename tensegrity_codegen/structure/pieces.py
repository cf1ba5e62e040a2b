"""Connected pieces of a graph; by NumPy alone, since SciPy's takes longer to import than to use."""

import numpy as np

from tensegrity_codegen.system.arrays import IntArray


def find_pieces(count: int, first: IntArray, second: IntArray) -> tuple[int, IntArray]:
    """Return the number of pieces of a graph, and the piece of each node.

    count: number of nodes; first, second (n_edges,): the nodes of each edge. Returns n_pieces: number of
    connected pieces; a node without edges is one; piece (count,): number of each node's piece; pieces are
    numbered in the order of their first nodes.

    Every piece gets the least of its nodes: edges hook the greater of two representatives to the smaller one,
    then all nodes follow their pointers to the end.
    """
    least = np.arange(count, dtype=np.int64)
    while True:
        one, other = least[first], least[second]
        if np.array_equal(one, other):
            break
        np.minimum.at(least, np.maximum(one, other), np.minimum(one, other))
        while not np.array_equal(least, jumped := least[least]):
            least = jumped
    found, piece = np.unique(least, return_inverse=True)
    return len(found), piece.astype(np.int64)
