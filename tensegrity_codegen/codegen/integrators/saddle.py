"""Symmetric saddle matrices of nodes and multipliers: non-zero entries, and the order of elimination.

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

    elimination_row: row of each unknown in the order of elimination. The lower triangle, row by row:
    entry_start (size + 1,), entry_column, entries of the diagonal left out; the same of the factor L:
    factor_start, factor_column (ascending in a row); update_start (number of entries of L + 1,): for entry
    (r, c) of L the entries (i, c) with i < r, as update_row = i and update_entry, its index.
    """

    size: int
    elimination_row: tuple[int, ...]
    entry_start: tuple[int, ...]
    entry_column: tuple[int, ...]
    factor_start: tuple[int, ...]
    factor_column: tuple[int, ...]
    update_start: tuple[int, ...]
    update_row: tuple[int, ...]
    update_entry: tuple[int, ...]

    def entry(self, a: int, b: int) -> int:
        """Return the index in entry_column of the entry of two unknowns a and b, off the diagonal."""
        row, column = sorted((self.elimination_row[a], self.elimination_row[b]), reverse=True)
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
    # Entries off the diagonal, as pairs of unknowns: of A, then of G.
    pairs = {(max(a, b), min(a, b)) for a, b in couplings if a != b}
    pairs |= {(n_coordinates + row, column) for row, columns in enumerate(multipliers) for column in columns}
    # Each multiplier is a block of its own, after the blocks of the nodes that it joins.
    block_of_unknown = {unknown: index for index, block in enumerate(blocks) for unknown in block}
    unknowns_of_block = [tuple(block) for block in blocks]
    predecessors: list[set[int]] = [set() for _ in blocks]
    for row, columns in enumerate(multipliers):
        block_of_unknown[n_coordinates + row] = len(unknowns_of_block)
        unknowns_of_block.append((n_coordinates + row,))
        predecessors.append({block_of_unknown[column] for column in columns})
    edges = {
        (block_of_unknown[a], block_of_unknown[b])
        for a, b in pairs
        if block_of_unknown[a] != block_of_unknown[b]
    }
    # The row of each unknown is its position in the order of elimination.
    order = [unknown for block in order_blocks(predecessors, edges) for unknown in unknowns_of_block[block]]
    elimination_row = [0] * size
    for position, unknown in enumerate(order):
        elimination_row[unknown] = position
    return _build_tables(size, elimination_row, pairs)


def order_blocks(predecessors: Sequence[set[int]], edges: Iterable[tuple[int, int]]) -> list[int]:
    """Return the blocks of a graph in an order of least degree.

    predecessors: the blocks that must come before each one.
    """
    neighbours: list[set[int]] = [set() for _ in predecessors]
    for a, b in edges:
        neighbours[a].add(b)
        neighbours[b].add(a)
    open_predecessors = [set(blocks) for blocks in predecessors]
    successors: list[list[int]] = [[] for _ in predecessors]
    for block, blocks in enumerate(predecessors):
        for predecessor in blocks:
            successors[predecessor].append(block)
    remaining, order = set(range(len(predecessors))), []
    while remaining:
        chosen = min(
            (block for block in remaining if not open_predecessors[block]),
            key=lambda b: (len(neighbours[b]), b),
        )
        order.append(chosen)
        remaining.remove(chosen)
        # Elimination joins all neighbours of the chosen block with each other.
        clique = neighbours[chosen]
        for block in clique:
            neighbours[block] |= clique
            neighbours[block] -= {block, chosen}
        for block in successors[chosen]:
            open_predecessors[block].discard(chosen)
    return order


def _build_tables(
    size: int, elimination_row: Sequence[int], pairs: Iterable[tuple[int, int]]
) -> SaddlePattern:
    """Return the tables of the matrix and of its factor in the order of `elimination_row`."""
    entries: list[list[int]] = [[] for _ in range(size)]
    for a, b in pairs:
        row, column = max(elimination_row[a], elimination_row[b]), min(elimination_row[a], elimination_row[b])
        entries[row].append(column)
    factor_rows = [sorted(columns) for columns in _find_factor_rows(size, entries)]
    entry_index: dict[tuple[int, int], int] = {}
    for row, columns in enumerate(factor_rows):
        for column in columns:
            entry_index[row, column] = len(entry_index)
    # Rows with an entry in each column, of those so far.
    rows_of_column: list[list[int]] = [[] for _ in range(size)]
    update_start, update_row, update_entry = [0], [], []
    for row, columns in enumerate(factor_rows):
        for column in columns:
            update_row += rows_of_column[column]
            update_entry += [entry_index[i, column] for i in rows_of_column[column]]
            update_start.append(len(update_row))
            rows_of_column[column].append(row)
    entries = [sorted(columns) for columns in entries]
    return SaddlePattern(
        size,
        tuple(elimination_row),
        _count_up(entries),
        tuple(column for columns in entries for column in columns),
        _count_up(factor_rows),
        tuple(column for columns in factor_rows for column in columns),
        tuple(update_start),
        tuple(update_row),
        tuple(update_entry),
    )


def _find_factor_rows(size: int, entries: Sequence[Sequence[int]]) -> list[set[int]]:
    """Return the columns of L row by row: those of the matrix, and what elimination adds."""
    rows_of_column: list[set[int]] = [set() for _ in range(size)]
    for row, columns in enumerate(entries):
        for column in columns:
            rows_of_column[column].add(row)
    # Eliminating a column adds its rows to that of its first row (the parent in the elimination tree).
    for column in range(size):
        if rows_of_column[column]:
            parent = min(rows_of_column[column])
            rows_of_column[parent] |= rows_of_column[column] - {parent}
    rows: list[set[int]] = [set() for _ in range(size)]
    for column, column_rows in enumerate(rows_of_column):
        for row in column_rows:
            rows[row].add(column)
    return rows


def _count_up(rows: Sequence[Sequence[int]]) -> tuple[int, ...]:
    """Return the index of the first entry of each row, and the number of all entries."""
    starts = [0]
    for row in rows:
        starts.append(starts[-1] + len(row))
    return tuple(starts)
