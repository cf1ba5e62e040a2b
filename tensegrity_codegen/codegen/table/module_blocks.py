"""Matrix blocks of repeated modules, straight to their places: off the diagonal set, on it summed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.blocks import AddBlocks
from tensegrity_codegen.codegen.table.fours import kind_of
from tensegrity_codegen.codegen.table.model import IntArray
from tensegrity_codegen.codegen.table.module_columns import BlockLoops
from tensegrity_codegen.codegen.table.module_loops import ModuleStage
from tensegrity_codegen.codegen.table.module_text import shapes_of
from tensegrity_codegen.codegen.table.writer import Writer
from tensegrity_codegen.modules import Module

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
            loops = BlockLoops(writer, modules, number, kernels, size, size, written)
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
