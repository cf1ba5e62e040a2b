"""Destinations of the results of a member's kernel: stored, summed up, or added to nodes."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import only_where
from tensegrity_codegen.codegen.table.members.writer import Writer, index_text
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import IntArray


class Sink(Protocol):
    """What happens to the results of a member's kernel.

    select: those of some members that it wants anything of; operations: for each of them.
    """

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return those of `member` that it wants anything of."""

    def operations(self, kernel: MemberKernel) -> int:
        """Return the floating-point operations for one member."""

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the statements after the kernel's call, with its results by name."""


class OfFreeMembers:
    """A sink that wants the members with a free coordinate."""

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members with a free coordinate."""
        return member[np.any(model.coordinate[model.ends[member]] >= 0, axis=(1, 2))]


@dataclass(frozen=True)
class AddToNodes:
    """Takes a pull from node i and gives it to node j.

    target: C name of the array; index: (n_nodes, n_axes) entries of the array, -1 where there is none.
    """

    target: str
    index: IntArray

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members with an end whose entries are in the array."""
        return member[np.any(self.index[model.ends[member]] >= 0, axis=(1, 2))]

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition for each component of both ends."""
        return 2 * kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the additions: first to node i, then to node j."""
        entry = self.index[access.model.ends[access.member]]
        lines = []
        for end, sign in ((0, "-"), (1, "+")):
            lines += self._add(writer, access, entry, end, sign, results)
        return lines

    def _add(
        self, writer: Writer, access: MemberAccess, entry: IntArray, end: int, sign: str, results: list[str]
    ) -> list[str]:
        axes = np.arange(entry.shape[2])
        if (entry[:, end] < 0).all():
            return []
        if (entry[:, end] >= 0).all() and (entry[:, end] == entry[:, end, :1] + axes).all():
            start = self._offset(writer, access, entry, end)
            return [f"{self.target}[{start}{f' + {k}' if k else ''}] {sign}= {results[k]};" for k in axes]
        if np.array_equal(np.maximum(access.place, -1), entry):
            entry = access.place
        name = "place" if entry is access.place else self.target
        table = writer.integers(f"{access.name}_{name}_entry", entry)
        lines = []
        for k in axes:
            at = f"{table}[{entry[0].size} * e + {end * len(axes) + k}]"
            lines += only_where(entry[:, end, k], at, f"{self.target}[{at}] {sign}= {results[k]};")
        return lines

    def _offset(self, writer: Writer, access: MemberAccess, entry: IntArray, end: int) -> str:
        if access.group.is_interior and np.array_equal(entry[:, end, 0], access.place[:, end, 0]):
            return "ij"[end]
        first = entry[:, end, 0]
        text = index_text(first, "e")
        return text or writer.index_at(f"{access.name}_{self.target}_{'ij'[end]}", first, "e")


@dataclass(frozen=True)
class StoreForMembers:
    """Writes the results of each member to its place in the array `target`."""

    target: str

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return all members."""
        return member

    def place(self, access: MemberAccess) -> IntArray:
        """Return where the results of each member stand."""
        return access.member

    def operations(self, kernel: MemberKernel) -> int:
        """Return no operation."""
        return 0

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return one assignment for each result."""
        at = writer.index_at(f"{access.name}_store", len(results) * self.place(access), "e")
        return [f"{self.target}[{at}{f' + {k}' if k else ''}] = {name};" for k, name in enumerate(results)]


@dataclass(frozen=True)
class StoreForSome(StoreForMembers):
    """Writes the result of each member of `chosen` to its place among them."""

    chosen: tuple[int, ...]

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the chosen members."""
        return member[np.isin(member, self.chosen)]

    def place(self, access: MemberAccess) -> IntArray:
        """Return the number of each member among those chosen."""
        place: IntArray = np.searchsorted(self.chosen, access.member)
        return place


@dataclass(frozen=True)
class AddUp:
    """Adds the one result of each member to the variable `target`."""

    target: str

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return all members."""
        return member

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition."""
        return 1

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the addition."""
        return [f"{self.target} += {results[0]};"]
