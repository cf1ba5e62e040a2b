"""Adding the blocks of members straight into the values of a sparse matrix."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.members.access import MemberAccess, OfFreeMembers
from tensegrity_codegen.codegen.table.members.block_pattern import BlockPattern
from tensegrity_codegen.codegen.table.members.stage import only_where
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import IntArray

Place = Callable[[int, int, int], str]  # from block, row and column to the C expression of an entry


@dataclass(frozen=True)
class AddBlocks(OfFreeMembers):
    """Adds [S -S; -S S] of each member; S comes as rows, or as its upper triangle where it is symmetric.

    target: C name of the values; pattern: where blocks land; before: another pattern whose columns come
    first, each column of this one then begins with the entry of an identity; size: C name of a variable
    that takes the sizes of all entries of S, if any.
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
        size = range(self.pattern.model.n_axes)
        value = _full(results, len(size))
        make = self._strided if access.group.is_interior else self._listed
        lines, at, entries = make(writer, access)
        if self.size:
            lines.append(f"{self.size} += {' + '.join(writer.size_of(result) for result in results)};")
        signs = ("+=", "= -" if self.writes_first(access) else "-=")
        for block in range(4):
            for c in size:
                for r in size:
                    place = at(block, r, c)
                    line = f"{self.target}[{place}] {signs[block % 2]} {value[r][c]};"
                    lines += [line] if entries is None else only_where(entries[:, block, c, r], place, line)
        return lines

    def entry(self, row: IntArray, column: IntArray) -> IntArray:
        """Return the entry of `target` at rows and columns of coordinates, -1 where there is none."""
        entry = self.pattern.entry(row, column)
        if self.before is None:
            return entry
        return np.where(entry >= 0, entry + len(self.before.flat_index) + column + 1, -1)

    def writes_first(self, access: MemberAccess) -> bool:
        """Return whether a loop sets the blocks off the diagonal, which no loop has added to before."""
        return access.group.is_interior and bool(self.pattern.is_first[access.member].all())

    def starts(self, writer: Writer, access: MemberAccess, counter: str) -> tuple[list[str], list[str]]:
        """Return C expressions of the first entries of the four blocks, and of the lengths of columns."""
        coordinate, pattern = self.pattern.model.coordinate, self.pattern
        name = f"{access.name}_{self.target}"
        first = [
            writer.index_at(
                f"{name}_block{block}", self.entry(coordinate[row, 0], coordinate[column, 0]), counter
            )
            for block, (row, column) in enumerate(pattern.block_nodes(access.member))
        ]
        length = np.diff(pattern.column_start) + (self.before is not None)
        columns = [coordinate[pattern.model.ends[access.member, end], 0] for end in (0, 1)]
        lengths = [
            writer.index_at(f"{name}_length{end}", length[column], counter)
            for end, column in enumerate(columns)
        ]
        return first, lengths

    def _strided(self, writer: Writer, access: MemberAccess) -> tuple[list[str], Place, None]:
        """Return declarations of the first entry of each block and of the length of columns."""
        first, lengths = self.starts(writer, access, "e")
        lines = [f"const int b{block} = {text};" for block, text in enumerate(first)]
        lines += [f"const int c{end} = {text};" for end, text in enumerate(lengths)]
        return (
            lines,
            lambda block, r, c: f"b{block}{_times(c, f'c{block // 2}')}{f' + {r}' if r else ''}",
            None,
        )

    def _listed(self, writer: Writer, access: MemberAccess) -> tuple[list[str], Place, IntArray]:
        """Return no declaration, a table of all entries, and the entries (n, 4, columns, rows)."""
        coordinate, size = self.pattern.model.coordinate, self.pattern.model.n_axes
        blocks = [
            self.entry(coordinate[row][:, None, :], coordinate[column][:, :, None])
            for row, column in self.pattern.block_nodes(access.member)
        ]
        entries = np.stack(blocks, axis=1)
        table = writer.integers(f"{access.name}_{self.target}_entry", entries)
        total = 4 * size * size
        return [], lambda block, r, c: f"{table}[{total} * e + {(block * size + c) * size + r}]", entries


def _times(count: int, name: str) -> str:
    return "" if count == 0 else f" + {name}" if count == 1 else f" + {count} * {name}"


def _full(results: list[str], size: int) -> list[list[str]]:
    """Return the rows of a block whose results are its rows or its upper triangle."""
    if len(results) == size * size:
        return [results[size * r : size * (r + 1)] for r in range(size)]
    upper = {}
    for name in results:
        r, c = next((r, c) for r in range(size) for c in range(r, size) if (r, c) not in upper)
        upper[r, c] = name
    return [[upper[min(r, c), max(r, c)] for c in range(size)] for r in range(size)]
