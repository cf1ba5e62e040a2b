"""Forces of repeated modules: each node adds up the pulls of the strands that end in its column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tensegrity_codegen.codegen.lanes.kernel import AXES, DensityKernel
from tensegrity_codegen.codegen.table.fours import PULLS, kind_of
from tensegrity_codegen.codegen.table.module_loops import ModuleStage, ShapeLoops, plus
from tensegrity_codegen.codegen.table.module_text import shapes_of
from tensegrity_codegen.codegen.table.writer import Writer
from tensegrity_codegen.modules import NEAR

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.table.loops import AddToNodes

__all__ = ["ModuleForces"]


@dataclass(frozen=True)
class ModuleForces(ModuleStage):
    """Adds the pulls of all members in modules that the sink wants to its array."""

    sink: AddToNodes

    def write(self, writer: Writer) -> list[str]:
        """Return one block of loops for each shape of modules."""
        classes = {item.access.group.member_class for item in self.loops}
        kernels = {
            kind: writer.row_kernel(kind_of(cls, PULLS[self.kernel_name]))
            for kind, cls in enumerate(writer.model.plan.classes)
            if cls in classes
        }
        n_axes = writer.model.n_axes
        lines: list[str] = []
        for number, modules in enumerate(shapes_of(writer.model)):
            loops = _Forces(writer, modules, number, kernels, n_axes, n_axes)
            loops.sink = self.sink
            lines += loops.write() if loops.strands else []
        return lines


class _Forces(ShapeLoops):
    """The loops over modules of one shape; parts are pulls, [strand][axis]."""

    sink: AddToNodes

    def row(self, kernel: DensityKernel) -> list[str]:
        """Return the statements that store a pull."""
        return [
            f"row_store(to + c{plus(axis * self.text.room)}, result[0] * {AXES[axis]});" for axis in self.axes
        ]

    def chunk(self) -> list[str]:
        """Return the statements that add up the pulls on the nodes of all columns."""
        return [line for column in range(self.text.n_columns) for line in self._gather(column)]

    def _gather(self, column: int) -> list[str]:
        text, room, sink = self.text, self.text.room, self.sink
        entries = self.entries(column)
        if not entries:
            return []
        at = text.places(self.writer, sink.target, sink.index[:, 0])(str(column), "k")
        adding = []
        for axis in self.axes:
            line = plus(axis * room)
            adding.append(f"lanes_row sum{axis} = row_load(sum + c{line});")
            for strand, end, offset in entries:
                start = (strand * len(self.axes) + axis) * room + NEAR - offset
                adding.append(f"sum{axis} = sum{axis} {'+' if end else '-'} row_load(part + c + {start});")
            adding.append(f"row_store(sum + c{line}, sum{axis});")
        lines = ", ".join(f"sum{plus(axis * room)}" for axis in self.axes)
        return self.over_nodes(
            column,
            [
                f"nodes_to_lanes({sink.target}, {at}, NULL, 0, q, {text.chunk}, {room}, sum);",
                "for (c = 0; c < q; c += ROW) {",
                *(f"  {line}" for line in adding),
                "}",
                f"lanes_to_nodes({lines}, {at}, NULL, 0, q, {sink.target});",
            ],
        )
