"""C statements of the net force on all nodes, four members at a time.

d_e = r_i - r_j         a node's x, y, z in one vector: one subtraction a member
s_e = t_e / l_e         four members turned into lanes: one root and one division for all of them
f_i -= s_e d_e, f_j += s_e d_e, in the order of the assembly plan
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.lanes.kernel import AXES, RATES, DensityKernel, KernelKind
from tensegrity_codegen.codegen.print.printer import name_local, plain_comment, print_body, print_number
from tensegrity_codegen.symbolic.arguments import SymbolicArguments
from tensegrity_codegen.symbolic.formulations.node_position import NodePosition
from tensegrity_codegen.symbolic.geometry import Scalar
from tensegrity_codegen.tables.laws import MEMBER_VALUES
from tensegrity_codegen.tables.laws.law import compute_spring_constant

# Scalars of a structure as C text: numbers, entries of arguments, or values computed before.


class ScalarTexts:
    """Text of values of `arguments`; the C array `given` takes those that have to be worked out.

    read_names: the arguments of the function. Its result does not depend on the others; where they stand in
    another component of a node, they are one.
    """

    def __init__(self, arguments: SymbolicArguments, read_names: Sequence[str]) -> None:
        self.symbols = {name: arguments.symbols[name] for name in read_names}
        self._others = [symbol for name, symbol in arguments.symbols.items() if name not in read_names]
        self._place = {
            symbol[k].element_hash(): (name, k)
            for name, symbol in self.symbols.items()
            for k in range(symbol.numel())
        }
        self._given: list[Scalar] = []
        self._index: dict[int, int] = {}

    def place(self, value: Scalar) -> tuple[str, int] | None:
        """Return argument and index of a value that is an entry of an argument."""
        return self._place.get(value.element_hash()) if value.is_symbolic() else None

    def text(self, value: Scalar) -> str:
        """Return the C text of a scalar."""
        entry = self.place(value)
        if entry is not None:
            return f"{entry[0]}[{entry[1]}]"
        ones = [ca.SX.ones(symbol.shape) for symbol in self._others]
        (value,) = ca.substitute([value], self._others, ones) if self._others else (value,)
        if value.is_constant():
            return print_number(float(value))
        key = value.element_hash()
        if key not in self._index:
            self._index[key] = len(self._given)
            self._given.append(value)
        return f"given[{self._index[key]}]"

    def four(self, values: Sequence[Scalar]) -> str:
        """Return the C text of one value of each of four members, loaded at once where they lie in a row."""
        entries = [self.place(value) for value in values]
        start = entries[0]
        if start is not None and entries == [(start[0], start[1] + k) for k in range(4)]:
            return f"four_load({start[0]} + {start[1]})"
        return f"four_of({', '.join(self.text(value) for value in values)})"

    def lines(self) -> list[str]:
        """Return the statements that work out `given`; to be called when all texts are made."""
        if not self._given:
            return []
        names = list(self.symbols)
        function = ca.Function("given", [self.symbols[name] for name in names], [ca.vertcat(*self._given)])
        body = print_body(function, names, ["given"]).lines
        return [f"double given[{len(self._given)}];", "{", *[f"  {line}" for line in body], "}"]


Kernels = Callable[[KernelKind], DensityKernel]


@dataclass
class ForceLines:
    """The statements of one function up to node vectors force0, force1, ...

    parts: expressions of the structure; nodes: those whose force is wanted; arguments: names of what the
    function takes; is_static: forces without damping; kernels: gives the C function of a kind of members;
    is_checked_by_sums: the statements add up `length_sum` and `density_sum`, see codegen.lanes.emitter.
    """

    parts: NodePosition
    nodes: Sequence[int]
    arguments: Sequence[str]
    is_static: bool
    kernels: Kernels
    has_forces: bool = True
    is_checked_by_sums: bool = False
    _lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.structure = self.parts.structure
        self.scalars = ScalarTexts(self.parts.arguments, self.arguments)
        self.wanted = np.isin(np.arange(self.structure.n_nodes), list(self.nodes))
        values = self.parts.arguments
        self.values: dict[str, list[Scalar]] = {
            "spring_constant": list(values.spring_constant),
            "axial_stiffness": list(values.axial_stiffness),
            "rest_length": list(values.rest_length),
            "damping": [ca.SX(0.0)] * self.structure.n_members if self.is_static else list(values.damping),
            **{name: list(parameters) for name, parameters in values.law_parameter.items()},
        }
        # mu = k + EA / rho stands for both if it is a number.
        for e in range(self.structure.n_members):
            stiffness = [
                self.values[name][e] for name in ("spring_constant", "axial_stiffness", "rest_length")
            ]
            if all(value.is_constant() for value in stiffness):
                self.values["spring_constant"][e] = compute_spring_constant(*stiffness)
                self.values["axial_stiffness"][e] = ca.SX(0.0)

    def lines(self) -> list[str]:
        """Return all statements."""
        self._nodes()
        quads = {e: quad for kind in self._kinds() for quad in kind for e in quad}
        done: set[tuple[int, ...]] = set()
        later: list[str] = []
        plan = self.parts.members.plan
        for e, end in plan.ends.tolist():
            node = int(self.structure.connectivity[e, end])
            if not self.wanted[node]:
                continue
            quad = quads[e]
            if quad not in done:
                self._quad(len(done), quad)
                done.add(quad)
            force, pull = self.of_node("force", node), self.of_member("pull", e)
            later.append(f"{force} = xyz_{'plus' if end else 'minus'}({force}, {pull});")
        return [*self.scalars.lines(), *self._sums_begin(), *self._lines, *later]

    def of_node(self, prefix: str, node: int) -> str:
        """Return the C name of a vector of a node."""
        return name_local(prefix, self.structure.node_name[node], node)

    def of_member(self, prefix: str, member: int) -> str:
        """Return the C name of a vector of a member."""
        return name_local(prefix, self.structure.member_name[member], member)

    def _sums_begin(self) -> list[str]:
        names = ("length_sum", "density_sum")[: 1 + self.has_forces] if self.is_checked_by_sums else ()
        return [f"lanes_pack {name} = pack_all(0.0);" for name in names]

    def _kinds(self) -> list[list[tuple[int, ...]]]:
        """Return fours of members that take the same values, in the order of the plan.

        Bars and cables share fours where their law is linear, which compares nothing but lengths with rest
        lengths; see MIXED.
        """
        by_kind: dict[tuple[Any, ...], list[int]] = {}
        for e in self.parts.members.plan.member.tolist():
            if not self.wanted[self.structure.connectivity[e]].any():
                continue
            used = tuple(name for name in MEMBER_VALUES if not self.values[name][e].is_zero())
            tension_only = None if self.structure.is_linear[e] else bool(self.structure.tension_only[e])
            by_kind.setdefault((used, tension_only), []).append(e)
        return [
            [tuple(members[k : k + 4]) for k in range(0, len(members), 4)] for members in by_kind.values()
        ]

    def _nodes(self) -> None:
        arguments = self.parts.arguments
        moving = not self.is_static and any(not c.is_zero() for c in arguments.damping)
        ends = self.structure.connectivity
        for node in np.unique(ends[self.wanted[ends].any(axis=1)]).tolist():
            self._vector(self.of_node("position", node), arguments.position[node], "coordinate")
            if moving:
                self._vector(self.of_node("velocity", node), arguments.velocity[node], "velocity")
        for node in self.nodes if self.has_forces else ():
            force = self.parts.external_force[node]
            self._lines.append(f"lanes_xyz {self.of_node('force', node)} = xyz_of({self._three(force)});")

    def _vector(self, name: str, vector: Sequence[Scalar], argument: str) -> None:
        entries = [self.scalars.place(value) for value in vector]
        start = entries[0]
        value = f"xyz_of({self._three(vector)})"
        if start is not None and entries == [(argument, start[1] + k) for k in range(3)]:
            suffix = "_last" if start[1] + 4 > self.parts.arguments.symbols[argument].numel() else ""
            value = f"xyz_load{suffix}({argument} + {start[1]})"
        self._lines.append(f"const lanes_xyz {name} = {value};")

    def _three(self, vector: Sequence[Scalar]) -> str:
        return ", ".join(self.scalars.text(value) for value in vector)

    def _quad(self, number: int, quad: tuple[int, ...]) -> None:
        """Work out the pulls of up to four members."""
        kernel = self._lanes(number, quad, "density")
        passed = self._passed(number, kernel)
        self._lines.append(f"const lanes_four density_{number} = {kernel.name}_four({passed});")
        if self.is_checked_by_sums:
            self._lines.append(f"density_sum = density_sum + four_size(density_{number});")
        for k, e in enumerate(quad):
            pull, vector = self.of_member("pull", e), self.of_member("d", e)
            self._lines.append(f"const lanes_xyz {pull} = XYZ_TIMES(density_{number}, {k}, {vector});")

    def _lanes(self, number: int, quad: tuple[int, ...], result: str) -> DensityKernel:
        """Bring the operands of a kernel into lanes; the last member stands in for those that are missing."""
        members = [*quad, *[quad[-1]] * (4 - len(quad))]
        used = tuple(name for name in MEMBER_VALUES if not self.values[name][quad[0]].is_zero())
        only = [bool(self.structure.tension_only[e]) for e in members]
        kind = KernelKind(used, self.is_static, any(only), any(only) and not all(only), result)
        kernel = self.kernels(kind)
        names = ", ".join(self.structure.member_name[e] for e in quad)
        self._lines.append(f"/* {plain_comment(names)} */")
        for e in quad:
            self._difference("d", e, "position")
            if RATES[0] in kernel.parameters:
                self._difference("rate", e, "velocity")
        self._split(number, AXES, "d", members)
        if self.is_checked_by_sums:
            vector = ", ".join(f"{axis}_{number}" for axis in AXES)
            self._lines.append(f"length_sum = length_sum + four_square({vector});")
        if RATES[0] in kernel.parameters:
            self._split(number, RATES, "rate", members)
        for name in kernel.parameters:
            if name in MEMBER_VALUES:
                self._value(f"{name}_{number}", [self.values[name][e] for e in members])
            elif name == "two_sided":
                # Zero is less than one, not than zero: a comparison makes the mask.
                self._value(f"{name}_{number}", [ca.SX(0.0 if is_cable else 1.0) for is_cable in only])
        return kernel

    def _difference(self, prefix: str, member: int, of: str) -> None:
        """Take the difference of a vector of the two nodes of a member."""
        i, j = (self.of_node(of, int(node)) for node in self.structure.connectivity[member])
        self._lines.append(f"const lanes_xyz {self.of_member(prefix, member)} = xyz_minus({i}, {j});")

    def _split(self, number: int, names: Sequence[str], prefix: str, members: Sequence[int]) -> None:
        fours = [f"{name}_{number}" for name in names]
        self._lines.append(f"lanes_four {', '.join(fours)};")
        vectors = ", ".join(self.of_member(prefix, e) for e in members)
        self._lines.append(f"four_split({vectors}, {', '.join(f'&{four}' for four in fours)});")

    def _value(self, name: str, values: list[Scalar]) -> None:
        value = self.scalars.four(values)
        if all(scalar.is_constant() for scalar in values):
            value = f"four_of({', '.join(print_number(float(scalar)) for scalar in values)})"
        self._lines.append(f"const lanes_four {name} = {value};")

    def _passed(self, number: int, kernel: DensityKernel) -> str:
        return ", ".join(f"{name}_{number}" for name in kernel.parameters)
