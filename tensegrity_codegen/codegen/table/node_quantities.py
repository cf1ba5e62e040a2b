"""Quantities of nodes as stages: sums of forces on nodes, and loops that call a kernel a node."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.table.contacts import contact_forces
from tensegrity_codegen.codegen.table.members.access import (
    AddCablesToNodes,
    AddToNodes,
    held_arguments,
    vector_texts,
)
from tensegrity_codegen.codegen.table.members.external import ExternalForce, force_stages, mass_text
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Recipe, Statements, loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES, NodeQuantity

# The kernel of members and the sink that sum up each force on nodes.
FORCES: dict[str, tuple[str, type[AddToNodes]]] = {
    "force": ("pull", AddToNodes),
    "static_force": ("static_pull", AddToNodes),
    "spring_force": ("static_pull", AddToNodes),
    "cable_force": ("pull", AddCablesToNodes),
}


def node_builders() -> dict[str, Callable[[TableModel], Recipe]]:
    """Return the builders of the quantities of nodes that loops over tables serve in node coordinates."""
    builders: dict[str, Callable[[TableModel], Recipe]] = {}
    for quantity in NODE_QUANTITIES:
        if quantity.is_state:
            continue
        if len(quantity.uses) == 1 and quantity.uses[0] in FORCES:
            if _find_sign(quantity):
                builders[quantity.name] = _of_force(quantity)
        elif quantity.components == "n_nodes" and not set(quantity.uses) & FORCES.keys():
            builders[quantity.name] = _of_kernel(quantity)
    return builders


def _find_sign(quantity: NodeQuantity) -> int:
    """Return 1 or -1 where the quantity is the force that it uses, or its negative; else 0."""
    force = [ca.SX.sym(name) for name in "xyz"]
    entries = [
        ca.SX(component) for component in quantity.entries(SimpleNamespace(**{quantity.uses[0]: force}))
    ]
    if len(entries) == len(force):
        for sign in (1, -1):
            if all(ca.is_equal(e, sign * f, 1) for e, f in zip(entries, force, strict=True)):
                return sign
    return 0


def _of_force(quantity: NodeQuantity) -> Callable[[TableModel], Recipe]:
    """Return the builder of a force on all nodes, or on their free or anchored components."""

    def build(model: TableModel) -> Recipe:
        size = (model.structure.n_nodes, model.n_axes)
        index = {
            "n_nodes": np.arange(size[0] * size[1]).reshape(size),
            "n_coordinates": model.coordinate,
            "n_anchored_coordinates": model.anchored,
        }[quantity.components]
        count, name = int((index >= 0).sum()), quantity.name
        shape = (size[1], size[0]) if quantity.components == "n_nodes" else (count, 1)
        if not count:
            return Recipe(shape, ())
        kernel, sink = FORCES[quantity.uses[0]]
        stages = force_stages(model, kernel, sink(name, index))
        if quantity.uses[0] == "force":
            stages += contact_forces(model, name, index)
        if _find_sign(quantity) < 0:
            stages.append(Statements.loop("k", count, [f"{name}[k] = -{name}[k];"]))
        return Recipe(shape, tuple(stages))

    return build


def _of_kernel(quantity: NodeQuantity) -> Callable[[TableModel], Recipe]:
    """Return the builder of a function of each node by itself."""

    def build(model: TableModel) -> Recipe:
        stage = NodeLoop(model, quantity)
        return Recipe((stage.kernel.size, model.structure.n_nodes), (stage,))

    return build


@dataclass(frozen=True)
class NodeLoop:
    """The loop over all nodes that reads each, calls the kernel and stores its results."""

    model: TableModel
    quantity: NodeQuantity

    @cached_property
    def kernel(self) -> MemberKernel:
        """The quantity as a function of one node."""
        size = {name: 1 if name == "mass" else self.model.n_axes for name in self.quantity.uses}
        symbols = {name: ca.SX.sym(name, count) for name, count in size.items()}
        node = SimpleNamespace(**{k: s if k == "mass" else ca.vertsplit(s) for k, s in symbols.items()})
        result = ca.cse(ca.densify(ca.vertcat(*self.quantity.entries(node))))
        inputs = tuple(name for name, symbol in symbols.items() if ca.depends_on(result, symbol))
        function = ca.Function(self.quantity.name, [symbols[name] for name in inputs], [result])
        return MemberKernel(self.quantity.name, function, inputs, int(result.numel()))

    @cached_property
    def external(self) -> ExternalForce:
        """Weight, loads and force inputs on all nodes."""
        return ExternalForce.on_all(self.model)

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        model, used, free = self.model, set[str](), bool(self.model.free.any())
        if "position" in self.kernel.inputs:
            used |= ({"coordinate"} if free else set()) | held_arguments(model, model.place)
        if "velocity" in self.kernel.inputs and free:
            used.add("velocity")
        if "mass" in self.kernel.inputs and "node_mass" in model.parameters:
            used.add("node_mass")
        if "load" in self.kernel.inputs:
            used |= self.external.arguments
        return frozenset(used)

    @property
    def operations(self) -> int:
        """Floating-point operations of the whole loop."""
        external = self.external.operations if "load" in self.kernel.inputs else 0
        return external + self.repeats * self.kernel.operations

    @property
    def repeats(self) -> int:
        """Number of nodes."""
        return self.model.structure.n_nodes

    def write(self, writer: Writer) -> list[str]:
        """Return the loop."""
        model, n_axes, count = self.model, self.model.n_axes, self.repeats
        lines: list[str] = []
        values: list[str] = []
        for name in self.kernel.inputs:
            if name in ("position", "velocity"):
                values += vector_texts(writer, "node", model.place, is_rate=name == "velocity")
            elif name == "mass":
                bar_mass, is_argument = model.inertia.weight_share, "node_mass" in model.parameters
                values.append(mass_text(writer, "n", bar_mass, "weight", is_argument))
            elif self.external.arguments:
                lines += [f"{writer.real} external[{n_axes}];"]
                lines += [f"{self.external.function(writer)}n, external);"]
                values += [f"external[{k}]" for k in range(n_axes)]
            else:
                table = writer.reals("external_load", self.external.constant)
                values += [f"{table}[{n_axes} * n + {k}]" for k in range(n_axes)]
        results = [f"&{self.quantity.name}[{self.kernel.size} * n + {k}]" for k in range(self.kernel.size)]
        call = f"{writer.node_kernel(self.kernel)}({', '.join([*values, *results])});"
        return loop("n", count, [*lines, call])
