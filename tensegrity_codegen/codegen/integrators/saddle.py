"""Symmetric saddle matrices of nodes and multipliers: what is non-zero, in which order it is factored.

        [ A    G^T ]     A: over the free coordinates, G: one row a multiplier, the directions of its member,
        [ G   -kappa ]   kappa >= 0: diagonal

L D L^T without pivoting, in an order that is found here once: nodes by least degree, a multiplier after the
nodes that it joins. Where A is positive definite every pivot then has its sign, for kappa = 0 too (Vanderbei
1995, quasi-definite matrices). Results are plain tables for the generated C.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class SaddlePattern:
    """The factors of one saddle matrix of `size` rows, coordinates first, then multipliers.

    place: row of each unknown in the order of elimination; the lower triangle of the matrix row by row:
    entry_start (size + 1,), entry_column, entries of the diagonal left out; the same of the factor L:
    factor_start, factor_column (ascending in a row); update_start (number of entries of L + 1,): for entry
    (r, c) of L the entries (i, c) with i < r, as update_row = i and update_entry, its index.
    """

    size: int
    place: tuple[int, ...]
    entry_start: tuple[int, ...]
    entry_column: tuple[int, ...]
    factor_start: tuple[int, ...]
    factor_column: tuple[int, ...]
    update_start: tuple[int, ...]
    update_row: tuple[int, ...]
    update_entry: tuple[int, ...]

    def entry(self, a: int, b: int) -> int:
        """Return the index of the entry of unknowns a and b, off the diagonal."""
        row, column = sorted((self.place[a], self.place[b]), reverse=True)
        first, last = self.entry_start[row], self.entry_start[row + 1]
        return first + self.entry_column[first:last].index(column)


def build_saddle_pattern(
    n_coordinates: int,
    blocks: Sequence[Sequence[int]],
    couplings: Iterable[tuple[int, int]],
    multipliers: Sequence[Sequence[int]],
) -> SaddlePattern:
    """Return the pattern of the factors.

    blocks: coordinates that are eliminated together, all of them once; couplings: pairs of coordinates
    whose entry of A is not zero; multipliers: the coordinates that enter each row of G.
    """
    size = n_coordinates + len(multipliers)
    pairs = {(max(a, b), min(a, b)) for a, b in couplings if a != b}
    pairs |= {(n_coordinates + row, column) for row, columns in enumerate(multipliers) for column in columns}
    block_of = {unknown: index for index, block in enumerate(blocks) for unknown in block}
    groups = [tuple(block) for block in blocks]
    after: list[set[int]] = [set() for _ in blocks]
    for row, columns in enumerate(multipliers):
        block_of[n_coordinates + row] = len(groups)
        groups.append((n_coordinates + row,))
        after.append({block_of[column] for column in columns})
    edges = {(block_of[a], block_of[b]) for a, b in pairs if block_of[a] != block_of[b]}
    order = [unknown for block in order_blocks(after, edges) for unknown in groups[block]]
    place = [0] * size
    for position, unknown in enumerate(order):
        place[unknown] = position
    return _factor(size, place, pairs)


def order_blocks(after: Sequence[set[int]], edges: Iterable[tuple[int, int]]) -> list[int]:
    """Return the blocks of a graph by least degree; after: the blocks that must come before each one."""
    neighbour: list[set[int]] = [set() for _ in after]
    for a, b in edges:
        neighbour[a].add(b)
        neighbour[b].add(a)
    waits = [set(blocks) for blocks in after]
    waiting: list[list[int]] = [[] for _ in after]
    for block, blocks in enumerate(after):
        for first in blocks:
            waiting[first].append(block)
    left, order = set(range(len(after))), []
    while left:
        chosen = min((block for block in left if not waits[block]), key=lambda b: (len(neighbour[b]), b))
        order.append(chosen)
        left.remove(chosen)
        joined = neighbour[chosen]
        for block in joined:
            neighbour[block] |= joined
            neighbour[block] -= {block, chosen}
        for block in waiting[chosen]:
            waits[block].discard(chosen)
    return order


def _factor(size: int, place: Sequence[int], pairs: Iterable[tuple[int, int]]) -> SaddlePattern:
    """Return the tables of the matrix and of its factor in the order of `place`."""
    entries: list[list[int]] = [[] for _ in range(size)]
    for a, b in pairs:
        row, column = max(place[a], place[b]), min(place[a], place[b])
        entries[row].append(column)
    rows = [sorted(columns) for columns in _fill(size, entries)]
    index: dict[tuple[int, int], int] = {}
    for row, columns in enumerate(rows):
        for column in columns:
            index[row, column] = len(index)
    below: list[list[int]] = [[] for _ in range(size)]  # rows of each column met so far
    update_start, update_row, update_entry = [0], [], []
    for row, columns in enumerate(rows):
        for column in columns:
            update_row += below[column]
            update_entry += [index[i, column] for i in below[column]]
            update_start.append(len(update_row))
            below[column].append(row)
    entries = [sorted(columns) for columns in entries]
    return SaddlePattern(
        size,
        tuple(place),
        _starts(entries),
        tuple(column for columns in entries for column in columns),
        _starts(rows),
        tuple(column for columns in rows for column in columns),
        tuple(update_start),
        tuple(update_row),
        tuple(update_entry),
    )


def _fill(size: int, entries: Sequence[Sequence[int]]) -> list[set[int]]:
    """Return the columns of L row by row: those of the matrix, and what elimination adds."""
    below: list[set[int]] = [set() for _ in range(size)]
    for row, columns in enumerate(entries):
        for column in columns:
            below[column].add(row)
    for column in range(size):
        if below[column]:
            parent = min(below[column])
            below[parent] |= below[column] - {parent}
    rows: list[set[int]] = [set() for _ in range(size)]
    for column, members in enumerate(below):
        for row in members:
            rows[row].add(column)
    return rows


def _starts(rows: Sequence[Sequence[int]]) -> tuple[int, ...]:
    starts = [0]
    for row in rows:
        starts.append(starts[-1] + len(row))
    return tuple(starts)
