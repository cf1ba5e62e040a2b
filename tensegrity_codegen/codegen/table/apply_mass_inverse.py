"""Columns of a sparse matrix times H^-1 of groups of coupled nodes, in place.

The sum over a group runs over the rows that the matrix has in a column, in rising order, as CasADi's product
of sparse matrices does: the same bits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.block_pattern import MassGroups
from tensegrity_codegen.codegen.table.members.writer import Writer, loop
from tensegrity_codegen.system.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class ApplyMassInverse:
    """Turns forces into accelerations, in the rows of groups, in every column of the values `target`.

    name: of its tables.
    flat_index: column times n_coordinates plus row of the entries before, rising.
    entry: the entry of `target` at coordinates and columns.
    """

    target: str
    name: str
    groups: MassGroups
    flat_index: Callable[[], IntArray]
    entry: Callable[[IntArray, IntArray], IntArray]
    arguments: frozenset[str] = frozenset()

    @cached_property
    def _work(self) -> "_Work":
        return _Work(self)

    @property
    def operations(self) -> int:
        """Two operations for each entry of a group and each row that enters it."""
        work = self._work
        size = np.array([len(coordinates) for coordinates in self.groups.coordinate], dtype=np.int64)
        return int((2 * work.count - 1) @ size[work.group]) if len(work.group) else 0

    @property
    def repeats(self) -> int:
        """Pairs of a column and a group."""
        return len(self._work.group)

    def write(self, writer: Writer) -> list[str]:
        """Return the loop over columns and groups."""
        work = self._work
        if not len(work.group):
            return []
        prefix, size = f"{self.target}_{self.name}", work.size
        inverse = writer.reals("group_inverse", work.inverse)
        row_entries = writer.integers(f"{prefix}_place", work.place)
        row = writer.integers(f"{prefix}_row", work.row)

        def at(name: str, values: IntArray) -> str:
            return writer.index_at(f"{prefix}_{name}", values, "i")

        inverse_start = at("inverse_start", work.inverse_start)
        return loop(
            "i",
            len(work.group),
            [
                f"const int size = {at('size', size)}, count = {at('count', work.count)};",
                f"{writer.real} *const to = {self.target} + {at('first', work.first)};",
                f"const int *const place = {row_entries} + {at('place_start', work.place_start)};",
                f"const int *const row = {row} + {at('row_start', work.row_start)};",
                f"const {writer.real} *const inverse = {inverse} + {inverse_start};",
                f"{writer.real} force[{int(work.count.max())}];",
                "int k, r;",
                "for (k = 0; k < count; ++k) {",
                "  force[k] = to[place[row[k]]];",
                "}",
                "for (r = 0; r < size; ++r) {",
                f"  {writer.real} sum = inverse[size * r + row[0]] * force[0];",
                "  for (k = 1; k < count; ++k) {",
                "    sum += inverse[size * r + row[k]] * force[k];",
                "  }",
                "  to[place[r]] = sum;",
                "}",
            ],
        )


class _Work:
    """The products: one row for each group and each column that has entries of it.

    group, count, size (n,): the group, how many of its rows the column has, and how many there are; first:
    entry of its first row; place_start, row_start, inverse_start: where the tables `place` (of each row
    behind the first entry), `row` (those that the column has) and `inverse` begin. Equal parts of tables are
    there once.
    """

    def __init__(self, mix: ApplyMassInverse) -> None:
        groups = mix.groups
        n, n_groups = groups.model.n_coordinates, len(groups.coordinate)
        # Entries of groups, sorted by column and group
        column, row = np.divmod(mix.flat_index(), max(n, 1))
        label = groups.label[row] if n_groups else np.full(len(row), -1)
        held = label >= 0
        pair = column[held] * n_groups + label[held]
        order = np.argsort(pair, kind="stable")
        present, pair = row[held][order], pair[order]
        pairs, start = np.unique(pair, return_index=True)
        self.group = pairs % max(n_groups, 1)
        self.count = np.diff([*start.tolist(), len(pair)])
        self.size = np.array([len(groups.coordinate[g]) for g in self.group], dtype=np.int64)
        # Places of rows, rows present and H^-1 of each pair, equal tables once
        entry_table, rows, inverses = _Table(), _Table(), _Table()
        firsts, starts = [], []
        for number, g in enumerate(self.group.tolist()):
            coordinate = groups.coordinate[g]
            entry = mix.entry(coordinate, np.full(len(coordinate), pairs[number] // n_groups))
            inside = present[start[number] : start[number] + self.count[number]]
            firsts.append(int(entry[0]))
            starts.append(
                (
                    entry_table.add(entry - entry[0]),
                    rows.add(np.searchsorted(coordinate, inside)),
                    inverses.add(groups.inverse(g).reshape(-1)),
                )
            )
        self.first = np.array(firsts, dtype=np.int64)
        table = np.array(starts, dtype=np.int64).reshape(-1, 3)
        self.place_start, self.row_start, self.inverse_start = table.T
        self.place: IntArray = entry_table.values(np.int64)
        self.row: IntArray = rows.values(np.int64)
        self.inverse: FloatArray = inverses.values(np.float64)


class _Table:
    """Arrays behind each other, equal ones once."""

    def __init__(self) -> None:
        self._start: dict[bytes, int] = {}
        self._parts: list[np.ndarray] = []
        self._length = 0

    def add(self, array: np.ndarray) -> int:
        """Return where the array begins."""
        key = array.tobytes()
        if key not in self._start:
            self._start[key] = self._length
            self._parts.append(array)
            self._length += len(array)
        return self._start[key]

    def values(self, kind: type) -> np.ndarray:
        """Return all of them as one array."""
        return np.concatenate([np.zeros(0, dtype=kind), *self._parts])
