"""Derivatives of the static force to rest lengths, and of tensions to coordinates: no mass enters them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.columns import MemberColumns, StoreColumns, store_recipe
from tensegrity_codegen.codegen.table.members.function import Recipe
from tensegrity_codegen.codegen.table.members.member_loops import member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import only_where
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.structure.assembly import MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import IntArray


def _is_elastic(group: MemberGroup) -> bool:
    return group.member_class.is_elastic


def _residual_rest_length_jacobian(model: TableModel) -> Recipe:
    name, columns = "residual_rest_length_jacobian", MemberColumns(model, is_elastic=True)
    loops = member_loops(model, "static_rest_pull", StoreColumns(name, columns), _is_elastic)
    return store_recipe((model.n_coordinates, model.structure.n_members), loops, columns)


def _tension_jacobian(model: TableModel) -> Recipe:
    rows = MemberRows(MemberColumns(model, is_elastic=True))
    loops = member_loops(model, "tension_gradient", StoreRows("tension_jacobian", rows), _is_elastic)
    return store_recipe((model.structure.n_members, model.n_coordinates), loops, rows)


@dataclass(frozen=True)
class MemberRows:
    """Pattern with the free coordinates of both nodes of member e in row e: that of columns, transposed."""

    columns: MemberColumns

    @cached_property
    def flat_index(self) -> IntArray:
        """(nnz,): coordinate times n_members plus member of each entry, rising."""
        count = self.columns.model.n_coordinates
        return np.sort(self.columns.flat_index % count * self._n_members + self.columns.flat_index // count)

    @property
    def _n_members(self) -> int:
        return self.columns.model.structure.n_members

    @property
    def row(self) -> IntArray:
        """(nnz,): row of each entry."""
        return self.flat_index % self._n_members

    @property
    def start(self) -> IntArray:
        """(n_coordinates + 1,): first entry of each column."""
        return np.searchsorted(
            self.flat_index, np.arange(self.columns.model.n_coordinates + 1) * self._n_members
        )

    def entry(self, member: IntArray) -> IntArray:
        """Return (n, 2, n_axes): entry of each component of both ends of some members, -1 if it is held."""
        model = self.columns.model
        coordinate = model.coordinate[model.ends[member]]
        found = np.searchsorted(self.flat_index, coordinate * self._n_members + member[:, None, None])
        return np.where(coordinate >= 0, found, -1)


@dataclass(frozen=True)
class StoreRows:
    """Writes +x at node i and -x at node j into row e of the values `target`."""

    target: str
    rows: MemberRows

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members with a free coordinate."""
        return member[np.any(model.coordinate[model.ends[member]] >= 0, axis=(1, 2))]

    def operations(self, kernel: MemberKernel) -> int:
        """Return one change of sign for each component."""
        return kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the assignments at both nodes."""
        entry, size, lines = self.rows.entry(access.member), len(results), list[str]()
        table = writer.integers(f"{access.name}_{self.target}_entry", entry)
        for end, sign in ((0, ""), (1, "-")):
            for k in range(size):
                at = f"{table}[{2 * size} * e + {end * size + k}]"
                lines += only_where(entry[:, end, k], at, f"{self.target}[{at}] = {sign}{results[k]};")
        return lines


REST_LENGTHS: Mapping[str, Callable[[TableModel], Recipe]] = {
    "residual_rest_length_jacobian": _residual_rest_length_jacobian,
    "tension_jacobian": _tension_jacobian,
}
