"""Matrix blocks of repeated modules, straight to their places: off the diagonal set, on it summed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import DensityKernel
from tensegrity_codegen.codegen.table.blocks import AddBlocks
from tensegrity_codegen.codegen.table.fours import kind_of
from tensegrity_codegen.codegen.table.model import IntArray
from tensegrity_codegen.codegen.table.module_loops import ModuleStage, ShapeLoops, plus
from tensegrity_codegen.codegen.table.module_text import common_step, shapes_of
from tensegrity_codegen.codegen.table.writer import Writer
from tensegrity_codegen.modules import NEAR, Module

__all__ = ["ModuleBlocks"]


@dataclass(frozen=True)
class ModuleBlocks(ModuleStage):
    """Writes the blocks of all members in modules that the sink wants to its matrix."""

    sink: AddBlocks

    @cached_property
    def shapes(self) -> list[list[Module]]:
        """Modules by shape, those with a member that the sink wants."""
        return [
            item for item in shapes_of(self.sink.pattern.model) if np.isin(item[0].kind, self.kinds).any()
        ]

    @cached_property
    def kinds(self) -> list[int]:
        """Classes of members that the sink wants."""
        classes = {item.access.group.member_class for item in self.loops}
        return [kind for kind, cls in enumerate(self.sink.pattern.model.plan.classes) if cls in classes]

    @cached_property
    def is_fresh(self) -> list[list[bool]]:
        """For each shape and column: whether no column before holds any of its nodes."""
        touched = np.zeros(self.sink.pattern.model.structure.n_nodes, dtype=bool)
        found = []
        for modules in self.shapes:
            fresh = [True] * len(modules[0].column)
            for module in modules:
                for column, nodes in enumerate(module.column):
                    if self._ends_in(module, column):
                        fresh[column] &= not touched[nodes].any()
                        touched[nodes] = True
            found.append(fresh)
        return found

    def _ends_in(self, module: Module, column: int) -> bool:
        return any(module.kind[strand] in self.kinds for strand, _, _ in module.entries(column))

    def entries_set(self) -> IntArray:
        """Return the entries of the pattern that are set here, whatever they were before."""
        pattern, blocks = self.sink.pattern, []
        for modules, fresh in zip(self.shapes, self.is_fresh, strict=True):
            for module in modules:
                member = module.member[np.isin(module.kind, self.kinds)].ravel()
                blocks += pattern.block_nodes(member)[1::2]
                own = [
                    nodes
                    for column, nodes in enumerate(module.column)
                    if fresh[column] and self._ends_in(module, column)
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
        size, n_axes = next(iter(kernels.values())).stores, writer.model.n_axes
        lines: list[str] = []
        for number, (modules, fresh) in enumerate(zip(self.shapes, self.is_fresh, strict=True)):
            written = n_axes**2 * (2 * len(modules[0].member) + len(modules[0].column))
            loops = _Blocks(writer, modules, number, kernels, size, n_axes**2, written)
            loops.sink, loops.fresh = self.sink, fresh
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


class _Blocks(ShapeLoops):
    """The loops over modules of one shape; parts are -S, [strand][entry], its upper triangle or all rows."""

    sink: AddBlocks
    fresh: list[bool]

    def line(self, r: int, c: int) -> int:
        """Return the number of the result that is entry (r, c)."""
        n = len(self.axes)
        if self.size == n * n:
            return n * r + c
        low, high = min(r, c), max(r, c)
        return low * n - low * (low - 1) // 2 + high - low

    def row(self, kernel: DensityKernel) -> list[str]:
        """Return the statements that store a block with its sign turned, and add up sizes."""
        lines = [
            f"row_store(to + c{plus(entry * self.text.room)}, -result[{entry}]);"
            for entry in range(self.size)
        ]
        if self.sink.size:
            sizes = " + ".join(f"row_abs(result[{entry}])" for entry in range(self.size))
            lines.append(f"total = total + row_upto({sizes}, m - c);")
        return lines

    def chunk(self) -> list[str]:
        """Return the statements that write the blocks of a chunk."""
        lines = [line for strands in self.strands for line in self._off_diagonal(*strands)]
        return lines + [line for column in range(self.text.n_columns) for line in self._diagonal(column)]

    def _off_diagonal(self, kind: int, first: int, last: int) -> list[str]:
        room, lines = self.text.room, []
        counter = f"(s - {first})" if first else "s"
        if len(self.text.modules) > 1:
            counter = f"({last - first} * g + {counter})"
        for end in (0, 1):
            nodes = [
                (self._nodes(module, strand, 1 - end), self._nodes(module, strand, end))
                for module in self.text.modules
                for strand in range(first, last)
            ]
            places = _Places(self, f"off{end}_{kind}", nodes, counter)
            for c in self.axes:
                triple = ", ".join(f"own{plus(self.line(r, c) * room)}" for r in self.axes)
                lines.append(f"lanes_to_nodes({triple}, {places.at(c)}, m, {places.onto(c)});")
        return [
            f"for (s = {first}; s < {last} && m > 0; ++s) {{",
            f"  const {self.writer.real} *const own = part + {self.size * room} * s + {NEAR};",
            *(f"  {line}" for line in lines),
            "}",
        ]

    def _nodes(self, module: Module, strand: int, end: int) -> IntArray:
        column, offset = module.place[strand, end]
        nodes: IntArray = module.column[column][offset : offset + module.n_repetitions]
        return nodes

    def _diagonal(self, column: int) -> list[str]:
        entries, room, n = self.entries(column), self.text.room, len(self.axes)
        if not entries:
            return []
        nodes = [(module.column[column], module.column[column]) for module in self.text.modules]
        places = _Places(self, f"own{column}", nodes, "g" if len(nodes) > 1 else "0")
        lines, adding = [], []
        if not self.fresh[column]:
            lines = [
                f"nodes_to_lanes({places.onto(c)}, {places.at(c)}, q,"
                f" {self.text.chunk}, {room}, sum{plus(c * n * room)});"
                for c in self.axes
            ]
        for c in self.axes:
            for r in self.axes if self.size == n * n else range(c + 1):
                name, here = f"sum{r}{c}", plus((c * n + r) * room)
                start = (
                    f"row_all({self.writer.number(0.0)})"
                    if self.fresh[column]
                    else f"row_load(sum + c{here})"
                )
                adding.append(f"lanes_row {name} = {start};")
                for strand, _, offset in entries:
                    at = (strand * self.size + self.line(r, c)) * room + NEAR - offset
                    adding.append(f"{name} = {name} - row_load(part + c + {at});")
                adding.append(f"row_store(sum + c{here}, {name});")
                if self.size != n * n and r != c:
                    adding.append(f"row_store(sum + c{plus((r * n + c) * room)}, {name});")
        lines += ["for (c = 0; c < q; c += ROW) {", *(f"  {line}" for line in adding), "}"]
        for c in self.axes:
            triple = ", ".join(f"sum{plus((c * n + r) * room)}" for r in self.axes)
            lines.append(f"lanes_to_nodes({triple}, {places.at(c)}, q, {places.onto(c)});")
        return self.over_nodes(column, lines)


class _Places:
    """Where columns of blocks stand: evenly spaced, or as tables of first entries and of lengths say."""

    def __init__(
        self, loops: _Blocks, name: str, nodes: Sequence[tuple[IntArray, IntArray]], counter: str
    ) -> None:
        self.target, writer, prefix = (
            loops.sink.target,
            loops.writer,
            f"{loops.text.name}_{loops.sink.target}",
        )
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
