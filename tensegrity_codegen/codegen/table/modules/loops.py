"""The loop over repeated modules of one shape: chunks of repetitions, their nodes, the results of members.

A chunk of repetitions at a time: its nodes are brought into lines, [column][axis][node]; each strand works
out what its members contribute, [strand][result][member], from pieces of two columns, with the sums of nodes
behind them; a subclass says what becomes of it. What the next chunk needs is carried over. Values of members
are numbers, tables or arguments.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, RATES, DensityKernel
from tensegrity_codegen.codegen.table.members.access import MemberAccess
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.text import ModuleText, shapes_of
from tensegrity_codegen.structure.assembly import ARGUMENT, MemberGroup
from tensegrity_codegen.structure.repeated_modules import MAX_SHIFT_GAP, Module
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.laws import MEMBER_VALUES

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop


class RowValues:
    """Statements that bring the values of members into rows: those of a whole strand, those of each row."""

    def __init__(
        self, text: ModuleText, writer: Writer, kernel: DensityKernel, kind: int, first: int, last: int
    ) -> None:
        self.text, self.writer = text, writer
        self.first, self.last = first, last
        self.member_class = text.model.plan.classes[kind]
        # The members of all modules, strand by strand, the last one repeated to fill a row.
        parts = []
        for module, length in zip(self.text.modules, self._padded().tolist(), strict=True):
            repetition = np.minimum(np.arange(length), module.n_repetitions - 1)
            parts.append(module.member[self.first : self.last, repetition].ravel())
        group = MemberGroup(self.member_class, np.concatenate(parts), is_interior=True, in_module=True)
        self.access = MemberAccess(text.model, f"{text.name}_{kind}", group, group.member)
        self.of_strand: list[str] = []
        self.of_row: list[str] = []
        self.reads_table = False
        for name in kernel.parameters:
            if name in MEMBER_VALUES:
                self._read(name)
        if self.reads_table:
            self.of_strand.insert(0, f"const int at = {self._start()};")

    def _padded(self) -> IntArray:
        return np.array([module.n_repetitions + self.writer.widest for module in self.text.modules])

    def _start(self) -> str:
        """Return the C expression of the place of repetition k of strand s among all members."""
        padded = self._padded()
        before = np.concatenate([[0], np.cumsum(padded * (self.last - self.first))[:-1]])
        begin = self.writer.index_at(f"{self.text.name}_begin{self.first}", before, "g")
        length = self.writer.index_at(f"{self.text.name}_padded", padded, "g")
        strand = f"(s - {self.first})" if self.first else "s"
        return f"{begin} + {length} * {strand} + k"

    def _read(self, name: str) -> None:
        """Return a value of a row's members: a number, one a strand, one a member, or worked out before."""
        access, cls = self.access, self.member_class
        value = "mu" if name == "spring_constant" and cls.is_stiffness_constant else name
        is_worked_out = value != "mu" and (
            cls.source(name) == ARGUMENT or (name == "rest_length" and cls.n_inputs > 0)
        )
        if is_worked_out:
            self.reads_table = True
            self.of_strand += [
                f"{self.writer.real} {name}_of_row[{self.text.chunk + self.writer.widest}];",
                f"for (c = 0; c < {self.text.chunk + self.writer.widest}; ++c) {{",
                "  const int e = at + (c < m ? c : m - 1);",
                f"  {name}_of_row[c] = {access.value(self.writer, value)};",
                "}",
            ]
            self.of_row.append(f"const lanes_row {name} = row_load({name}_of_row + c);")
            return
        constant = access.constant(value)
        blocks = np.split(constant, np.cumsum(self._padded() * (self.last - self.first))[:-1])
        by_strand = np.concatenate([block.reshape(self.last - self.first, -1)[:, 0] for block in blocks])
        lengths = np.repeat(self._padded(), self.last - self.first)
        if not np.array_equal(np.repeat(by_strand, lengths), constant):
            self.reads_table = True
            table = self.writer.reals(f"{access.name}_{value}", constant)
            self.of_row.append(f"const lanes_row {name} = row_load({table} + at + c);")
            return
        strand = f"s - {self.first}" if self.first else "s"
        if len(self.text.modules) > 1:
            strand = f"{self.last - self.first} * g + {strand}"
        text = self.writer.real_at(f"{access.name}_{value}", by_strand, strand)
        self.of_strand.append(f"const lanes_row {name} = row_all({text});")


@dataclass(frozen=True)
class ModuleStage:
    """What a stage over all modules says of itself.

    loops: the members in modules as loops of single ones, which have the same arguments and operations.
    """

    loops: "tuple[MemberLoop, ...]"
    kernel_name: str

    @property
    def model(self) -> TableModel:
        """The model of all of them."""
        return self.loops[0].model

    @cached_property
    def shapes(self) -> list[list[Module]]:
        """Modules by shape, those with a member that the stage writes."""
        shapes = shapes_of(self.model) if self.loops else []
        return [item for item in shapes if np.isin(item[0].kind, self.kinds).any()]

    @cached_property
    def kinds(self) -> list[int]:
        """Classes of members that the stage writes."""
        classes = {item.access.group.member_class for item in self.loops}
        return [kind for kind, cls in enumerate(self.model.plan.classes) if cls in classes] if classes else []

    @cached_property
    def starts_sums(self) -> list[list[bool]]:
        """For each shape and column: whether no column before holds any of its nodes."""
        found: list[list[bool]] = []
        touched = np.zeros(self.model.structure.n_nodes if self.loops else 0, dtype=bool)
        for modules in self.shapes:
            starts_sum = [True] * len(modules[0].column)
            for module in modules:
                for column, nodes in enumerate(module.column):
                    if self.ends_in(module, column):
                        starts_sum[column] &= not touched[nodes].any()
                        touched[nodes] = True
            found.append(starts_sum)
        return found

    def ends_in(self, module: Module, column: int) -> bool:
        """Return whether a member that the stage writes ends in a column."""
        return any(module.kind[strand] in self.kinds for strand, _, _ in module.entries(column))

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return frozenset[str]().union(*(item.arguments for item in self.loops))

    @property
    def operations(self) -> int:
        """Floating-point operations."""
        return sum(item.operations for item in self.loops)

    @property
    def repeats(self) -> int:
        """Repetitions of the modules of a shape, on average."""
        shapes = self.shapes
        return sum(module.n_repetitions for shape in shapes for module in shape) // max(len(shapes), 1)


class ShapeLoops(ABC):
    """The loops over modules of one shape.

    strands: class, first strand, behind the last; kernels: of each of these classes; size: results that are
    kept of a member; n_sums: lines in which nodes add up.
    """

    def __init__(
        self,
        writer: Writer,
        modules: Sequence[Module],
        number: int,
        kernels: dict[int, DensityKernel],
        size: int,
        n_sums: int,
    ) -> None:
        self.writer, self.model = writer, writer.model
        self.axes = range(self.model.n_axes)
        self.size, self.n_sums = size, n_sums
        first = modules[0]
        n_lines = size * len(first.member) + self.model.n_axes * len(first.column) + n_sums
        self.text = ModuleText(self.model, number, tuple(modules), n_lines, writer.widest)
        self.kernels = kernels
        self.strands = [item for item in self.text.strands() if item[0] in kernels]
        self.reads_rates = any(RATES[0] in kernel.parameters for kernel in kernels.values())

    @abstractmethod
    def row(self, kernel: DensityKernel) -> list[str]:
        """Return the statements that store what a kernel returned, from `to` on."""

    @abstractmethod
    def before(self) -> list[str]:
        """Return the declarations before all chunks."""

    @abstractmethod
    def chunk(self) -> list[str]:
        """Return what becomes of the results of a chunk's members."""

    def write(self) -> list[str]:
        """Return all loops."""
        text, real = self.text, self.writer.real
        n_columns, n_strands, room = text.n_columns, len(text.first.member), text.room
        self.arrays = {"position": n_columns * len(self.axes)}
        if self.reads_rates:
            self.arrays["rate"] = self.arrays["position"]
        self.arrays["part"] = n_strands * self.size
        length = {**self.arrays, "part": self.arrays["part"] + self.n_sums}
        body = [
            *(f"TENSEGRITY_ALIGNED {real} {name}[{n * room}];" for name, n in length.items()),
            f"const int n = {text.repetitions(self.writer)};",
            "int k, c, s;",
            *self.before(),
            f"for (c = 0; c < {n_columns}; ++c) {{",
            *self._bring("0", str(MAX_SHIFT_GAP), ""),
            "}",
            f"clear_lines(part, {n_strands * self.size}, {room});",
            f"for (k = 0; k < n + {text.extent}; k += {text.chunk}) {{",
            *(f"  {line}" for line in self._chunk()),
            "}",
        ]
        if len(text.modules) == 1:
            return ["{", *(f"  {line}" for line in body), "}"]
        loop = [f"  for (g = 0; g < {len(text.modules)}; ++g) {{", *(f"    {line}" for line in body), "  }"]
        return ["{", "  int g;", *loop, "}"]

    def _bring(self, k: str, count: str, shift: str) -> list[str]:
        """Return the calls that bring nodes of column c, from the k-th on, into lines."""
        text, lines = self.text, []
        length = str(MAX_SHIFT_GAP) if not shift else str(text.chunk)
        at = text.places(self.writer, "node", self.model.coordinate[:, 0])("c", k)
        for name, array in (("position", "coordinate"), ("rate", "velocity")):
            if name in self.arrays:
                to = f"{name} + {len(self.axes) * text.room} * c{shift}"
                lines.append(
                    f"  nodes_to_lanes({array}, {at}, NULL, 0, {count}, {length}, {text.room}, {to});"
                )
        return lines

    def _chunk(self) -> list[str]:
        text, room, chunk = self.text, self.text.room, self.text.chunk
        extent = self.writer.index_at(f"{text.name}_extent", np.array(text.first.extent), "c")
        return [
            f"const int m = n - k < 0 ? 0 : n - k < {chunk} ? n - k : {chunk};",
            f"for (c = 0; c < {text.n_columns}; ++c) {{",
            f"  const int left = n + {extent} - k - {MAX_SHIFT_GAP};",
            *self._bring(f"k + {MAX_SHIFT_GAP}", f"left < {chunk} ? left : {chunk}", f" + {MAX_SHIFT_GAP}"),
            "}",
            *(line for strands in self.strands for line in self._strands(*strands)),
            f"if (m < {chunk}) {{",
            f"  clear_lines(part + {MAX_SHIFT_GAP} + m, {self.arrays['part']}, {room});",
            "}",
            *self.chunk(),
            f"if (k + {chunk} < n + {text.extent}) {{",
            *(f"  carry_lines({name}, {n}, {room}, {chunk});" for name, n in self.arrays.items()),
            "}",
        ]

    def _strands(self, kind: int, first: int, last: int) -> list[str]:
        """Return the loop over the strands of one class: the results of a chunk of members."""
        text, room, kernel = self.text, self.text.room, self.kernels[kind]
        values = RowValues(text, self.writer, kernel, kind, first, last)
        counter = f"(s - {first})" if first else "s"
        ends = [
            self.writer.index_at(f"{text.name}_line{end}_{kind}", text.line_of[first:last, end], counter)
            for end in (0, 1)
        ]
        rows = []
        for name, symbols in (("position", AXES), ("rate", RATES)):
            for axis in self.axes if symbols[0] in kernel.parameters else ():
                i, j = (f"row_load({name} + {end} + c{plus(axis * room)})" for end in "ij")
                rows.append(f"const lanes_row {symbols[axis]} = {i} - {j};")
        rows += [*values.of_row, f"lanes_row result[{kernel.stores}];"]
        rows += [f"{kernel.name}({', '.join(kernel.parameters)}, result);", *self.row(kernel)]
        return [
            f"for (s = {first}; s < {last} && m > 0; ++s) {{",
            f"  const int i = {ends[0]}, j = {ends[1]};",
            f"  {self.writer.real} *const to = part + {self.size * room} * s + {MAX_SHIFT_GAP};",
            *(f"  {line}" for line in values.of_strand),
            "  for (c = 0; c < m; c += ROW) {",
            *(f"    {line}" for line in rows),
            "  }",
            "}",
        ]

    def entries(self, column: int) -> list[tuple[int, int, int]]:
        """Return (strand, end, offset) of the ends in a column that strands with a kernel have."""
        used = {s for _, first, last in self.strands for s in range(first, last)}
        return [entry for entry in self.text.first.entries(column) if entry[0] in used]

    def over_nodes(self, column: int, lines: Sequence[str]) -> list[str]:
        """Return a block over the q nodes of a column that a chunk completes."""
        extent, chunk = self.text.first.extent[column], self.text.chunk
        return [
            f"if (n{plus(extent)} > k) {{",
            f"  const int q = n{plus(extent)} - k < {chunk} ? n{plus(extent)} - k : {chunk};",
            *(f"  {line}" for line in lines),
            "}",
        ]


def plus(number: int) -> str:
    """Return what adds a number in C, nothing for zero."""
    return f" + {number}" if number else ""
