"""Quantities of nodes and contacts as stages: sums of forces, and loops that call a kernel a node."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.table.members.access import (
    AddCablesToNodes,
    AddToNodes,
    held_arguments,
    vector_texts,
)
from tensegrity_codegen.codegen.table.members.external import ExternalForce, force_stages, mass_text
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Recipe, Statements, Writer, loop, only_where
from tensegrity_codegen.structure.ground import CHANGEABLE, Ground
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.symbolic.node_forces.ground_contact import (
    Contact,
    build_contact,
    count_bristles,
    put_numbers,
)
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES, NodeQuantity

# Results of the kernel of one contact, by quantity.
RESULTS: Mapping[str, Callable[[Contact], list[Any]]] = {
    "contact_force": lambda contact: contact.force,
    "internal_rate": lambda contact: contact.bristle_rate,
    "contact_energy": lambda contact: [contact.energy()],
    "penetration": lambda contact: [contact.depth],
    "contact_margin": lambda contact: [contact.contact_margin()],
    "stick_margin": lambda contact: [contact.stick_margin()],
}
STORED = ("contact_force", "internal_rate", "penetration", "contact_margin", "stick_margin")
# Quantities of structures on the ground that loops do not have: forces at rest, and derivatives of forces.
WITHOUT_CONTACTS = frozenset(
    (
        *(
            quantity.name
            for quantity in NODE_QUANTITIES
            if {"static_force", "spring_force"} & set(quantity.uses)
        ),
        *("tangent_stiffness", "state_jacobian", "input_jacobian", "rest_length_jacobian"),
    )
)
NEED_FRICTION = ("internal_rate", "stick_margin")


@dataclass(frozen=True)
class ContactLoop:
    """The loop over contacts that calls their kernel; the result goes to `target`.

    quantity: one of RESULTS; index: (n_nodes, n_axes) entries of `target` that forces on nodes are added to,
    None if each contact stores its results, from entry `start` on, or adds its energy to a variable.
    """

    model: TableModel
    quantity: str
    target: str
    index: IntArray | None = None
    start: int = 0

    @property
    def ground(self) -> Ground:
        """The ground of the structure."""
        assert self.model.structure.ground is not None
        return self.model.structure.ground

    @property
    def changeable(self) -> tuple[int, ...]:
        """Places in CHANGEABLE of the run-time numbers of the ground."""
        return tuple(self.model.parameters.get("ground", ()))

    @cached_property
    def kernel(self) -> MemberKernel:
        """The results as a function of the node's position and velocity, its radius and its bristle."""
        symbols = {name: ca.SX.sym(name, self.model.n_axes) for name in ("position", "velocity")}
        symbols["radius"] = ca.SX.sym("radius")
        count = count_bristles(self.model.structure)
        bristle = {f"bristle{k}": ca.SX.sym(f"bristle{k}") for k in range(count)}
        changed = {CHANGEABLE[k]: ca.SX.sym(CHANGEABLE[k]) for k in self.changeable}
        contact = build_contact(
            self.ground,
            put_numbers(self.ground, changed),
            self.model.structure.axes,
            (ca.vertsplit(symbols["position"]), *[ca.vertsplit(symbols["velocity"])] * 2),
            symbols["radius"],
            list(bristle.values()),
        )
        result = ca.cse(ca.densify(ca.vertcat(*RESULTS[self.quantity](contact))))
        symbols |= bristle | changed
        inputs = tuple(name for name, symbol in symbols.items() if ca.depends_on(result, symbol))
        function = ca.Function(self.quantity, [symbols[name] for name in inputs], [result])
        return MemberKernel(self.quantity, function, inputs, int(result.numel()))

    @property
    def place(self) -> IntArray:
        """(n_contacts, n_axes): see TableModel.place."""
        return self.model.place[self.ground.node]

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        used, inputs = set[str](), self.kernel.inputs
        if "position" in inputs:
            used |= {"coordinate"} | held_arguments(self.model, self.place)
        used |= {"velocity"} if "velocity" in inputs else set()
        used |= {"ground"} if set(CHANGEABLE).intersection(inputs) else set()
        return frozenset(
            used | ({"internal"} if any(name.startswith("bristle") for name in inputs) else set())
        )

    @property
    def operations(self) -> int:
        """Floating-point operations of the whole loop."""
        return self.repeats * (self.kernel.operations + self.kernel.size)

    @property
    def repeats(self) -> int:
        """Number of contacts."""
        return self.ground.n_contacts

    def write(self, writer: Writer) -> list[str]:
        """Return the loop."""
        values: list[str] = []
        count = count_bristles(self.model.structure)
        for name in self.kernel.inputs:
            if name in ("position", "velocity"):
                values += vector_texts(writer, "contact", self.place, is_rate=name == "velocity")
            elif name in CHANGEABLE:
                values.append(f"ground[{self.changeable.index(CHANGEABLE.index(name))}]")
            elif name == "radius":
                values.append(writer.real_at("contact_radius", self.ground.radius, "n"))
            else:
                values.append(f"internal[{count} * n + {name.removeprefix('bristle')}]")
        results = [f"contact{k}" for k in range(self.kernel.size)]
        called = ", ".join([*values, *(f"&{name}" for name in results)])
        lines = [f"{writer.real} {', '.join(results)};", f"{writer.node_kernel(self.kernel)}({called});"]
        return loop("n", self.repeats, [*lines, *self._use(writer, results)])

    def _use(self, writer: Writer, results: list[str]) -> list[str]:
        if self.quantity == "contact_energy":
            return [f"{self.target} += {results[0]};"]
        size = len(results)
        if self.index is None:
            offset = f"{self.start} + " if self.start else ""
            return [
                f"{self.target}[{offset}{size} * n + {k}] = {result};" for k, result in enumerate(results)
            ]
        entry, lines = self.index[self.ground.node], []
        table = writer.integers(f"contact_{self.target}_entry", entry)
        for k, result in enumerate(results):
            at = f"{table}[{size} * n + {k}]"
            lines += only_where(entry[:, k], at, f"{self.target}[{at}] += {result};")
        return lines


def contact_forces(model: TableModel, target: str, index: IntArray) -> list[ContactLoop]:
    """Return the stage that adds the forces of the ground to those on nodes, none without a ground."""
    if model.structure.ground is None:
        return []
    return [ContactLoop(model, "contact_force", target, index)]


def contact_builders() -> dict[str, Callable[[TableModel], Recipe]]:
    """Return the builders of the quantities of contacts."""
    return {name: _store(name) for name in STORED}


def _store(name: str) -> Callable[[TableModel], Recipe]:
    def build(model: TableModel) -> Recipe:
        ground = model.structure.ground
        if ground is None or (name in NEED_FRICTION and not ground.friction):
            return Recipe((0, 1), (), is_empty=True)
        stage = ContactLoop(model, name, name)
        size, count = stage.kernel.size, ground.n_contacts
        is_vector = name == "contact_force"
        return Recipe((size, count) if is_vector else (size * count, 1), (stage,))

    return build


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
    """Return 1 or -1 if the quantity is the force that it uses, or its negative; else 0."""
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
