"""The stage that sets an array to the external force on nodes."""

from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.codegen.table.members.external import ExternalForce
from tensegrity_codegen.codegen.table.members.stage import loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.codegen.table.modules.forces import ModuleForces
from tensegrity_codegen.system.arrays import IntArray


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
            left = self._left()
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

    def _left(self) -> IntArray:
        """Return the entries that no other stage sets."""
        is_left = np.ones(len(self.external.values), dtype=bool)
        if self.modules is not None:
            is_left[self.external.index[self.modules.begun]] = False
        return np.flatnonzero(is_left)
