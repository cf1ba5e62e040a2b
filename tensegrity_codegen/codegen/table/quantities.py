"""Quantities that loops over tables serve, and the stages that each is made of.

To add one: a builder here, from stages that exist or a new one (see stage.Stage); where members contribute
something new, a kernel in symbolic/members/member_kernel.py and a sink (see members/access.py).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.mass import DivideByMass, KineticEnergy, SolveCoupled, check_mass
from tensegrity_codegen.codegen.table.matrices import MATRICES
from tensegrity_codegen.codegen.table.members.access import (
    AddToNodes,
    AddUp,
    MemberAccess,
    OfFreeMembers,
    StoreForMembers,
    StoreForSome,
    held_arguments,
    vector_texts,
)
from tensegrity_codegen.codegen.table.members.block_pattern import MemberColumns, StoreColumns, store_recipe
from tensegrity_codegen.codegen.table.members.external import ExternalForce, force_stages
from tensegrity_codegen.codegen.table.members.member_loops import member_loops
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import (
    Recipe,
    Stage,
    Statements,
    Writer,
    loop,
    only_where,
)
from tensegrity_codegen.codegen.table.node_quantities import (
    ContactLoop,
    contact_builders,
    contact_forces,
    node_builders,
)
from tensegrity_codegen.structure.assembly import MemberGroup
from tensegrity_codegen.symbolic.members.member_kernel import MemberKernel
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES, MemberQuantity, check_values
from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES

CHANGEABLE = ("rest_length", "spring_constant", "axial_stiffness", "damping")


def member_law(model: TableModel) -> Recipe:
    """Return how rest length, spring constant, damping and anchored part of d_e come about."""
    return Recipe((3 + model.n_axes, model.structure.n_members), (FillLaws(model),))


@dataclass(frozen=True)
class FillLaws:
    """Fills `member_law`: constants from a table, then changes by arguments and inputs."""

    model: TableModel

    @property
    def width(self) -> int:
        """Numbers a member."""
        return 3 + self.model.n_axes

    @cached_property
    def stretched(self) -> list[tuple[int, int, float]]:
        """Entry of a rest length, the input that is added to it, and its gain."""
        return [
            (self.width * target, number, gain)
            for number, source in enumerate(self.model.structure.inputs)
            for target, gain in source.rest_length_gain.items()
        ]

    @cached_property
    def anchors(self) -> list[tuple[int, int, int]]:
        """Entry of an anchored part, its sign and the entry of `anchor_position` that makes it."""
        model, entries = self.model, []
        at = model.argument_index("anchor_position")
        for e, ends in enumerate(model.ends.tolist()):
            for node, sign in zip(ends, (1, -1), strict=True):
                for k in np.flatnonzero(~model.free[node]).tolist() if at[node] >= 0 else []:
                    entries.append((self.width * e + 3 + k, sign, model.n_axes * int(at[node]) + k))
        return entries

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        used = {name for name in CHANGEABLE if name in self.model.parameters}
        return frozenset(
            used | ({"input"} if self.stretched else set()) | ({"anchor_position"} if self.anchors else set())
        )

    @property
    def operations(self) -> int:
        """Floating-point operations."""
        axial = 2 * int(self._axial.sum())
        return axial + len(self.stretched) + len(self.anchors)

    @cached_property
    def _axial(self) -> np.ndarray:
        structure = self.model.structure
        return np.asarray(
            (structure.axial_stiffness != 0) | (self.model.argument_index("axial_stiffness") >= 0)
        )

    def _constants(self) -> FloatArray:
        """Return the constant numbers; the spring constant without EA / rho."""
        model, s = self.model, self.model.structure
        held = np.where(model.free, 0.0, s.node_position[:, model.axes])
        held[model.argument_index("anchor_position") >= 0] = 0.0
        offset = held[model.ends[:, 0]] - held[model.ends[:, 1]]
        return np.column_stack([s.rest_length, s.spring_constant, s.damping, offset])

    @property
    def repeats(self) -> int:
        """Members."""
        return self.model.structure.n_members

    def write(self, writer: Writer) -> list[str]:
        """Return the loops."""
        width, values = self.width, self._constants().ravel()
        lines = loop(
            "k", len(values), [f"member_law[k] = {writer.real_at('member_law_constant', values, 'k')};"]
        )
        for name, column in (("rest_length", 0), ("spring_constant", 1), ("damping", 2)):
            chosen = self.model.parameters.get(name, ())
            entry = width * np.array(chosen, dtype=np.int64) + column
            lines += self._assign(writer, f"law_{name}", entry, f"{name}[n]", "=")
        to = np.array([entry for entry, _, _ in self.stretched], dtype=np.int64)
        inputs = np.array([number for _, number, _ in self.stretched], dtype=np.int64)
        if len(to):
            gain = np.array([gain for _, _, gain in self.stretched])
            source = f"input[{writer.index_at('law_input', inputs, 'n')}]"
            source = writer.scaled("law_gain", gain, "n", source)
            lines += self._assign(writer, "law_stretched", to, source, "+=")
        for sign, mark in ((1, "+="), (-1, "-=")):
            entries = [(entry, source) for entry, s, source in self.anchors if s == sign]
            if entries:
                entry, source = np.array(entries, dtype=np.int64).T
                name = "first" if sign > 0 else "second"
                text = f"anchor_position[{writer.index_at(f'law_anchor_{name}', source, 'n')}]"
                lines += self._assign(writer, f"law_{name}_end", entry, text, mark)
        return lines + self._add_axial(writer) + self._stiffen(writer)

    def _assign(self, writer: Writer, name: str, entry: IntArray, source: str, mark: str) -> list[str]:
        if not len(entry):
            return []
        return loop("n", len(entry), [f"member_law[{writer.index_at(name, entry, 'n')}] {mark} {source};"])

    def _add_axial(self, writer: Writer) -> list[str]:
        """Return the loop that adds EA / rho to spring constants."""
        member = np.flatnonzero(self._axial)
        if not len(member):
            return []
        at = self.model.argument_index("axial_stiffness")[member]
        index = writer.index_at("law_axial_at", at, "n") if (at >= 0).any() else ""
        stiffness = f"axial_stiffness[{index}]"
        if (at < 0).any():
            constant = writer.real_at("law_axial", self.model.structure.axial_stiffness[member], "n")
            stiffness = f"({index} >= 0 ? {stiffness} : {constant})" if index else constant
        entry = writer.index_at("law_axial_entry", self.width * member, "n")
        return loop("n", len(member), [f"member_law[{entry} + 1] += {stiffness} / member_law[{entry}];"])

    def _stiffen(self, writer: Writer) -> list[str]:
        """Return the loop that makes spring constants the largest slopes of laws that are not linear."""
        factor = self.model.structure.largest_slope()
        member = np.flatnonzero(factor != 1.0)
        if not len(member):
            return []
        entry = writer.index_at("law_slope_entry", self.width * member, "n")
        slope = writer.real_at("law_slope", factor[member], "n")
        return loop("n", len(member), [f"member_law[{entry} + 1] *= {slope};"])


def _is_elastic(group: MemberGroup) -> bool:
    return group.member_class.is_elastic


def _residual_rest_length_jacobian(model: TableModel) -> Recipe:
    name, columns = "residual_rest_length_jacobian", MemberColumns(model, is_elastic=True)
    loops = member_loops(model, "static_rest_pull", StoreColumns(name, columns), _is_elastic)
    return store_recipe((model.n_coordinates, model.structure.n_members), loops, columns)


def _tension_jacobian(model: TableModel) -> Recipe:
    rows = MemberRows(MemberColumns(model, is_elastic=True))
    loops = member_loops(model, "tension_gradient", StoreRows("tension_jacobian", rows), _is_elastic)
    return store_recipe((model.structure.n_members, model.n_coordinates), loops, rows)


@dataclass(frozen=True)
class MemberRows:
    """Pattern with the free coordinates of both nodes of member e in row e: that of columns, transposed."""

    columns: MemberColumns

    @cached_property
    def flat_index(self) -> IntArray:
        """(nnz,): coordinate times n_members plus member of each entry, rising."""
        count = self.columns.model.n_coordinates
        return np.sort(self.columns.flat_index % count * self._n_members + self.columns.flat_index // count)

    @property
    def _n_members(self) -> int:
        return self.columns.model.structure.n_members

    @property
    def row(self) -> IntArray:
        """(nnz,): row of each entry."""
        return self.flat_index % self._n_members

    @property
    def start(self) -> IntArray:
        """(n_coordinates + 1,): first entry of each column."""
        return np.searchsorted(
            self.flat_index, np.arange(self.columns.model.n_coordinates + 1) * self._n_members
        )

    def entry(self, member: IntArray) -> IntArray:
        """Return (n, 2, n_axes): entry of each component of both ends of some members, -1 if it is held."""
        model = self.columns.model
        coordinate = model.coordinate[model.ends[member]]
        entries = np.searchsorted(self.flat_index, coordinate * self._n_members + member[:, None, None])
        return np.where(coordinate >= 0, entries, -1)


@dataclass(frozen=True)
class StoreRows(OfFreeMembers):
    """Writes +x at node i and -x at node j into row e of the values `target`."""

    target: str
    rows: MemberRows

    def operations(self, kernel: MemberKernel) -> int:
        """Return one change of sign for each component."""
        return kernel.size

    def statements(self, writer: Writer, access: MemberAccess, results: list[str]) -> list[str]:
        """Return the assignments at both nodes."""
        entry, size, lines = self.rows.entry(access.member), len(results), list[str]()
        table = writer.integers(f"{access.name}_{self.target}_entry", entry)
        for end, sign in ((0, ""), (1, "-")):
            for k in range(size):
                at = f"{table}[{2 * size} * e + {end * size + k}]"
                lines += only_where(entry[:, end, k], at, f"{self.target}[{at}] = {sign}{results[k]};")
        return lines


REST_LENGTHS: Mapping[str, Callable[[TableModel], Recipe]] = {
    "residual_rest_length_jacobian": _residual_rest_length_jacobian,
    "tension_jacobian": _tension_jacobian,
}


# The work of external forces, which the potential energy holds.


@dataclass(frozen=True)
class ExternalWork:
    """Adds the sum of F_n . r_n over all nodes to the variable `target`, node by node."""

    model: TableModel
    target: str

    @cached_property
    def external(self) -> ExternalForce:
        """External forces on all nodes."""
        return ExternalForce.on_all(self.model)

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
        position_index = self.model.place
        used = {"coordinate"} if (position_index[acting] >= 0).any() else set()
        return self.external.arguments | used | held_arguments(self.model, position_index[acting])

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


def _member_builder(
    kernel: str, quantity: str, record: MemberQuantity | None = None
) -> Callable[[TableModel], Recipe]:
    """Return the builder of a quantity of every member; its record checks the structure's values."""

    def build(model: TableModel) -> Recipe:
        if record is not None:
            check_values(record, model.structure)
        count = model.structure.n_members
        is_vector = record is not None and record.is_vector
        loops = member_loops(model, kernel, StoreForMembers(quantity))
        return Recipe((model.n_axes, count) if is_vector else (count, 1), tuple(loops))

    return build


def _selected_builder(kernel: str, quantity: str, mask: str) -> Callable[[TableModel], Recipe]:
    """Return the builder of a quantity of the members that a field `mask` of the structure selects."""

    def build(model: TableModel) -> Recipe:
        chosen = tuple(np.flatnonzero(getattr(model.structure, mask)).tolist())
        return Recipe((len(chosen), 1), tuple(member_loops(model, kernel, StoreForSome(quantity, chosen))))

    return build


def _accelerations(model: TableModel, target: str) -> list[Stage]:
    check_mass(model)
    return [
        *force_stages(model, "pull", AddToNodes(target, model.coordinate)),
        *contact_forces(model, target, model.coordinate),
        DivideByMass(model, target),
        SolveCoupled(model, target),
    ]


def _acceleration(model: TableModel) -> Recipe:
    return Recipe((model.n_coordinates, 1), tuple(_accelerations(model, "acceleration")))


def _state_derivative(model: TableModel) -> Recipe:
    count = model.n_coordinates
    copy = Statements.loop("k", count, ["state_derivative[k] = velocity[k];"], arguments=("velocity",))
    slope = f"@REAL@ *TENSEGRITY_RESTRICT const slope = state_derivative + {count};"
    n_internal = len(model.structure.internal_name)
    rates = [ContactLoop(model, "internal_rate", "state_derivative", start=2 * count)] if n_internal else []
    stages = (copy, *_accelerations(model, "slope"), *rates)
    return Recipe((2 * count + n_internal, 1), stages, before=(slope,))


# Energy -> its terms, which are C variables, and their sum.
ENERGIES: Mapping[str, tuple[tuple[str, ...], str]] = {
    "elastic_energy": (("elastic",), "elastic"),
    "kinetic_energy": (("kinetic",), "kinetic"),
    "potential_energy": (("elastic", "work"), "elastic - work"),
    "total_energy": (("kinetic", "elastic", "work"), "kinetic + (elastic - work)"),
}


def _energy_builder(name: str) -> Callable[[TableModel], Recipe]:
    """Return the builder of an energy, see ENERGIES; contacts store elastic energy."""
    terms, total = ENERGIES[name]

    def build(model: TableModel) -> Recipe:
        stages: list[Stage] = []
        for term in (*terms, "contact") if "work" in terms else terms:
            stages += ENERGY_STAGES[term](model)
        before = tuple(f"@REAL@ {term} = @ZERO@;" for term in terms)
        return Recipe((1, 1), tuple(stages), before, (f"*{name} = {total};",))

    return build


ENERGY_STAGES: Mapping[str, Callable[[TableModel], list[Stage]]] = {
    "elastic": lambda model: list(member_loops(model, "energy", AddUp("elastic"))),
    "contact": lambda model: list(
        [] if model.structure.ground is None else [ContactLoop(model, "contact_energy", "elastic")]
    ),
    "kinetic": lambda model: [KineticEnergy(model, "kinetic")],
    "work": lambda model: [ExternalWork(model, "work")],
}

BUILDERS: Mapping[str, Callable[[TableModel], Recipe]] = {
    **{record.name: _member_builder(record.kernel, record.name, record) for record in MEMBER_QUANTITIES},
    "spring_tension": _member_builder("static_tension", "spring_tension"),
    **node_builders(),
    **contact_builders(),
    "member_law": member_law,
    **{name: _energy_builder(name) for name in ENERGIES},
    "acceleration": _acceleration,
    "state_derivative": _state_derivative,
    **MATRICES,
    **REST_LENGTHS,
    "cable_margin": _selected_builder("margin", "cable_margin", "tension_only"),
    "switch_margin": _selected_builder("switch", "switch_margin", "has_switch"),
}

# Quantities that need the tensions of rigid bars, which loops do not have.
NEED_RIGID_BARS = frozenset(
    (
        *(record.name for record in MEMBER_QUANTITIES if record.follows_tension),
        *(record.name for record in NODE_QUANTITIES if record.follows_bars),
        *("acceleration", "state_derivative", "state_jacobian", "input_jacobian", "rest_length_jacobian"),
    )
)


def served_quantities(formulation: str) -> tuple[str, ...]:
    """Return the names of all quantities that loops over tables serve in a formulation."""
    rigid = find_formulation(formulation).has_rigid_bars
    return tuple(n for n in BUILDERS if (n not in NEED_RIGID_BARS if rigid else n != "spring_tension"))
