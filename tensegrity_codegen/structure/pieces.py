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
    label = np.arange(count, dtype=np.int64)
    while True:
        label_a, label_b = label[first], label[second]
        if np.array_equal(label_a, label_b):
            break
        np.minimum.at(label, np.maximum(label_a, label_b), np.minimum(label_a, label_b))
        while not np.array_equal(label, jumped := label[label]):
            label = jumped
    labels, piece = np.unique(label, return_inverse=True)
    return len(labels), piece.astype(np.int64)
