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
    from tensegrity_codegen.codegen.table.members.access import AddToNodes
    from tensegrity_codegen.codegen.table.members.external import ExternalForce


@dataclass(frozen=True)
class ModuleForces(ModuleStage):
    """Adds the pulls of all members in modules that the sink wants to its array."""

    sink: "AddToNodes"
    external: "ExternalForce"

    @cached_property
    def nodes_started(self) -> IntArray:
        """Nodes whose sums begin here, with an external force that is constant."""
        nodes = [
            module.column[column]
            for modules, starts_sum in zip(self.shapes, self.starts_sums, strict=True)
            for module in modules
            for column in range(len(starts_sum))
            if starts_sum[column] and self.ends_in(module, column) and not self.external.arguments
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
        for number, (modules, starts_sum) in enumerate(zip(self.shapes, self.starts_sums, strict=True)):
            loops = _Forces(writer, modules, number, kernels, n_axes, n_axes)
            loops.sink, loops.external = self.sink, self.external
            loops.starts_sum = [item and not self.external.arguments for item in starts_sum]
            lines += loops.write()
        return lines


class _Forces(ShapeLoops):
    """The loops over modules of one shape; parts are pulls, [strand][axis]."""

    sink: "AddToNodes"
    external: "ExternalForce"
    starts_sum: list[bool]

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
        """Return the statements that add up the pulls on the nodes of a column."""
        text, line_length, sink = self.text, self.text.room, self.sink
        entries = self.entries(column)
        if not entries:
            return []
        place = text.places(self.writer, sink.target, sink.index[:, 0])(str(column), "k")
        first_value, source = self._find_first_values(column)
        additions = []
        for axis in self.axes:
            line = plus(axis * line_length)
            additions.append(f"lanes_row sum{axis} = {first_value[axis] or f'row_load(sum + c{line})'};")
            for strand, end, offset in entries:
                pull = (strand * len(self.axes) + axis) * line_length + MAX_SHIFT_GAP - offset
                additions.append(f"sum{axis} = sum{axis} {'+' if end else '-'} row_load(part + c + {pull});")
            additions.append(f"row_store(sum + c{line}, sum{axis});")
        lines = ", ".join(f"sum{plus(axis * line_length)}" for axis in self.axes)
        reading = f"nodes_to_lanes({source}, {place}, NULL, 0, q, {text.chunk}, {line_length}, sum);"
        return self.over_nodes(
            column,
            [
                *([reading] if source else []),
                "for (c = 0; c < q; c += ROW) {",
                *(f"  {line}" for line in additions),
                "}",
                f"lanes_to_nodes({lines}, {place}, NULL, 0, q, {sink.target});",
            ],
        )

    def _find_first_values(self, column: int) -> tuple[list[str], str]:
        """Return the first values of a column's sums, "" for what is read, and the array to read it from."""
        if not self.starts_sum[column]:
            return [""] * len(self.axes), self.sink.target
        node = np.concatenate([module.column[column] for module in self.text.modules])
        force = self.external.constant[node]
        # A force that all of these nodes have is a constant in the code.
        is_equal = [np.array_equal(force[:, axis], np.full(len(force), force[0, axis])) for axis in self.axes]
        values = [
            f"row_all({self.writer.number(force[0, axis])})" if is_equal[axis] else "" for axis in self.axes
        ]
        source = "" if all(is_equal) else self.writer.reals("external_constant", self.external.values)
        return values, source
