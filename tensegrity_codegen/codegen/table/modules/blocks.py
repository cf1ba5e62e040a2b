"""Matrix blocks of repeated modules, straight to their places: off the diagonal set, on it summed."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.fours import kind_of
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.columns import BlockLoops
from tensegrity_codegen.codegen.table.modules.loops import ModuleStage
from tensegrity_codegen.codegen.table.modules.runs import TOGETHER
from tensegrity_codegen.system.arrays import IntArray


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
