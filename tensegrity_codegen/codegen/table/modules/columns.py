"""The loops over modules of one shape that write blocks: off the diagonal set, on it summed.

Where the columns of nodes are filled in runs, whole runs are written; elsewhere three numbers at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import DensityKernel
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.fours import kind_of
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.loops import ModuleStage, ShapeLoops, plus
from tensegrity_codegen.codegen.table.modules.runs import (
    TOGETHER,
    BlockLines,
    ColumnRuns,
    find_runs,
    join_runs,
)
from tensegrity_codegen.codegen.table.modules.text import common_step
from tensegrity_codegen.structure.repeated_modules import MAX_SHIFT_GAP, Module
from tensegrity_codegen.system.arrays import IntArray

LAST = 2**31 - 1  # behind all nodes


class BlockLoops(ShapeLoops):
    """Parts are -S, [strand][entry], its upper triangle or all rows; behind them sums of a column's nodes.

    starts_sum: for each column, whether no column before holds any of its nodes.
    """

    sink: AddBlocks
    starts_sum: list[bool]

    def row(self, kernel: DensityKernel) -> list[str]:
        """Return the statements that store a block with its sign turned."""
        return [
            f"row_store(to + c{plus(entry * self.text.room)}, -result[{entry}]);"
            for entry in range(self.size)
        ]

    def before(self) -> list[str]:
        """Return the pointers to the blocks of nodes without runs, for each column that has others."""
        return [
            f"const int *rest{number} = {self._rest_table(number, runs)};"
            for number, runs in enumerate(self.joined)
        ]

    def chunk(self) -> list[str]:
        """Return the statements that write the blocks of a chunk."""
        lines = [line for item in self.strands for end in (0, 1) for line in self._off_diagonal(*item, end)]
        last = {runs.columns[-1]: number for number, runs in enumerate(self.joined)}
        for column in range(self.text.n_columns):
            if self.entries(column):
                # Calls that write the blocks on the diagonal.
                written = (
                    self._spread("sum", self._diagonal(column), "q") if self.runs[column] is None else []
                )
                if column in last:
                    written = self._in_runs(last[column], self.joined[last[column]])
                lines += self.over_nodes(column, [*self._sums(column), *written])
        return lines

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether parts are upper triangles."""
        return self.size < len(self.axes) ** 2

    @cached_property
    def lines(self) -> BlockLines:
        """Where blocks stand among the parts."""
        order = tuple(tuple(self._line(r, c) for r in self.axes) for c in self.axes)
        return BlockLines(self.text, order, self.size)

    @cached_property
    def runs(self) -> list[ColumnRuns | None]:
        """What is written in runs, for each column."""
        found = [self.entries(column) for column in range(self.text.n_columns)]
        return [
            find_runs(self.lines, column, entries, self.sink.places) if entries else None
            for column, entries in enumerate(found)
        ]

    @cached_property
    def joined(self) -> list[ColumnRuns]:
        """The same with columns together where they can be."""
        return join_runs([runs for runs in self.runs if runs], self.text.first.extent, self.starts_sum)

    def _line(self, r: int, c: int) -> int:
        n, low, high = len(self.axes), min(r, c), max(r, c)
        return low * n - low * (low - 1) // 2 + high - low if self.is_symmetric else n * r + c

    def _off_diagonal(self, kind: int, first: int, last: int, end: int) -> list[str]:
        """Return the loop over strands of a class whose blocks at an end are in no run."""
        strand = [s for s in range(first, last) if self.runs[self.text.first.place[s, end, 0]] is None]
        if not strand:
            return []
        nodes = [
            (_nodes(module, s, 1 - end), _nodes(module, s, end))
            for module in self.text.modules
            for s in strand
        ]
        name = f"off{end}_{kind}"
        places = _Places(
            self, name, nodes, "s" if len(self.text.modules) == 1 else f"({len(strand)} * g + s)"
        )
        number = self.writer.index_at(f"{self.text.name}_{name}", np.array(strand), "s")
        block = f"part + {self.size * self.text.room} * ({number}) + {MAX_SHIFT_GAP}"
        lines = [f"const {self.writer.real} *const own = {block};", *self._spread("own", places, "m")]
        return [f"for (s = 0; s < {len(strand)} && m > 0; ++s) {{", *(f"  {line}" for line in lines), "}"]

    def _spread(self, block: str, places: "_Places", count: str) -> list[str]:
        """Return the calls that write the columns of blocks, lines by nodes, to their places."""
        room, found = self.text.room, []
        for c in self.axes:
            triple = ", ".join(f"{block}{plus(self._line(r, c) * room)}" for r in self.axes)
            found.append(f"lanes_to_nodes({triple}, {places.at(c)}, {count}, {places.onto(c)});")
        return found

    def _diagonal(self, column: int) -> "_Places":
        nodes = [(module.column[column], module.column[column]) for module in self.text.modules]
        return _Places(self, f"own{column}", nodes, "g" if len(nodes) > 1 else "0")

    def _sums(self, column: int) -> list[str]:
        """Return what adds up the blocks on the diagonal, over what is there where a column before was.

        The sizes of all blocks are those of these sums: what is not finite in a block is not in them either.
        """
        entries, room, starts_sum = self.entries(column), self.text.room, self.starts_sum[column]
        own = f"{self.writer.real} *const sum = part + {self.lines.of_sums(column)};"
        lines, adding = [own, *([] if starts_sum else self._take(self._diagonal(column)))], []
        for line in range(self.size):
            here, zero = plus(line * room), self.writer.number(0.0)
            start = f"row_all({zero})" if starts_sum else f"row_load(sum + c{here})"
            adding.append(f"lanes_row sum{line} = {start};")
            for strand, _, offset in entries:
                at = self.lines.of_strand(strand, offset) + line * room
                adding.append(f"sum{line} = sum{line} - row_load(part + c + {at});")
            adding.append(f"row_store(sum + c{here}, sum{line});")
        if self.sink.size:
            squares = "sum0 * sum0"
            for line in range(1, self.size):
                squares = f"row_add_square({squares}, sum{line})"
            adding.append(f"total = total + row_upto({squares}, q - c);")
        return [*lines, "for (c = 0; c < q; c += ROW) {", *(f"  {line}" for line in adding), "}"]

    def _take(self, places: "_Places") -> list[str]:
        """Return the calls that bring blocks into lines.

        Those of a triangle begin with its last column, whose upper entries are overwritten by earlier ones.
        """
        room, found = self.text.room, []
        for c in reversed(self.axes):
            start, step = (self._line(c, c) - c, room) if self.is_symmetric else (c, len(self.axes) * room)
            found.append(
                f"nodes_to_lanes({places.onto(c)}, {places.at(c)}, q, {self.text.chunk}, {step},"
                f" sum{plus(start * room)});"
            )
        return found

    def _in_runs(self, number: int, runs: ColumnRuns) -> list[str]:
        """Return what writes all blocks in the columns of nodes: in runs, or one by one."""
        self.writer.uses_columns = True
        name, target = f"{self._name}_run{number}", self.sink.target
        left = f"n{_signed(self.text.first.extent[runs.columns[0]] - runs.behind)} - k"
        lines = [
            f"const int top = k < {runs.first} ? {runs.first} - k : 0;",
            f"const int end = {left} < q ? {left} : q;",
        ]
        at = self._starts(name, runs)
        for line, entry in runs.runs:
            table = self.writer.integers(name, line)
            lines.append(
                f"lines_to_columns(part + top, {table}, {len(line)}, {at}, end - top, {target}{plus(entry)});"
            )
        return [*lines, *self._one_by_one(number)]

    def _starts(self, name: str, runs: ColumnRuns) -> str:
        """Return what the C function takes as places of nodes, from the one at `top` on."""
        node = f"(k + top{_signed(-runs.first)})"
        step = common_step(runs.start)
        if step is not None:
            first = np.array([item[0] for item in runs.start])
            return f"NULL, {self.writer.index_at(f'{name}_first', first, 'g')} + {step} * {node}, {step}"
        begin = np.cumsum([0, *map(len, runs.start[:-1])])
        table = self.writer.integers(f"{name}_place", np.concatenate(runs.start))
        return f"{table} + {self.writer.index_at(f'{name}_start', begin, 'g')} + {node}, 0, 0"

    def _rest_table(self, number: int, runs: ColumnRuns) -> str:
        """Return the C expression of where the blocks of a module's nodes without runs begin."""
        name = f"{self._name}_rest{number}"
        ends = [np.vstack([item, [[LAST, 0, 0, 0]]]) for item in runs.rest]
        begin = 4 * np.cumsum([0, *map(len, ends[:-1])])
        table = self.writer.integers(name, np.concatenate(ends))
        return f"{table} + {self.writer.index_at(f'{name}_start', begin, 'g')}"

    def _one_by_one(self, number: int) -> list[str]:
        """Return the loop over the blocks of nodes without runs that a chunk completes."""
        rest, real, room = f"rest{number}", self.writer.real, self.text.room
        lines = [
            f"const {real} *const own = part + {rest}[1] + {rest}[0] - k;",
            f"{real} *const to = {self.sink.target} + {rest}[2];",
        ]
        for c in self.axes:
            at = ["", f"{rest}[3] + ", f"2 * {rest}[3] + "][c]
            lines += [f"to[{at}{r}] = own[{self._line(r, c) * room}];" for r in self.axes]
        return [f"for (; {rest}[0] < k + q; {rest} += 4) {{", *(f"  {line}" for line in lines), "}"]

    @property
    def _name(self) -> str:
        return f"{self.text.name}_{self.sink.target}_columns"


def _nodes(module: Module, strand: int, end: int) -> IntArray:
    column, offset = module.place[strand, end]
    nodes: IntArray = module.column[column][offset : offset + module.n_repetitions]
    return nodes


def _signed(number: int) -> str:
    return f" - {-number}" if number < 0 else plus(number)


class _Places:
    """Where columns of blocks stand: evenly spaced, or as tables of first entries and of lengths say."""

    def __init__(
        self, loops: BlockLoops, name: str, nodes: Sequence[tuple[IntArray, IntArray]], counter: str
    ) -> None:
        self.target, writer = loops.sink.target, loops.writer
        prefix = f"{loops.text.name}_{self.target}"
        firsts, lengths = zip(*(loops.sink.places(row, column) for row, column in nodes), strict=True)
        step, length = common_step(firsts), int(lengths[0][0])
        self.is_even = step is not None and all((item == length).all() for item in lengths)
        if self.is_even:
            first = writer.index_at(f"{prefix}_{name}", np.array([item[0] for item in firsts]), counter)
            self.text, self.length = f"NULL, {first} + {step} * k, {step}, NULL, 0", length
            return
        start = np.cumsum([0, *map(len, firsts[:-1])])
        begin = writer.index_at(f"{prefix}_{name}_start", start, counter)
        place = writer.integers(f"{prefix}_{name}_place", np.concatenate(firsts))
        table = writer.integers(f"{prefix}_{name}_length", np.concatenate(lengths))
        self.text, self.length = f"{place} + {begin} + k, 0, 0, {table} + {begin} + k", 0

    def at(self, c: int) -> str:
        """Return what the C functions take as places of column c."""
        return self.text if self.is_even else f"{self.text}, {c}"

    def onto(self, c: int) -> str:
        """Return the array that these places count from."""
        return f"{self.target}{plus(c * self.length)}"


@dataclass(frozen=True)
class ModuleBlocks(ModuleStage):
    """Writes the blocks of all members in modules that the sink wants to its matrix."""

    sink: AddBlocks

    def entries_set(self) -> IntArray:
        """Return the entries of the pattern that are set here, whatever they were before."""
        pattern, blocks = self.sink.pattern, []
        for modules, starts_sum in zip(self.shapes, self.starts_sums, strict=True):
            for module in modules:
                member = module.member[np.isin(module.kind, self.kinds)].ravel()
                blocks += pattern.block_nodes(member)[1::2]
                own = [
                    nodes
                    for column, nodes in enumerate(module.column)
                    if starts_sum[column] and self.ends_in(module, column)
                ]
                blocks += [(nodes, nodes) for nodes in own]
        coordinate = pattern.model.coordinate
        entries = [
            pattern.entry(coordinate[row][:, None, :], coordinate[column][:, :, None]).ravel()
            for row, column in blocks
        ]
        return np.concatenate([np.zeros(0, dtype=np.int64), *entries])

    def write(self, writer: Writer) -> list[str]:
        """Return one block of loops for each shape of modules."""
        classes = writer.model.plan.classes
        kernels = {
            kind: writer.row_kernel(kind_of(classes[kind], False, self.kernel_name)) for kind in self.kinds
        }
        if not kernels:
            return []
        size = next(iter(kernels.values())).stores
        lines: list[str] = []
        for number, (modules, starts_sum) in enumerate(zip(self.shapes, self.starts_sums, strict=True)):
            n_sums = size * min(len(modules[0].column), TOGETHER)
            loops = BlockLoops(writer, modules, number, kernels, size, n_sums)
            loops.sink, loops.starts_sum = self.sink, starts_sum
            lines += loops.write()
        if not self.sink.size:
            return lines
        before, after = "lanes_row total = row_all(@);", f"{self.sink.size} += row_sum(total);"
        return [
            "{",
            f"  {before.replace('@', writer.number(0.0))}",
            *(f"  {line}" for line in lines),
            f"  {after}",
            "}",
        ]
