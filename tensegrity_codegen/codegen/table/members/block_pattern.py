"""Blocks and columns of members in a sparse matrix over coordinates, and the statements that add them.

A bar with own mass puts an entry of the mass matrix between its two nodes, so that a force on one of them
accelerates both. Nodes joined by such bars form groups, whose rows H^-1 couples; in class-1 structures these
are pairs.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.table.members.access import MemberAccess, OfFreeMembers
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Recipe, Stage, Writer, in_axes, only_where
from tensegrity_codegen.structure.symmetric_factor import factorise
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Pattern

# Of a matrix over large groups of coupled nodes, which is full: 30 MB of values, and as much C.
MAX_ENTRIES = 4_000_000


def check_constant_masses(model: TableModel, coordinate: IntArray) -> None:
    """Raise FormulationError if the mass of a node of these coordinates may change at run time."""
    node = model.coordinate_node[coordinate]
    chosen = np.unique(node[model.argument_index("node_mass")[node] >= 0])
    if len(chosen):
        names = [model.structure.node_name[k] for k in chosen[:5]]
        raise FormulationError(
            "the emitter 'table' has no run-time masses of nodes that bars with own mass couple",
            where=f"{model.name}: parameters.node_mass",
            given=", ".join(names),
            hint="remove these nodes from node_mass",
        ).unless_chosen_otherwise()


def check_entries(model: TableModel, quantity: str, count: int) -> None:
    """Raise FormulationError for a matrix that large groups of coupled nodes fill beyond MAX_ENTRIES."""
    if count > MAX_ENTRIES:
        raise FormulationError(
            f"bars with own mass couple so many nodes that {quantity} is nearly full",
            where=f"{model.name}: model.quantities",
            given=f"{count} entries",
            allowed=f"at most {MAX_ENTRIES} entries",
            hint="give the mass of the bars to their end nodes, half to each",
        ).unless_chosen_otherwise(quantity)


def find_groups(model: TableModel) -> "MassGroups | None":
    """Return the groups of coupled nodes, None if no bar couples two free ones."""
    groups = MassGroups(model)
    if not groups.coordinate:
        return None
    check_constant_masses(model, np.concatenate(groups.coordinate))
    return groups


@dataclass(frozen=True)
class MassGroups:
    """Groups of two or more free coordinates along one axis that bars with own mass couple."""

    model: TableModel

    @cached_property
    def nodes(self) -> list[tuple[int, ...]]:
        """Nodes of each group, rising."""
        return [nodes for nodes, _ in self._found]

    @cached_property
    def coordinate(self) -> list[IntArray]:
        """Coordinates of each group, rising."""
        return [coordinate for _, coordinate in self._found]

    @cached_property
    def label(self) -> IntArray:
        """(n_coordinates,): the group of each coordinate, -1 for one that is coupled to no other."""
        label = np.full(self.model.n_coordinates, -1)
        for number, coordinate in enumerate(self.coordinate):
            label[coordinate] = number
        return label

    def expand(self, key: IntArray) -> IntArray:
        """Return column times n_coordinates plus row of H^-1 A, rising, from those of A."""
        if not self.coordinate:
            return key
        count, n_groups = self.model.n_coordinates, len(self.coordinate)
        column, row = np.divmod(key, count)
        label = self.label[row]
        alone = label < 0
        column, group = np.divmod(np.unique(column[~alone] * n_groups + label[~alone]), n_groups)
        size = np.array([len(coordinates) for coordinates in self.coordinate])
        start = np.concatenate([[0], np.cumsum(size)])
        length = size[group]
        position = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        filled = np.concatenate(self.coordinate)[np.repeat(start[group], length) + position]
        return np.sort(np.concatenate([key[alone], np.repeat(column, length) * count + filled]))

    def inverse(self, group: int) -> FloatArray:
        """Return H^-1 of a group, (k, k) [1/kg], with the bits of `Inertia.inverse`."""
        nodes = self.nodes[group]
        if nodes not in self._inverses:
            mass = self.model.diagonal_mass[list(nodes)]
            factor = factorise(mass.tolist(), self.model.inertia.coupling_of(nodes))
            self._inverses[nodes] = np.array(factor.solve(list(np.eye(len(nodes)))))
        return self._inverses[nodes]

    @cached_property
    def _inverses(self) -> dict[tuple[int, ...], FloatArray]:
        return {}

    @cached_property
    def _found(self) -> list[tuple[tuple[int, ...], IntArray]]:
        groups_of_axes = []
        for column, axis in enumerate(self.model.axes):
            pair, _, groups = self.model.inertia.coupled(axis)
            for nodes in (*pair.tolist(), *groups):
                groups_of_axes.append((tuple(nodes), self.model.coordinate[nodes, column]))
        return groups_of_axes


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
class ColumnPattern(ABC):
    """Entries of a sparse matrix whose rows are free coordinates, column by column, rising.

    groups: of coupled nodes; where a column has one of their rows, all of them are entries, for a product
    with H^-1.
    """

    model: TableModel
    groups: MassGroups | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def n_columns(self) -> int:
        """Number of columns."""

    @property
    @abstractmethod
    def own_flat_index(self) -> IntArray:
        """(n,): column times n_coordinates plus row of each entry that no group adds, rising."""

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
        """(n_columns + 1,): first entry of each column."""
        return np.searchsorted(self.flat_index, np.arange(self.n_columns + 1) * self.model.n_coordinates)

    def at(self, row: IntArray, column: IntArray) -> IntArray:
        """Return the entries at rows and columns, -1 if either is -1."""
        row, column = np.broadcast_arrays(row, column)
        entries = np.searchsorted(self.flat_index, column * self.model.n_coordinates + row)
        return np.where((row >= 0) & (column >= 0), entries, -1)


@dataclass(frozen=True)
class BlockPattern(ColumnPattern):
    """Pattern of a sum of [S -S; -S S] over members: every free row and column of both nodes, no holes.

    member: members whose blocks are added. Blocks are numbered (i, i), (j, i), (j, j), (i, j), as rows and
    columns of the nodes: the order in which the ends of a member add them.
    """

    member: IntArray

    @property
    def n_columns(self) -> int:
        """One column a free coordinate."""
        return self.model.n_coordinates

    @cached_property
    def own_flat_index(self) -> IntArray:
        """(n,): see ColumnPattern; of the entries of blocks of members alone."""
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
        is_first = np.zeros(len(self.model.ends), dtype=bool)
        is_first[self.member[np.unique(pair, return_index=True)[1]]] = True
        return is_first

    def block_nodes(self, member: IntArray) -> list[tuple[IntArray, IntArray]]:
        """Return row node and column node of the four blocks of some members."""
        i, j = self.model.ends[member].T
        return [(i, i), (j, i), (j, j), (i, j)]


# Adding the blocks of members straight into the values of a sparse matrix.


@dataclass(frozen=True)
class AddBlocks(OfFreeMembers):
    """Adds [S -S; -S S] of each member; S comes as its columns.

    target: C name of the values; pattern: where blocks land; before: another pattern whose columns come
    first, each column of this one then begins with the entry of an identity; size: C name of a variable
    that takes the sizes of all entries of S, which is then symmetric, if any.
    """

    target: str
    pattern: BlockPattern
    before: BlockPattern | None = None
    size: str = ""

    def operations(self, kernel: MemberKernel) -> int:
        """Return one addition for each entry of the four blocks, those of two free nodes."""
        return 4 * self.pattern.model.n_axes**2

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the additions: the columns of node i, then those of node j."""
        n = self.pattern.model.n_axes
        columns = [results[n * c : n * (c + 1)] for c in range(n)]
        add = self._add_columns if access.group.is_interior else self._add_entries
        sizes = [writer.size_of(value) for c, column in enumerate(columns) for value in column[: c + 1]]
        lines = [f"{self.size} += {' + '.join(sizes)};"] if self.size else []
        return lines + add(writer, access, columns)

    def _add_columns(self, writer: Writer, access: MemberAccess, columns: list[list[str]]) -> list[str]:
        """Return the additions at nodes that are free, whose rows stand in a row."""
        coordinate, pattern = self.pattern.model.coordinate, self.pattern
        name = f"{access.name}_{self.target}"
        signs = ("+= ", "= -" if self.writes_first(access) else "-= ")
        length = np.diff(pattern.start) + (self.before is not None)
        lines = list[str]()
        for block, (row, column) in enumerate(pattern.block_nodes(access.member)):
            start = self.entry(coordinate[row, 0], coordinate[column, 0])
            lines.append(f"const int b{block} = {writer.listed_at(f'{name}_block{block}', start, 'e')};")
            stride = f"c{block // 2}"
            if block % 2 == 0 and len(columns) > 1:
                lengths = length[coordinate[column, 0]]
                lines.append(
                    f"const int {stride} = {writer.index_at(f'{name}_length{block // 2}', lengths, 'e')};"
                )
            for c, values in enumerate(columns):
                at = f"{self.target}[b{block}{['', f' + {stride}', f' + 2 * {stride}'][c]}"
                lines += in_axes(at, signs[block % 2], values)
        return lines

    def _add_entries(self, writer: Writer, access: MemberAccess, columns: list[list[str]]) -> list[str]:
        """Return the additions entry by entry, where some nodes are held."""
        coordinate, n = self.pattern.model.coordinate, len(columns)
        blocks = [
            self.entry(coordinate[row][:, None, :], coordinate[column][:, :, None])
            for row, column in self.pattern.block_nodes(access.member)
        ]
        entries = np.stack(blocks, axis=1)
        table = writer.integers(f"{access.name}_{self.target}_entry", entries)
        lines = list[str]()
        for number, (block, c, r) in enumerate(np.ndindex(4, n, n)):
            at = f"{table}[{4 * n * n} * e + {number}]"
            line = f"{self.target}[{at}] {'+-'[block % 2]}= {columns[c][r]};"
            lines += only_where(entries[:, block, c, r], at, line)
        return lines

    def entry(self, row: IntArray, column: IntArray) -> IntArray:
        """Return the entry of `target` at rows and columns of coordinates, -1 if there is none."""
        entry = self.pattern.at(row, column)
        if self.before is None:
            return entry
        return np.where(entry >= 0, entry + len(self.before.flat_index) + column + 1, -1)

    def writes_first(self, access: MemberAccess) -> bool:
        """Return whether a loop sets the blocks off the diagonal, which no loop has added to before."""
        return access.group.is_interior and bool(self.pattern.is_first[access.member].all())


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
class MemberColumns(ColumnPattern):
    """Pattern with the free coordinates of both nodes of member e in column e.

    is_elastic: whether columns of members without stiffness are empty.
    """

    is_elastic: bool = False

    @property
    def n_columns(self) -> int:
        """One column a member."""
        return self.model.structure.n_members

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
