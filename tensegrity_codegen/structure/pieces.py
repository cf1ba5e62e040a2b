"""Connected pieces of a graph, by NumPy alone as SciPy takes long to import; cables in segments as chains."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray


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


STRAIGHT = 1e-9  # distance from the chord, as a part of the cable, up to which it is rounding


def find_chains(structure: Structure) -> dict[str, list[int]]:
    """Return the groups that are cables in segments: with mass, NAME_1 and so on, end to end."""
    heavy, (start, second) = ~structure.is_bar & (structure.member_mass > 0), structure.connectivity.T
    groups = {name: list(rows) for name, rows in structure.groups.items() if len(rows) > 1}
    return {
        name: rows
        for name, rows in groups.items()
        if heavy[rows].all()
        and np.array_equal(second[rows[:-1]], start[rows[1:]])
        and all(structure.member_name[e].startswith(f"{name}_") for e in rows)
    }


def measure_chain(
    structure: Structure, rows: list[int], node_position: FloatArray, member_tension: FloatArray
) -> tuple[float, float]:
    """Return the larger end tension [N] of a chain, and its largest distance from its chord [m].

    node_position, member_tension: (n_nodes, 3) [m] and (n_members,) [N] at rest.
    """
    # Half of the weight of the last piece stands at the end itself: with it the tension errs by O(1/n^2).
    ends, pulls = structure.connectivity[rows], []
    for e, here, opposite in ((rows[0], *ends[0]), (rows[-1], *ends[-1, ::-1])):
        vector = node_position[opposite] - node_position[here]
        weight = structure.member_mass[e] / 2 * structure.gravity
        pulls.append(np.linalg.norm(member_tension[e] * vector / np.linalg.norm(vector) + weight))
    # The largest distance from the chord, by a parabola through the farthest node and its neighbours.
    path = node_position[np.append(ends[:, 0], ends[-1, 1])] - node_position[ends[0, 0]]
    unit = path[-1] / max(float(np.linalg.norm(path[-1])), 1e-300)
    distance = np.linalg.norm(path - np.outer(path @ unit, unit), axis=1)
    k = int(distance[1:-1].argmax()) + 1
    before, peak, after = distance[k - 1 : k + 2].tolist()
    bend = 2 * peak - before - after
    if not bend > 0 or peak < STRAIGHT * np.abs(path).max():
        return float(max(pulls)), 0.0
    return float(max(pulls)), peak + (after - before) ** 2 / (8 * bend)
