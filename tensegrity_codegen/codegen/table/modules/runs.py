"""Runs of entries where repeated modules fill the columns of a matrix from top to bottom.

All blocks in the columns of one node are a row of values, most of them one after the other in the matrix.
Where repetition after repetition has them in the same order, nodes side by side take a value of every line.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_codegen.codegen.table.modules.text import ModuleText
from tensegrity_codegen.structure.repeated_modules import MAX_SHIFT_GAP, Module
from tensegrity_codegen.system.arrays import IntArray

SHORTEST = 8  # entries of a run: as many as are turned at once
# Columns of modules that are written together, at most: the sums of each take lines of their own.
TOGETHER = 4
Places = Callable[[IntArray, IntArray], tuple[IntArray, IntArray]]


@dataclass(frozen=True)
class BlockLines:
    """Lines that hold blocks: entry (r, c) of one is `order[c][r]` lines behind its first."""

    text: ModuleText
    order: tuple[tuple[int, ...], ...]
    size: int

    def of_strand(self, strand: int, offset: int) -> int:
        """Return where the block of a strand stands for the node at which a chunk begins."""
        return strand * self.size * self.text.room + MAX_SHIFT_GAP - offset

    def of_sums(self, column: int) -> int:
        """Return where the sums of a column's nodes stand."""
        return (len(self.text.first.member) + column % TOGETHER) * self.size * self.text.room

    def entries(self, block: int, c: int) -> IntArray:
        """Return where the entries of column c of a block stand."""
        return block + self.text.room * np.array(self.order[c])


@dataclass(frozen=True)
class ColumnRuns:
    """The runs of the nodes of columns of modules, but for the first and the last of them.

    columns: those whose nodes have one distance in the matrix; first: node at which runs begin; behind: how
    many nodes at the end have none; line, entry: of each entry of a node, rising; start: for each module, the
    first entry of each node with runs; rest: for each module, blocks of nodes without: node, line, first
    entry, column length.
    """

    columns: tuple[int, ...]
    first: int
    behind: int
    line: IntArray
    entry: IntArray
    start: tuple[IntArray, ...]
    rest: tuple[IntArray, ...]

    @property
    def runs(self) -> list[tuple[IntArray, int]]:
        """Lines and first entry of each run."""
        cuts = np.flatnonzero(np.diff(self.entry) != 1) + 1
        pieces = zip(np.split(self.line, cuts), np.split(self.entry, cuts), strict=True)
        return [(line, int(entry[0])) for line, entry in pieces]


def find_runs(
    lines: BlockLines, column: int, entries: Sequence[tuple[int, int, int]], places: Places
) -> ColumnRuns | None:
    """Return the runs of a column's nodes, None where most have none, or short ones.

    entries: (strand, end, offset) of the blocks in the column, beside those on the diagonal; places: first
    entries of blocks and lengths of columns, given nodes of rows and of columns.
    """
    found = [_places(module, column, entries, places) for module in lines.text.modules]
    first, length = found[0]
    middle = first.shape[1] // 2
    pattern, height = first[:, middle] - first[:, middle].min(), length[middle]
    spans = [_span(first, length, pattern, height) for first, length in found]
    begin, behind = (max(span[k] for span in spans) for k in (0, 1))
    if (first[:, middle] < 0).any() or any(2 * (begin + behind) > len(length) for _, length in found):
        return None
    sums = lines.of_sums(column)
    block = np.array([*(lines.of_strand(strand, offset) for strand, _, offset in entries), sums])
    start = tuple(first[:, begin : first.shape[1] - behind].min(axis=0) for first, _ in found)
    rest = tuple(_rest(first, length, block, begin, behind) for first, length in found)
    line, entry = _entries(lines, block, pattern, int(height))
    runs = ColumnRuns((column,), begin, behind, line, entry, start, rest)
    return runs if min(len(line) for line, _ in runs.runs) >= SHORTEST else None


def join_runs(
    found: Sequence[ColumnRuns], extent: Sequence[int], starts_sum: Sequence[bool]
) -> list[ColumnRuns]:
    """Return the runs with those of columns after one another in one, where their nodes go side by side.

    extent: how many nodes beyond the repetitions each column has; starts_sum: whether it reads nothing of the
    matrix, which the columns before may have to write first.
    """
    joined: list[ColumnRuns] = []
    for runs in found:
        can_join = joined and starts_sum[runs.columns[0]]
        both = _join(joined[-1], runs, extent) if can_join else None
        joined[len(joined) - bool(both) :] = [both or runs]
    return joined


def _join(one: ColumnRuns, other: ColumnRuns, extent: Sequence[int]) -> ColumnRuns | None:
    before, column = one.columns[-1], other.columns[0]
    is_next = column == before + 1 and column % TOGETHER > 0 and extent[column] == extent[before]
    if not is_next or (one.first, one.behind) != (other.first, other.behind):
        return None
    away = int(other.start[0][0] - one.start[0][0])
    if any((b - a != away).any() for a, b in zip(one.start, other.start, strict=True)):
        return None
    line, entry = np.append(one.line, other.line), np.append(one.entry, other.entry + away)
    order = np.argsort(entry)
    rest = [np.concatenate(pair) for pair in zip(one.rest, other.rest, strict=True)]
    return replace(
        one,
        columns=(*one.columns, column),
        line=line[order],
        entry=entry[order],
        rest=tuple(item[np.argsort(item[:, 0], kind="stable")] for item in rest),
    )


def _places(
    module: Module, column: int, entries: Sequence[tuple[int, int, int]], places: Places
) -> tuple[IntArray, IntArray]:
    """Return (n_blocks, n_nodes) first entries, -1 where there is no block, and the lengths of columns."""
    nodes, n = module.column[column], module.n_repetitions
    own, length = places(nodes, nodes)
    first = np.full((len(entries) + 1, len(nodes)), -1)
    first[-1] = own
    for number, (strand, end, offset) in enumerate(entries):
        there, begin = module.place[strand, 1 - end]
        row = module.column[there][begin : begin + n]
        first[number, offset : offset + n] = places(row, nodes[offset : offset + n])[0]
    return first, length


def _span(first: IntArray, length: IntArray, pattern: IntArray, height: int) -> tuple[int, int]:
    """Return how many nodes before and behind the stretch in the middle are not as the pattern says."""
    middle = len(length) // 2
    differs = (first - first.min(axis=0) != pattern[:, None]).any(axis=0) | (length != height)
    differs |= (first < 0).any(axis=0)
    before, after = np.flatnonzero(differs[:middle]), np.flatnonzero(differs[middle:])
    begin = int(before[-1]) + 1 if len(before) else 0
    end = middle + int(after[0]) if len(after) else len(length)
    return begin, len(length) - end


def _entries(lines: BlockLines, block: IntArray, pattern: IntArray, height: int) -> tuple[IntArray, IntArray]:
    """Return line and entry of all values of a node's blocks, given the blocks' lines and first entries."""
    axes = range(len(lines.order))
    line = np.concatenate([lines.entries(item, c) for c in axes for item in block.tolist()])
    entry = np.concatenate([first + c * height + np.array(axes) for c in axes for first in pattern.tolist()])
    order = np.argsort(entry)
    return line[order], entry[order]


def _rest(first: IntArray, length: IntArray, block: IntArray, begin: int, behind: int) -> IntArray:
    """Return (n, 4): the blocks of nodes outside the stretch with runs, by nodes."""
    outside = np.ones(len(length), dtype=bool)
    outside[begin : len(length) - behind] = False
    node, number = np.nonzero((first >= 0).T & outside[:, None])
    return np.stack([node, block[number], first[number, node], length[node]], axis=1)
