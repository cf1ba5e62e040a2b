"""The work of external forces, which the potential energy holds."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.access import held_arguments, vector_texts
from tensegrity_codegen.codegen.table.members.external import ExternalForce
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.system.arrays import IntArray


@dataclass(frozen=True)
class ExternalWork:
    """Adds the sum of F_n . r_n over all nodes to the variable `target`, node by node."""

    model: TableModel
    target: str

    @cached_property
    def external(self) -> ExternalForce:
        """External forces on all nodes."""
        count, n_axes = self.model.structure.n_nodes, self.model.n_axes
        return ExternalForce(self.model, np.arange(count * n_axes).reshape(count, n_axes))

    @cached_property
    def node(self) -> IntArray:
        """Nodes that any external force may act on."""
        if self.external.arguments:
            return np.arange(self.model.structure.n_nodes)
        return np.flatnonzero(self.external.constant.any(axis=1))

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        acting = self.external.acting
        place = self.model.place
        used = {"coordinate"} if (place[acting] >= 0).any() else set()
        return self.external.arguments | used | held_arguments(self.model, place[acting])

    @property
    def operations(self) -> int:
        """A multiplication and an addition a component."""
        return self.external.operations + 2 * self.model.n_axes * len(self.node)

    @property
    def repeats(self) -> int:
        """Nodes on which a force may act."""
        return len(self.node)

    def write(self, writer: Writer) -> list[str]:
        """Return the loop over nodes."""
        model, n_axes = self.model, self.model.n_axes
        if not len(self.node):
            return []
        lines, force = [], [f"external[{k}]" for k in range(n_axes)]
        if self.external.arguments:
            lines.append(f"{writer.real} external[{n_axes}];")
            lines.append(
                f"{self.external.function(writer)}{writer.index_at('work_node', self.node, 'n')}, external);"
            )
        else:
            table = writer.reals("work_force", self.external.constant[self.node])
            force = [f"{table}[{n_axes} * n + {k}]" for k in range(n_axes)]
        position = vector_texts(writer, "work", model.place[self.node])
        terms = " + ".join(f"{f} * {r}" for f, r in zip(force, position, strict=True))
        return loop("n", len(self.node), [*lines, f"{self.target} += {terms};"])
