"""One column a member: where what a member does to its two nodes lands in a sparse matrix."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from tensegrity_codegen.codegen.table.members.access import MemberAccess, OfFreeMembers
from tensegrity_codegen.codegen.table.members.block_pattern import MassGroups, make_pattern
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Recipe, Stage
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import IntArray


class SparseEntries(Protocol):
    """Where the entries of a sparse matrix stand: their rows, and the first entry of each column."""

    @property
    def row(self) -> IntArray:
        """(nnz,): row of each entry."""

    @property
    def start(self) -> IntArray:
        """(n_columns + 1,): first entry of each column."""


def store_recipe(shape: tuple[int, int], loops: Sequence[Stage], entries: SparseEntries) -> Recipe:
    """Return the recipe of a sparse matrix that loops over members store, entry by entry."""
    return Recipe(
        shape,
        tuple(loops),
        find_pattern=lambda: make_pattern(shape, entries.row, entries.start),
        is_empty=not loops,
    )


@dataclass(frozen=True)
class MemberColumns:
    """Pattern with the free coordinates of both nodes of member e in column e.

    groups: of coupled nodes whose rows are filled where a node is in one of them, for a product with H^-1;
    is_elastic: whether columns of members without stiffness are empty.
    """

    model: TableModel
    groups: MassGroups | None = None
    is_elastic: bool = False

    @cached_property
    def _coordinate(self) -> IntArray:
        """(n_members, 2 n_axes): coordinates of both nodes."""
        model = self.model
        coordinate = model.coordinate[model.ends].reshape(len(model.ends), -1)
        return np.where(model.is_elastic[:, None], coordinate, -1) if self.is_elastic else coordinate

    @cached_property
    def own_flat_index(self) -> IntArray:
        """(n,): member times n_coordinates plus row of each free coordinate of its nodes, rising."""
        key = np.arange(len(self._coordinate))[:, None] * self.model.n_coordinates + self._coordinate
        return np.sort(key[self._coordinate >= 0])

    @cached_property
    def flat_index(self) -> IntArray:
        """(nnz,): the same of all entries."""
        return self.own_flat_index if self.groups is None else self.groups.expand(self.own_flat_index)

    @cached_property
    def row(self) -> IntArray:
        """(nnz,): row of each entry."""
        return self.flat_index % max(self.model.n_coordinates, 1)

    @cached_property
    def start(self) -> IntArray:
        """(n_members + 1,): first entry of each column."""
        return np.searchsorted(
            self.flat_index, np.arange(len(self._coordinate) + 1) * self.model.n_coordinates
        )

    def at(self, row: IntArray, member: IntArray) -> IntArray:
        """Return the entries at rows and columns, -1 where the row is -1."""
        found = np.searchsorted(self.flat_index, member * self.model.n_coordinates + row)
        return np.where(row >= 0, found, -1)

    def entry(self, member: IntArray) -> IntArray:
        """Return (n, 2, n_axes): entry of each component of both ends of some members, -1 if it is held."""
        return self.at(self._coordinate[member], member[:, None]).reshape(len(member), 2, -1)


@dataclass(frozen=True)
class StoreColumns(OfFreeMembers):
    """Writes +x at node i and -x at node j into column e of the values `target`."""

    target: str
    columns: MemberColumns

    def operations(self, kernel: MemberKernel) -> int:
        """Return one change of sign for each component."""
        return kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the assignments at both nodes."""
        entry, size = self.columns.entry(access.member), len(results)
        lines = []
        for end in (0, 1):
            name = f"{access.name}_{self.target}_{'ij'[end]}"
            if access.group.is_interior:
                lines.append(f"const int k{end} = {writer.index_at(name, entry[:, end, 0], 'e')};")
        for end, sign in ((0, ""), (1, "-")):
            for k in range(size):
                if access.group.is_interior:
                    lines.append(f"{self.target}[k{end}{f' + {k}' if k else ''}] = {sign}{results[k]};")
                    continue
                table = writer.integers(f"{access.name}_{self.target}_entry", entry)
                at = f"{table}[{2 * size} * e + {end * size + k}]"
                lines.append(f"if ({at} >= 0) {{ {self.target}[{at}] = {sign}{results[k]}; }}")
        return lines
