"""Forces of repeated modules: members side by side, then node by node.

A chunk of repetitions at a time: its nodes are brought into lines, [column][axis][node]; each strand works
out the pulls of its members, [strand][axis][member], from pieces of two columns; each node adds up the pulls
of the strands that end in its column, in the order of the assembly plan. What the next chunk needs is carried
over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, RATES, DensityKernel
from tensegrity_codegen.codegen.table.fours import PULLS, kind_of
from tensegrity_codegen.codegen.table.module_text import ModuleText, shapes_of
from tensegrity_codegen.codegen.table.module_values import RowValues
from tensegrity_codegen.codegen.table.writer import Writer
from tensegrity_codegen.modules import NEAR, Module

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.loops import AddToNodes, MemberLoop

__all__ = ["ModuleForces"]


@dataclass(frozen=True)
class ModuleForces:
    """Adds the pulls of all members in modules that the sink wants to its array.

    loops: these members as loops of single ones, which have the same arguments and operations.
    """

    loops: tuple[MemberLoop, ...]
    kernel_name: str
    sink: AddToNodes

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
        shapes = shapes_of(self.loops[0].model)
        return sum(module.n_repetitions for shape in shapes for module in shape) // max(len(shapes), 1)

    def write(self, writer: Writer) -> list[str]:
        """Return one block of loops for each shape of modules."""
        groups = {item.access.group.member_class: item.access.group for item in self.loops}
        lines: list[str] = []
        for number, modules in enumerate(shapes_of(writer.model)):
            used = [k for k, cls in enumerate(writer.model.plan.classes) if cls in groups]
            shape = _Shape(writer, tuple(modules), number, used, self)
            lines += shape.write() if shape.strands else []
        return lines


class _Shape:
    """The loops over modules of one shape."""

    def __init__(
        self, writer: Writer, modules: tuple[Module, ...], number: int, used: list[int], stage: ModuleForces
    ) -> None:
        self.writer, self.model, self.sink = writer, writer.model, stage.sink
        self.axes = range(self.model.n_axes)
        self.is_static = PULLS[stage.kernel_name]
        first = modules[0]
        n_lines = self.model.n_axes * (len(first.member) + len(first.column) + 1)
        self.text = ModuleText(self.model, number, modules, n_lines)
        self.strands = [item for item in self.text.strands() if item[0] in used]
        self.kernels = [self._kernel(kind) for kind, _, _ in self.strands]
        self.reads_rates = any(RATES[0] in kernel.parameters for kernel in self.kernels)

    def _kernel(self, kind: int) -> DensityKernel:
        return self.writer.row_kernel(kind_of(self.model.plan.classes[kind], self.is_static))

    def write(self) -> list[str]:
        text, real, n_axes = self.text, self.writer.real, self.model.n_axes
        n_columns, n_strands, room, chunk = text.n_columns, len(text.first.member), text.room, text.chunk
        arrays = {"position": n_columns, **({"rate": n_columns} if self.reads_rates else {})}
        arrays |= {"pull": n_strands, "force": 1}
        body = [
            *(
                f"TENSEGRITY_ALIGNED {real} {name}[{n_axes * count * room}];"
                for name, count in arrays.items()
            ),
            f"const int n = {text.repetitions(self.writer)};",
            "int k, c, s;",
            f"for (c = 0; c < {n_columns}; ++c) {{",
            *self._bring("0", str(NEAR), ""),
            "}",
            f"clear_lines(pull, {n_strands * n_axes}, {room});",
            f"for (k = 0; k < n + {text.extent}; k += {chunk}) {{",
            *(f"  {line}" for line in self._chunk(arrays)),
            "}",
        ]
        if len(text.modules) == 1:
            return ["{", *(f"  {line}" for line in body), "}"]
        loop = [f"  for (g = 0; g < {len(text.modules)}; ++g) {{", *(f"    {line}" for line in body), "  }"]
        return ["{", "  int g;", *loop, "}"]

    def _bring(self, k: str, count: str, shift: str) -> list[str]:
        """Return the calls that bring nodes of column c, from the k-th on, into lines."""
        text, lines = self.text, []
        length = str(NEAR) if not shift else str(text.chunk)
        at = text.places(self.writer, "node", self.model.coordinate[:, 0])("c", k)
        for name, array in (("position", "coordinate"), ("rate", "velocity")):
            if name == "position" or self.reads_rates:
                to = f"{name} + {self.model.n_axes * text.room} * c{shift}"
                lines.append(f"  nodes_to_lanes({array}, {at}, {count}, {length}, {text.room}, {to});")
        return lines

    def _chunk(self, arrays: dict[str, int]) -> list[str]:
        text, n_axes, room, chunk = self.text, self.model.n_axes, self.text.room, self.text.chunk
        n_strands = len(text.first.member)
        extent = self.writer.index_at(f"{text.name}_extent", np.array(text.first.extent), "c")
        return [
            f"const int m = n - k < 0 ? 0 : n - k < {chunk} ? n - k : {chunk};",
            f"for (c = 0; c < {text.n_columns}; ++c) {{",
            f"  const int left = n + {extent} - k - {NEAR};",
            *self._bring(f"k + {NEAR}", f"left < {chunk} ? left : {chunk}", f" + {NEAR}"),
            "}",
            *(
                line
                for strands, kernel in zip(self.strands, self.kernels, strict=True)
                for line in self._pull(strands, kernel)
            ),
            f"if (m < {chunk}) {{",
            f"  clear_lines(pull + {NEAR} + m, {n_strands * n_axes}, {room});",
            "}",
            *(line for column in range(text.n_columns) for line in self._gather(column)),
            f"if (k + {chunk} < n + {text.extent}) {{",
            *(
                f"  carry_lines({name}, {count * n_axes}, {room}, {chunk});"
                for name, count in arrays.items()
                if name != "force"
            ),
            "}",
        ]

    def _pull(self, strands: tuple[int, int, int], kernel: DensityKernel) -> list[str]:
        """Return the loop over the strands of one class: the pulls of a chunk of members."""
        text, room, axes = self.text, self.text.room, self.axes
        kind, first, last = strands
        values = RowValues(text, self.writer, kernel, *strands)
        line_of = text.line_of
        ends = [
            self.writer.index_at(f"{text.name}_line{end}_{kind}", line_of[first:last, end], _from("s", first))
            for end in (0, 1)
        ]
        rows = []
        for name, symbols in (("position", AXES), ("rate", RATES)):
            for axis in axes if symbols[0] in kernel.parameters else ():
                i, j = (f"row_load({name} + {end} + c{_plus(axis * room)})" for end in "ij")
                rows.append(f"const lanes_row {symbols[axis]} = {i} - {j};")
        rows += [
            *values.of_row,
            "lanes_row density;",
            f"{kernel.name}({', '.join(kernel.parameters)}, &density);",
        ]
        rows += [f"row_store(to + c{_plus(axis * room)}, density * {AXES[axis]});" for axis in axes]
        return [
            f"for (s = {first}; s < {last} && m > 0; ++s) {{",
            f"  const int i = {ends[0]}, j = {ends[1]};",
            f"  {self.writer.real} *const to = pull + {len(axes) * room} * s + {NEAR};",
            *(f"  {line}" for line in values.of_strand),
            "  for (c = 0; c < m; c += ROW) {",
            *(f"    {line}" for line in rows),
            "  }",
            "}",
        ]

    def _gather(self, column: int) -> list[str]:
        """Return the statements that add up the pulls on the nodes of a column."""
        text, room, sink = self.text, self.text.room, self.sink
        used = {s for _, first, last in self.strands for s in range(first, last)}
        entries = [entry for entry in text.first.entries(column) if entry[0] in used]
        if not entries:
            return []
        at = text.places(self.writer, sink.target, sink.index[:, 0])(str(column), "k")
        common = f"{at}, q"
        adding = []
        for axis in self.axes:
            line = _plus(axis * room)
            adding.append(f"lanes_row sum{axis} = row_load(force + c{line});")
            for strand, end, offset in entries:
                start = (strand * len(self.axes) + axis) * room + NEAR - offset
                adding.append(f"sum{axis} = sum{axis} {'+' if end else '-'} row_load(pull + c + {start});")
            adding.append(f"row_store(force + c{line}, sum{axis});")
        extent = text.first.extent[column]
        return [
            f"if (n{_plus(extent)} > k) {{",
            f"  const int q = n{_plus(extent)} - k < {text.chunk} ? n{_plus(extent)} - k : {text.chunk};",
            f"  nodes_to_lanes({sink.target}, {common}, {text.chunk}, {room}, force);",
            "  for (c = 0; c < q; c += ROW) {",
            *(f"    {line}" for line in adding),
            "  }",
            f"  lanes_to_nodes(force, {common}, {room}, {sink.target});",
            "}",
        ]


def _plus(number: int) -> str:
    return f" + {number}" if number else ""


def _from(counter: str, first: int) -> str:
    return f"({counter} - {first})" if first else counter
