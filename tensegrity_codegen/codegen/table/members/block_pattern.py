"""Places of the blocks of members in a sparse matrix over coordinates, without a loop over members."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.table.members.mass_groups import MassGroups
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import Pattern


def make_pattern(shape: tuple[int, int], row: IntArray, column_start: IntArray) -> Pattern:
    """Return the pattern of a manifest."""
    return Pattern(shape, row.astype(np.int32), column_start.astype(np.int32))


def unique_sorted(values: IntArray) -> IntArray:
    """Return the different values in rising order."""
    ordered = np.sort(values.reshape(-1))
    keep = np.ones(len(ordered), dtype=bool)
    keep[1:] = ordered[1:] != ordered[:-1]
    return ordered[keep]


@dataclass(frozen=True)
class BlockPattern:
    """Pattern of a sum of [S -S; -S S] over members: every free row and column of both nodes, no holes.

    member: members whose blocks are added.
    groups: coordinates that the mass matrix couples; where a block has one of its rows, all of its rows
        are entries, for a product with H^-1.
    Blocks are numbered (i, i), (j, i), (j, j), (i, j), as rows and columns of the nodes: the order in which
    the ends of a member add them.
    """

    model: TableModel
    member: IntArray
    groups: MassGroups | None = None

    @cached_property
    def flat_index(self) -> IntArray:
        """(nnz,): place of each entry in the dense matrix, column times n_coordinates plus row, rising."""
        return self.own_flat_index if self.groups is None else self.groups.expand(self.own_flat_index)

    @cached_property
    def own_flat_index(self) -> IntArray:
        """(n,): the same of the entries of blocks of members alone, without those that groups add."""
        ends = self.model.ends[self.member]
        count = self.model.structure.n_nodes
        nodes = np.concatenate([ends[:, c] * count + ends[:, r] for c in (0, 1) for r in (0, 1)])
        columns, rows = np.divmod(unique_sorted(nodes), count)
        column, row = np.broadcast_arrays(
            self.model.coordinate[columns][:, :, None], self.model.coordinate[rows][:, None, :]
        )
        present = (column >= 0) & (row >= 0)
        return np.sort(column[present] * self.model.n_coordinates + row[present])

    @cached_property
    def is_first(self) -> NDArray[np.bool_]:
        """(n_members,): whether a member is the first of `member` between its two nodes."""
        ends = self.model.ends[self.member]
        pair = ends.min(axis=1) * self.model.structure.n_nodes + ends.max(axis=1)
        found = np.zeros(len(self.model.ends), dtype=bool)
        found[self.member[np.unique(pair, return_index=True)[1]]] = True
        return found

    @cached_property
    def row(self) -> IntArray:
        """(nnz,): row of each entry."""
        return self.flat_index % max(self.model.n_coordinates, 1)

    @cached_property
    def column_start(self) -> IntArray:
        """(n_coordinates + 1,): first entry of each column."""
        count = self.model.n_coordinates
        return np.searchsorted(self.flat_index, np.arange(count + 1) * count)

    def entry(self, row: IntArray, column: IntArray) -> IntArray:
        """Return the entries at rows and columns, -1 where either is -1."""
        row, column = np.broadcast_arrays(row, column)
        found = np.searchsorted(self.flat_index, column * self.model.n_coordinates + row)
        return np.where((row >= 0) & (column >= 0), found, -1)

    def block_nodes(self, member: IntArray) -> list[tuple[IntArray, IntArray]]:
        """Return row node and column node of the four blocks of some members."""
        i, j = self.model.ends[member].T
        return [(i, i), (j, i), (j, j), (i, j)]
