"""Where the columns of a matrix are filled from top to bottom by repeated modules: whole runs of entries.

All blocks in the columns of one node are a row of values, most of them one after the other in the matrix.
Where repetition after repetition has them in the same order, nodes side by side take a value of every line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.model import IntArray
from tensegrity_codegen.codegen.table.module_text import ModuleText
from tensegrity_codegen.modules import NEAR, Module

__all__ = ["BlockLines", "ColumnRuns", "find_runs"]

SHORTEST = 8  # entries of a run: as many as are turned at once
Places = Callable[[IntArray, IntArray], tuple[IntArray, IntArray]]


@dataclass(frozen=True)
class BlockLines:
    """Lines that hold blocks: entry (r, c) of one is `order[c][r]` lines behind its first."""

    text: ModuleText
    order: tuple[tuple[int, ...], ...]
    size: int

    def of_strand(self, strand: int, offset: int) -> int:
        """Return where the block of a strand stands for the node at which a chunk begins."""
        return strand * self.size * self.text.room + NEAR - offset

    @property
    def of_sums(self) -> int:
        """Where the sums of a column's nodes stand."""
        return len(self.text.first.member) * self.size * self.text.room

    def entries(self, block: int, c: int) -> IntArray:
        """Return where the entries of column c of a block stand."""
        return block + self.text.room * np.array(self.order[c])


@dataclass(frozen=True)
class ColumnRuns:
    """The runs of the nodes of one column of modules, but for the first and the last of them.

    first: node at which runs begin; behind: how many nodes at the end have none; runs: lines of the entries
    of each, and how far its first entry is from the node's; start: for each module, the first entry of each
    node with runs; rest: for each module, blocks of nodes without: node, line, first entry, column length.
    """

    first: int
    behind: int
    runs: tuple[tuple[IntArray, int], ...]
    start: tuple[IntArray, ...]
    rest: tuple[IntArray, ...]


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
    block = np.array([*(lines.of_strand(strand, offset) for strand, _, offset in entries), lines.of_sums])
    runs = _split(lines, block, pattern, int(height))
    if min(len(line) for line, _ in runs) < SHORTEST:
        return None
    start = tuple(first[:, begin : first.shape[1] - behind].min(axis=0) for first, _ in found)
    rest = tuple(_rest(first, length, block, begin, behind) for first, length in found)
    return ColumnRuns(begin, behind, runs, start, rest)


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


def _split(
    lines: BlockLines, block: IntArray, pattern: IntArray, height: int
) -> tuple[tuple[IntArray, int], ...]:
    """Return lines and first entry of each run, given the blocks' lines and first entries."""
    axes = range(len(lines.order))
    line = np.concatenate([lines.entries(item, c) for c in axes for item in block.tolist()])
    entry = np.concatenate([first + c * height + np.array(axes) for c in axes for first in pattern.tolist()])
    order = np.argsort(entry)
    line, entry = line[order], entry[order]
    cuts = np.flatnonzero(np.diff(entry) != 1) + 1
    pieces = zip(np.split(line, cuts), np.split(entry, cuts), strict=True)
    return tuple((piece, int(where[0])) for piece, where in pieces)


def _rest(first: IntArray, length: IntArray, block: IntArray, begin: int, behind: int) -> IntArray:
    """Return (n, 4): the blocks of nodes outside the stretch with runs, by nodes."""
    outside = np.ones(len(length), dtype=bool)
    outside[begin : len(length) - behind] = False
    node, number = np.nonzero((first >= 0).T & outside[:, None])
    return np.stack([node, block[number], first[number, node], length[node]], axis=1)
