"""An order of the nodes that follows the structure, whatever order they were listed in.

From an end of the structure outwards, as Cuthill and McKee (1969) number the nodes of a sparse matrix; the
neighbours of a node come in an order that depends on what is around them and not on their names. A structure
that repeats itself along its length is then numbered alike in every repetition.
"""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import IntArray

ROUNDS = 3  # how far around a node its surroundings are looked at, in members


def spread(ends: IntArray, order: IntArray) -> float:
    """Return the mean distance of the two nodes (n, 2) of members in an order of the nodes."""
    rank = np.argsort(order)
    return float(np.abs(np.diff(rank[ends], axis=1)).mean()) if len(ends) else 0.0


def order_nodes(ends: IntArray, kind: IntArray, n_nodes: int) -> IntArray:
    """Return all nodes; ends: (n, 2) nodes of members, kind: (n,) members of other kinds look different."""
    own, other = np.concatenate([ends[:, 0], ends[:, 1]]), np.concatenate([ends[:, 1], ends[:, 0]])
    label = np.concatenate([kind, kind])
    look = _surroundings(own, other, label, n_nodes)
    sort = np.lexsort((look[other], label, own))
    start = np.searchsorted(own[sort], np.arange(n_nodes + 1)).tolist()
    neighbour, names = other[sort].tolist(), np.stack([label[sort], _numbers(look)[other[sort]]], 1).tolist()
    found: list[int] = []
    seen = np.zeros(n_nodes, dtype=bool)
    for node in range(n_nodes):
        if not seen[node]:
            first = _walk(_walk(node, start, neighbour, names)[-1], start, neighbour, names)[-1]
            found += _walk(first, start, neighbour, names)
            seen[found] = True
    return np.array(found, dtype=np.int64)


def _walk(first: int, start: list[int], neighbour: list[int], names: list[list[int]]) -> list[int]:
    """Return all nodes that can be reached from the first one, nearer ones first."""
    found, number = [first], {first: 0}
    for node in found:
        new: dict[int, tuple[object, ...]] = {}
        for place in range(start[node], start[node + 1]):
            other = neighbour[place]
            if other not in number and other not in new:
                known = [number.get(k, -1) for k in neighbour[start[other] : start[other + 1]]]
                new[other] = (*names[place], sorted(k for k in known if k >= 0))
        for other in sorted(new, key=lambda k: new[k]):
            number[other] = len(found)
            found.append(other)
    return found


def _surroundings(own: IntArray, other: IntArray, label: IntArray, n_nodes: int) -> NDArray[np.uint64]:
    """Return a number for each node, equal for nodes with equal surroundings."""
    look = np.ones(n_nodes, dtype=np.uint64)
    for _ in range(ROUNDS):
        seen = _mix(look[other] + _mix(label.astype(np.uint64) + np.uint64(1)))
        total = np.zeros(n_nodes, dtype=np.uint64)
        np.add.at(total, own, seen)
        look = _mix(look + total)
    return look


def _mix(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return scattered bits (the finalizer of splitmix64)."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        value = (value ^ (value >> np.uint64(shift))) * np.uint64(factor)
    return value ^ (value >> np.uint64(31))


def _numbers(look: NDArray[np.uint64]) -> IntArray:
    """Return 0, 1, ... in place of the different values."""
    found: IntArray = np.unique(look, return_inverse=True)[1].reshape(-1)
    return found
