"""Stages that sum up what members do: repeated modules side by side, then loops over the others."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.members.access import AddToNodes
from tensegrity_codegen.codegen.table.members.blocks import AddBlocks
from tensegrity_codegen.codegen.table.members.external import ExternalForce
from tensegrity_codegen.codegen.table.members.member_loops import MemberLoop, member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Stage, loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.columns import ModuleBlocks
from tensegrity_codegen.codegen.table.modules.forces import ModuleForces
from tensegrity_codegen.structure.assembly import MemberGroup

# The stage that sets an array to the external force on nodes.


@dataclass(frozen=True)
class FillForces:
    """Sets the entries of the array `target` to the external force on their components.

    modules: the stage that begins the sums of some nodes with it, if there is one.
    """

    external: ExternalForce
    target: str
    modules: ModuleForces | None = None

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return self.external.arguments

    @property
    def operations(self) -> int:
        """Floating-point operations that are left to run time."""
        return self.external.operations

    @property
    def repeats(self) -> int:
        """Nodes on which a force may act."""
        return int(self.external.wanted.any(axis=1).sum())

    def write(self, writer: Writer) -> list[str]:
        """Return the loop over entries, or over nodes where forces are not all constant."""
        external = self.external
        if not self.arguments:
            # Entries that no other stage sets.
            is_left = np.ones(len(self.external.values), dtype=bool)
            if self.modules is not None:
                is_left[self.external.index[self.modules.nodes_started]] = False
            left = np.flatnonzero(is_left)
            if not len(left):
                return []
            text = writer.real_at("external_constant", external.values[left], "k")
            at = writer.index_at(f"external_{self.target}", left, "k")
            return loop("k", len(left), [f"{self.target}[{at}] = {text};"])
        node = np.flatnonzero(external.wanted.any(axis=1))
        n_axes, entry = external.model.n_axes, external.index[node]
        lines = [f"{writer.real} external[{n_axes}];"]
        lines += [f"{external.function(writer)}{writer.index_at('external_node', node, 'n')}, external);"]
        table = None
        if (entry != np.arange(entry.size).reshape(entry.shape)).any():
            table = writer.integers(f"external_{self.target}", entry)
        for k in range(n_axes):
            at = f"{n_axes} * n + {k}"
            if table is None:
                lines.append(f"{self.target}[{at}] = external[{k}];")
            else:
                lines.append(f"if ({table}[{at}] >= 0) {{ {self.target}[{table}[{at}]] = external[{k}]; }}")
        return loop("n", len(node), lines)


def force_stages(model: TableModel, kernel: str, sink: AddToNodes) -> list[Stage]:
    """Return the stages that sum up external forces and a kernel's pulls: in modules, then in loops."""
    inside = member_loops(model, kernel, sink, lambda group: group.in_module)
    external = ExternalForce(model, sink.index)
    modules = ModuleForces(tuple(inside), kernel, sink, external) if inside else None
    others = member_loops(model, kernel, sink, lambda group: not group.in_module)
    return [FillForces(external, sink.target, modules), *([modules] if modules else []), *others]


def block_stages(
    model: TableModel, kernel: str, sink: AddBlocks, keep: Callable[[MemberGroup], bool] = lambda group: True
) -> tuple[ModuleBlocks, list[MemberLoop]]:
    """Return what writes a kernel's blocks to a matrix: first those in modules, then loops of the others."""
    inside = member_loops(model, kernel, sink, lambda group: group.in_module and keep(group))
    others = member_loops(model, kernel, sink, lambda group: not group.in_module and keep(group))
    return ModuleBlocks(tuple(inside), kernel, sink), others
