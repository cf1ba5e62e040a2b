"""Forces on nodes: weight, loads and force inputs, and the stages that add those of members to them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.table.members.access import AddToNodes
from tensegrity_codegen.codegen.table.members.member_loops import member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Stage, Writer, loop
from tensegrity_codegen.system.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class ExternalForce:
    """F_n = load + sum of u direction + m g on the components `index` >= 0 of nodes.

    index: (n_nodes, n_axes) entries of the filled array, -1 for none.
    """

    model: TableModel
    index: IntArray

    @classmethod
    def on_all(cls, model: TableModel) -> "ExternalForce":
        """Return the force on all components of all nodes, node by node."""
        shape = model.structure.n_nodes, model.n_axes
        return cls(model, np.arange(shape[0] * shape[1]).reshape(shape))

    @cached_property
    def wanted(self) -> NDArray[np.bool_]:
        """(n_nodes, n_axes): components that are asked for."""
        return np.asarray(self.index >= 0)

    @cached_property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that these components depend on."""
        model, filled = self.model, self.wanted
        loaded = filled & (model.argument_index("node_load") >= 0)[:, None]
        changeable = (model.argument_index("node_mass") >= 0)[:, None]
        is_gravity_argument = "gravity" in model.parameters
        pulled = filled & (is_gravity_argument | (model.gravity != 0))
        heavy = changeable | (model.weight_mass != 0)[:, None]
        used = {
            "node_load": loaded.any(),
            "input": (filled & (self._pushed != 0)).any(),
            "gravity": is_gravity_argument and (filled & heavy).any(),
            "node_mass": (pulled & changeable).any(),
        }
        return frozenset(name for name, is_used in used.items() if is_used)

    @cached_property
    def _pushed(self) -> FloatArray:
        """(n_nodes, n_axes): non-zero where a force input acts."""
        model = self.model
        pushed = np.zeros((model.structure.n_nodes, model.n_axes))
        for _, node, direction in model.force_inputs:
            pushed[node] += np.abs(direction)
        return pushed

    @cached_property
    def constant(self) -> FloatArray:
        """(n_nodes, n_axes): load plus weight with the scene's own values [N]."""
        model = self.model
        load = model.structure.node_load[:, model.axes]
        value: FloatArray = load + model.weight_mass[:, None] * model.gravity
        return value

    @cached_property
    def values(self) -> FloatArray:
        """The same for every entry of the filled array."""
        values = np.empty(int(self.wanted.sum()))
        values[self.index[self.wanted]] = self.constant[self.wanted]
        return values

    @cached_property
    def acting(self) -> NDArray[np.bool_]:
        """(n_nodes, n_axes): components on which a force acts or may act."""
        model = self.model
        heavy = (model.weight_mass != 0) | (model.argument_index("node_mass") >= 0)
        weight = heavy[:, None] & ((model.gravity != 0) | ("gravity" in model.parameters))
        loaded = (model.argument_index("node_load") >= 0)[:, None] | (
            model.structure.node_load[:, model.axes] != 0
        )
        return np.asarray(self.wanted & (weight | loaded | (self._pushed != 0)))

    @property
    def operations(self) -> int:
        """Floating-point operations that are left to run time, at most."""
        count = int(self.wanted.sum())
        weight = 2 * count if {"gravity", "node_mass"} & self.arguments else 0
        return weight + (2 * int((self._pushed != 0).sum()) if "input" in self.arguments else 0)

    def function(self, writer: Writer) -> str:
        """Return the beginning of a call of a function of node and result, `force[n_axes]`."""
        model, used, axes = self.model, self.arguments, range(self.model.n_axes)
        names = [name for name in ("input", "node_mass", "node_load", "gravity") if name in used]
        bar_mass, mass = model.inertia.weight_share, None
        has_weight = model.gravity.any() and model.weight_mass.any()
        if has_weight or {"gravity", "node_mass"} & used:
            mass = mass_text(writer, "node", bar_mass, "weight", "node_mass" in used)
        gravity = [f"gravity[{k}]" if "gravity" in used else writer.number(model.gravity[k]) for k in axes]
        symbol = writer.helper(
            "external_force",
            "table_external.c",
            names=names,
            axes=axes,
            n_axes=model.n_axes,
            mass=mass,
            gravity=gravity,
            **self._load_context(writer),
            **self._input_context(writer),
        )
        return f"{symbol}({''.join(name + ', ' for name in names)}"

    def _load_context(self, writer: Writer) -> dict[str, Any]:
        """Return the context of loads: constants, then the position in the argument."""
        model, n_axes = self.model, self.model.n_axes
        at = model.argument_index("node_load")
        load = np.where((at >= 0)[:, None], 0.0, model.structure.node_load[:, model.axes])
        constant = [writer.number(0.0)] * n_axes
        if load.any():
            table = writer.reals("node_constant_load", load)
            constant = [f"{table}[{n_axes} * node + {k}]" for k in range(n_axes)]
        is_argument = "node_load" in self.arguments
        return {
            "load": constant,
            "load_at": writer.index_at("node_load_at", at, "node") if is_argument else None,
            "loads_all": bool((at >= 0).all()),
        }

    def _input_context(self, writer: Writer) -> dict[str, Any]:
        """Return the tables of the inputs on each node."""
        if "input" not in self.arguments:
            return {"start": None}
        start, inputs, direction = self.model.force_input_table
        return {
            "start": writer.integers("node_input_start", start),
            "which": writer.integers("node_input", inputs),
            "direction": writer.reals("node_input_direction", direction),
        }


def mass_text(writer: Writer, node: str, bar_mass: FloatArray, name: str, is_argument: bool) -> str:
    """Return the C expression of a node's mass plus the bars' `share`, constant or maybe an argument."""
    model = writer.model
    chosen = model.argument_index("node_mass")
    if not is_argument:
        return writer.real_at(f"node_{name}_mass", model.structure.node_mass + bar_mass, node)
    at = writer.index_at("node_mass_at", chosen, node)
    changeable = f"node_mass[{at}]"
    if bar_mass.any():
        changeable = f"(node_mass[{at}] + {writer.real_at(f'node_{name}_share', bar_mass, node)})"
    if (chosen >= 0).all():
        return changeable
    constant = writer.real_at(f"node_{name}_mass", model.structure.node_mass + bar_mass, node)
    return f"({at} >= 0 ? {changeable} : {constant})"


# Stages that sum up the forces on nodes: the external ones, then those of members in loops.


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
