"""Factors L D L^T of small symmetric positive definite matrices, of numbers or of symbols.

The same operations in the same order for both, so that a solution in unrolled expressions and one in loops
over tables of the factors have the same bits.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

Scalar = Any


@dataclass(frozen=True)
class SymmetricFactor:
    """Unit lower factor by columns, and pivots, in the order of elimination.

    order: rows as they are eliminated; below: for each of them the later rows with their entries of L;
    pivot: for each of them its entry of D.
    """

    order: tuple[int, ...]
    below: tuple[tuple[tuple[int, Scalar], ...], ...]
    pivot: tuple[Scalar, ...]

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Return x with L D L^T x = right; divides by pivots: products would be merged with L."""
        x = list(right)
        for k, below in zip(self.order, self.below, strict=True):
            for row, entry in below:
                x[row] = x[row] - entry * x[k]
        for k, pivot in zip(self.order, self.pivot, strict=True):
            x[k] = x[k] / pivot
        for k, below in zip(reversed(self.order), reversed(self.below), strict=True):
            for row, entry in below:
                x[k] = x[k] - entry * x[row]
        return x


def factorise(diagonal: Sequence[Scalar], coupling: Mapping[tuple[int, int], Scalar]) -> SymmetricFactor:
    """Return the factors of the matrix of a diagonal and of entries (row, column) off it, each once."""
    order = _order(len(diagonal), coupling)
    position_of = {row: position for position, row in enumerate(order)}
    pivot = list(diagonal)
    remaining: list[dict[int, Scalar]] = [{} for _ in order]  # of each column, what is below in the order
    for (i, j), value in coupling.items():
        earlier, latter = (i, j) if position_of[i] < position_of[j] else (j, i)
        remaining[earlier][latter] = value
    below = []
    for k in order:
        column = sorted(remaining[k].items(), key=lambda item: position_of[item[0]])
        factors = [(row, value / pivot[k]) for row, value in column]
        for position, (row, factor) in enumerate(factors):
            pivot[row] = pivot[row] - factor * column[position][1]
            for later, value in column[position + 1 :]:
                present = remaining[row].get(later)
                change = factor * value
                remaining[row][later] = -change if present is None else present - change
        below.append(tuple(factors))
    return SymmetricFactor(tuple(order), tuple(below), tuple(pivot[k] for k in order))


def _order(count: int, coupling: Mapping[tuple[int, int], Scalar]) -> list[int]:
    """Return an order of elimination with little fill."""
    if count <= 2:
        return list(range(count))
    rows, columns = np.array(list(coupling), dtype=np.int32).T
    graph = scipy.sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    return [
        int(row)
        for row in scipy.sparse.csgraph.reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)
    ]
