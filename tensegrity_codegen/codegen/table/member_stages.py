"""Stages that sum up the forces on nodes: the external ones, then those of members in loops."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.members.access import AddToNodes
from tensegrity_codegen.codegen.table.members.external import ExternalForce
from tensegrity_codegen.codegen.table.members.member_loops import member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Stage, loop
from tensegrity_codegen.codegen.table.members.writer import Writer

# The stage that sets an array to the external force on nodes.


@dataclass(frozen=True)
class FillForces:
    """Sets the entries of the array `target` to the external force on their components."""

    external: ExternalForce
    target: str

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
        if not self.arguments and not len(external.values):
            return []
        if not self.arguments:
            text = writer.real_at("external_constant", external.values, "k")
            return loop("k", len(external.values), [f"{self.target}[k] = {text};"])
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
    """Return the stages that sum up external forces and a kernel's pulls."""
    external = ExternalForce(model, sink.index)
    return [FillForces(external, sink.target), *member_loops(model, kernel, sink)]
