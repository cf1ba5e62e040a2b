"""Forces of repeated modules: each node adds up the pulls of the strands that end in its column."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, DensityKernel
from tensegrity_codegen.codegen.table.members.fours import PULLS, kind_of
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.loops import ModuleStage, ShapeLoops, plus
from tensegrity_codegen.structure.repeated_modules import MAX_SHIFT_GAP
from tensegrity_codegen.system.arrays import IntArray

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.members.external import ExternalForce
    from tensegrity_codegen.codegen.table.members.sinks import AddToNodes


@dataclass(frozen=True)
class ModuleForces(ModuleStage):
    """Adds the pulls of all members in modules that the sink wants to its array."""

    sink: "AddToNodes"
    external: "ExternalForce"

    @cached_property
    def begun(self) -> IntArray:
        """Nodes whose sums begin here, with an external force that is constant."""
        nodes = [
            module.column[column]
            for modules, fresh in zip(self.shapes, self.is_fresh, strict=True)
            for module in modules
            for column in range(len(fresh))
            if fresh[column] and self.ends_in(module, column) and not self.external.arguments
        ]
        return np.concatenate([np.zeros(0, dtype=np.int64), *nodes])

    def write(self, writer: Writer) -> list[str]:
        """Return one block of loops for each shape of modules."""
        classes = writer.model.plan.classes
        kernels = {
            kind: writer.row_kernel(kind_of(classes[kind], PULLS[self.kernel_name])) for kind in self.kinds
        }
        n_axes = writer.model.n_axes
        lines: list[str] = []
        for number, (modules, fresh) in enumerate(zip(self.shapes, self.is_fresh, strict=True)):
            loops = _Forces(writer, modules, number, kernels, n_axes, n_axes)
            loops.sink, loops.external = self.sink, self.external
            loops.fresh = [item and not self.external.arguments for item in fresh]
            lines += loops.write()
        return lines


class _Forces(ShapeLoops):
    """The loops over modules of one shape; parts are pulls, [strand][axis]."""

    sink: "AddToNodes"
    external: "ExternalForce"
    fresh: list[bool]

    def row(self, kernel: DensityKernel) -> list[str]:
        """Return the statements that store a pull."""
        return [
            f"row_store(to + c{plus(axis * self.text.room)}, result[0] * {AXES[axis]});" for axis in self.axes
        ]

    def before(self) -> list[str]:
        """Return where nodes add up: behind the parts."""
        return [f"{self.writer.real} *const sum = part + {self.arrays['part'] * self.text.room};"]

    def chunk(self) -> list[str]:
        """Return the statements that add up the pulls on the nodes of all columns."""
        return [line for column in range(self.text.n_columns) for line in self._gather(column)]

    def _gather(self, column: int) -> list[str]:
        text, room, sink = self.text, self.text.room, self.sink
        entries = self.entries(column)
        if not entries:
            return []
        at = text.places(self.writer, sink.target, sink.index[:, 0])(str(column), "k")
        begin, source = self._begin(column)
        adding = []
        for axis in self.axes:
            line = plus(axis * room)
            adding.append(f"lanes_row sum{axis} = {begin[axis] or f'row_load(sum + c{line})'};")
            for strand, end, offset in entries:
                start = (strand * len(self.axes) + axis) * room + MAX_SHIFT_GAP - offset
                adding.append(f"sum{axis} = sum{axis} {'+' if end else '-'} row_load(part + c + {start});")
            adding.append(f"row_store(sum + c{line}, sum{axis});")
        lines = ", ".join(f"sum{plus(axis * room)}" for axis in self.axes)
        taken = f"nodes_to_lanes({source}, {at}, NULL, 0, q, {text.chunk}, {room}, sum);"
        return self.over_nodes(
            column,
            [
                *([taken] if source else []),
                "for (c = 0; c < q; c += ROW) {",
                *(f"  {line}" for line in adding),
                "}",
                f"lanes_to_nodes({lines}, {at}, NULL, 0, q, {sink.target});",
            ],
        )

    def _begin(self, column: int) -> tuple[list[str], str]:
        """Return what sums of a column begin with, "" for what is read, and the array to read it from."""
        if not self.fresh[column]:
            return [""] * len(self.axes), self.sink.target
        node = np.concatenate([module.column[column] for module in self.text.modules])
        force = self.external.constant[node]
        is_even = [np.array_equal(force[:, axis], np.full(len(force), force[0, axis])) for axis in self.axes]
        begin = [
            f"row_all({self.writer.number(force[0, axis])})" if is_even[axis] else "" for axis in self.axes
        ]
        source = "" if all(is_even) else self.writer.reals("external_constant", self.external.values)
        return begin, source
