"""Emitter `lanes`: the code of `unrolled`, with forces and stiffness of four members at a time.

Vectors are those of the target: two or four numbers, or single ones. The operations on every node and their
order are those of `unrolled`, so the bits are the same.

Stiffness: the blocks of four members are turned into columns of three rows, one vector each. A column of the
matrix holds the nodes next to its own from top to bottom: vectors are stored whole, one row too many, which
the next store overwrites. Sums follow the assembly plan: the bits are those of sums entry by entry.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.emitter import Bodies, Emitter, PrunedFunction, is_offered, prune
from tensegrity_codegen.codegen.lanes.force import ForceLines, Kernels
from tensegrity_codegen.codegen.lanes.kernel import (
    BLOCKS,
    DensityKernel,
    KernelKind,
    build_kernel,
    emit_kernels,
)
from tensegrity_codegen.codegen.print.printer import LONGEST_LINE, name_local, plain_comment, print_body
from tensegrity_codegen.codegen.unrolled import UNROLLED, write_lanes
from tensegrity_codegen.symbolic.formulations.node_position import NodePosition
from tensegrity_codegen.symbolic.members.member import MemberBlocks
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities.nodes import NODE_QUANTITIES

# The columns of a symmetric block: where their rows stand in its upper triangle, row by row.
COLUMNS = ((0, 1, 2), (1, 3, 4), (2, 4, 5))

Terms = list[tuple[int, int]]  # (member, sign), in the order in which they add up


@dataclass(frozen=True)
class _Run:
    """Rows of one node in one column: the first of them among the non-zeros, how many."""

    column: int
    node: int
    first: int
    count: int


def write_columns(
    model: NodePosition, sparsity: ca.Sparsity, result: str, lane_of_member: Mapping[int, tuple[int, int]]
) -> list[str] | None:
    """Return the statements; None if the rows of a node are not x, x and y, or x, y and z in a row.

    lane_of_member: member -> (number of its four, lane), of members whose blocks stand in block0, block1, ...
    """
    runs = _find_runs(model, sparsity)
    if runs is None:
        return None
    terms = _find_terms(model, lane_of_member)
    lines = []
    for number in sorted({number for number, _ in lane_of_member.values()}):
        lines += [f"lanes_xyz column{number}[12];", f"four_join_columns(block{number}, column{number});"]
    axis_of = {coordinate: key for key, coordinate in model.map.index.items()}
    names = model.structure.node_name
    for run in runs:
        node, axis = axis_of[run.column]
        value = _sum(terms[run.node, node], model.map.axes.index(axis), lane_of_member)
        rows, column = names[run.node], f"{names[node]}_{'xyz'[axis]}"
        lines += _store(result, run, sparsity.nnz(), value, plain_comment(f"{rows}, {column}"))
    return lines


def _find_runs(model: NodePosition, sparsity: ca.Sparsity) -> list[_Run] | None:
    node_axis = {coordinate: key for key, coordinate in model.map.index.items()}
    runs, (start, rows) = [], (sparsity.colind(), sparsity.row())
    for column in range(sparsity.size2()):
        entry = start[column]
        keys = [node_axis[row] for row in rows[start[column] : start[column + 1]]]
        for node, group in itertools.groupby(keys, key=lambda key: key[0]):
            axes = [axis for _, axis in group]
            n_free = sum((node, axis) in model.map.index for axis in model.map.axes)
            if axes != list(range(len(axes))) or len(axes) != n_free:
                return None
            runs.append(_Run(column, node, entry, len(axes)))
            entry += len(axes)
    return runs


def _find_terms(
    model: NodePosition, lane_of_member: Mapping[int, tuple[int, int]]
) -> dict[tuple[int, int], Terms]:
    """Return (node of the rows, node of the columns) -> terms, as CoordinateMap.member_matrix adds them."""
    terms: dict[tuple[int, int], Terms] = {}
    for e, end in model.members.plan.ends.tolist():
        if e in lane_of_member:
            node, far_node = model.ends[e][end], model.ends[e][1 - end]
            terms.setdefault((node, node), []).append((e, 1))
            terms.setdefault((far_node, node), []).append((e, -1))
    return terms


def _sum(terms: Sequence[tuple[int, int]], axis: int, lane_of_member: Mapping[int, tuple[int, int]]) -> str:
    value = ""
    for e, sign in terms:
        number, lane = lane_of_member[e]
        term = f"column{number}[{4 * axis + lane}]"
        if not value:
            value = term if sign > 0 else f"xyz_negative({term})"
        else:
            value = f"xyz_{'plus' if sign > 0 else 'minus'}({value}, {term})"
    return value


def _with_comment(statement: str, comment: str) -> str:
    """Return a statement with a comment behind it, where the line has room for it."""
    line = f"{statement} /* {comment} */"
    return line if len(line) <= LONGEST_LINE else statement


def _store(result: str, run: _Run, size: int, value: str, comment: str) -> list[str]:
    at = f"{result} + {run.first}"
    if run.first + 4 <= size:
        return [_with_comment(f"xyz_store({at}, {value});", comment)]
    if run.count == 3:
        return [_with_comment(f"xyz_store_last({at}, {value});", comment)]
    spare = f"part{run.column}_{run.node}"
    return [
        f"double {spare}[4];",
        _with_comment(f"xyz_store({spare}, {value});", comment),
        *(f"{result}[{run.first + k}] = {spare}[{k}];" for k in range(run.count)),
    ]


# Checks for finite numbers by sums over members: no argument or result is looked at by itself.
#
# length_sum = sum of d_e . d_e, density_sum = sum of |t_e / l_e| over all members. If both are below
# 1e200, each force on a node is the external one and at most 1e200 times 1e100. If a coordinate is not
# finite, length_sum is not either.
MAX_SUM = "1e200"  # of length_sum and density_sum
MAX_EXTERNAL_FORCE = 1e290  # N


def can_check_by_sums(model: NodePosition, arguments: Sequence[str]) -> bool:
    """Return whether a function of these arguments can be checked by sums over the members."""
    if list(arguments) != ["coordinate"]:
        return False
    joined = set(np.unique(model.structure.connectivity).tolist())
    if not set(model.map.coordinate_nodes()) <= joined:
        return False
    external = [ca.SX(value) for vector in model.external_force for value in vector]
    return all(value.is_constant() and abs(float(value)) < MAX_EXTERNAL_FORCE for value in external)


# C statements of stiffness matrices: blocks of four members at a time, then sums of their columns.


# If the sizes of all entries sum up to less, no sum of some of them overflows: the matrix is finite.
MAX_BLOCK_SUM = "1e300"
BLOCK_ENTRIES = 6  # entries of the upper triangle of a block, row by row


class BlockLines(ForceLines):
    """The statements of one matrix that adds symmetric blocks of the members."""

    def __init__(self, model: NodePosition, function: PrunedFunction, kernels: Kernels) -> None:
        nodes = list(model.map.coordinate_nodes())
        by_sums = can_check_by_sums(model, function.arguments)
        super().__init__(
            model, nodes, function.arguments, True, kernels, has_forces=False, is_checked_by_sums=by_sums
        )
        self.function = function

    def lines(self) -> list[str]:
        """Return all statements."""
        self._nodes()
        lane_of_member: dict[int, tuple[int, int]] = {}
        for four, quad in enumerate(quad for kind in self._kinds() for quad in kind):
            kernel = self._lanes(four, quad, self.function.quantity.name)
            self._lines += [
                f"double block{four}[{4 * BLOCK_ENTRIES}];",
                f"total = total + {kernel.name}_four({self._passed(four, kernel)}, block{four});",
            ]
            lane_of_member |= {e: (four, lane) for lane, e in enumerate(quad)}
        sum_declarations = ["lanes_pack total = pack_all(0.0);", *self._sums_begin()]
        finite_check = f"all_finite({self.function.quantity.name}, {self.function.sparsity.nnz()})"
        return_statement = f"return pack_is_below(total, {MAX_BLOCK_SUM}) || {finite_check};"
        if self.is_checked_by_sums:
            return_statement = f"return pack_is_below(total + length_sum, {MAX_BLOCK_SUM});"
        name, sparsity = self.function.quantity.name, self.function.sparsity
        sums = write_columns(self.parts, sparsity, name, lane_of_member) or self._sums_of_entries(
            lane_of_member
        )
        return [*self.scalars.lines(), *sum_declarations, *self._lines, *sums, return_statement]

    def _sums_of_entries(self, lane_of_member: dict[int, tuple[int, int]]) -> list[str]:
        members = list(lane_of_member)
        entry = ca.SX.sym("entry", BLOCK_ENTRIES, len(members))
        blocks = {e: _symmetric(entry[:, k]) for k, e in enumerate(members)}
        matrix = self.parts.map.member_matrix(blocks, self.parts.ends, self.parts.members.plan.ends)
        stored_entries = ca.project(matrix, self.function.sparsity)

        def text(name: str, k: int) -> str:
            if name != "entry":
                return f"{name}[{k}]"
            four, lane = lane_of_member[members[k // BLOCK_ENTRIES]]
            return f"block{four}[{4 * (k % BLOCK_ENTRIES) + lane}]"

        sums = ca.Function("sums", [entry], [stored_entries])
        return list(print_body(sums, ["entry"], [self.function.quantity.name], place=text).lines)


def _symmetric(entry: ca.SX) -> MemberBlocks:
    a, b, c, d, e, f = ca.vertsplit(entry)
    return MemberBlocks(((a, b, c), (b, d, e), (c, e, f)))


# Quantities that depend on members through the net forces alone, and whether these are without damping.
_IS_STATIC = {"force": False, "static_force": True, "spring_force": True}
FORCE_QUANTITIES: Mapping[str, bool] = {
    **{
        quantity.name: _IS_STATIC[quantity.uses[0]]
        for quantity in NODE_QUANTITIES
        if quantity.uses[0] in _IS_STATIC and len(quantity.uses) == 1
    },
    "acceleration": False,
    "state_derivative": False,
}

# Those that are node forces as they are: their vectors are looked at before they are stored.
NODE_FORCES = frozenset({"node_residual", "node_force", *BLOCKS})


def _write(model: SymbolicModel, functions: tuple[PrunedFunction, ...], precision: Precision) -> Bodies:
    """Return the statements of `unrolled`, in lanes those of forces in space, in doubles."""
    parts = model.parts
    if not isinstance(parts, NodePosition) or len(parts.structure.axes) != 3 or precision.name != "double":
        return UNROLLED.write(model, functions, precision)
    lane_functions = [
        function for function in functions if function.quantity.name in {*FORCE_QUANTITIES, *BLOCKS}
    ]
    unrolled = UNROLLED.write(
        model, tuple(function for function in functions if function not in lane_functions), precision
    )
    kernels, checked_by_sums = _Kernels(), set[str]()
    statements = dict(unrolled.statements)
    for function in lane_functions:
        name = function.quantity.name
        statements[name] = _force_function(parts, function, kernels)
        if name in NODE_FORCES and can_check_by_sums(parts, function.arguments):
            checked_by_sums.add(name)
    if not kernels.by_text:  # nothing moves, or no member pulls at what does
        return UNROLLED.write(model, functions, precision)
    preamble = emit_kernels(list(kernels.by_text.values()), in_loops=False)
    checked = NODE_FORCES.intersection(statements) - checked_by_sums
    return Bodies(statements, [*unrolled.preamble, *preamble], checked, frozenset(checked_by_sums))


class _Kernels:
    """The kernels of one library, each made once, also where two kinds have the same text."""

    def __init__(self) -> None:
        self.by_text: dict[tuple[tuple[str, ...], tuple[str, ...]], DensityKernel] = {}
        self._by_kind: dict[KernelKind, DensityKernel] = {}

    def __call__(self, kind: KernelKind) -> DensityKernel:
        if kind not in self._by_kind:
            kernel = build_kernel(kind, f"lanes_density{len(self.by_text)}")
            key = (kernel.parameters, kernel.lines)
            self._by_kind[kind] = self.by_text.setdefault(key, kernel)
        return self._by_kind[kind]


def _force_function(parts: NodePosition, function: PrunedFunction, kernels: _Kernels) -> list[str]:
    name, n_nodes = function.quantity.name, parts.structure.n_nodes
    by_sums = name in NODE_FORCES and can_check_by_sums(parts, function.arguments)
    if name in BLOCKS:
        return BlockLines(parts, function, kernels).lines()
    if name == "node_residual":
        entries_of_node = parts.map.coordinate_nodes()
        nodes, result_lines = list(entries_of_node), _write_node_forces(parts, name, entries_of_node, by_sums)
    elif name == "node_force":
        nodes = list(range(n_nodes))
        result_lines = _write_node_forces(
            parts, name, {node: [(3 * node + k, k) for k in range(3)] for node in nodes}, by_sums
        )
    else:
        nodes, result_lines = _write_from_forces(parts, function)
    is_static = FORCE_QUANTITIES[name]
    forces = ForceLines(parts, nodes, function.arguments, is_static, kernels, is_checked_by_sums=by_sums)
    return [*forces.lines(), *result_lines]


def _write_node_forces(
    model: NodePosition, result: str, entries_of_node: Mapping[int, list[tuple[int, int]]], by_sums: bool
) -> list[str]:
    """Return statements that store node forces.

    entries_of_node: of each node the indices in the result, ascending, and their axes.

    A node's vector of four is stored whole where the next node's follows and overwrites the fourth.
    """
    size = sum(len(entries) for entries in entries_of_node.values())
    lines = []
    for node, entries in entries_of_node.items():
        start, force = entries[0][0], _name_vector(model, "force", node)
        if len(entries) == 3:
            suffix = "_last" if start + 4 > size else ""
            lines.append(f"xyz_store{suffix}({result} + {start}, {force});")
            continue
        components = _name_vector(model, "part", node)
        lines += [f"double {components}[4];", f"xyz_store({components}, {force});"]
        lines += [f"{result}[{entry}] = {components}[{axis}];" for entry, axis in entries]
    if by_sums:
        return [*lines, f"return pack_is_below(length_sum + density_sum, {MAX_SUM});"]
    return [*lines, *_check_finite(model, entries_of_node)]


def _name_vector(model: NodePosition, prefix: str, node: int) -> str:
    return name_local(prefix, model.structure.node_name[node], node)


def _check_finite(model: NodePosition, entries_of_node: Mapping[int, list[tuple[int, int]]]) -> list[str]:
    """Return statements that return whether all entries are finite: x - x is 0 then; in two sums."""
    lines, sums = [], ["finite0", "finite1"][: len(entries_of_node)]
    for k, (node, entries) in enumerate(entries_of_node.items()):
        axes = sum(1 << axis for _, axis in entries)
        force = _name_vector(model, "force", node)
        vector = force if axes == 7 else f"XYZ_ONLY({force}, {axes})"
        difference = f"xyz_minus({vector}, {vector})"
        name = sums[k % len(sums)]
        lines.append(
            f"lanes_xyz {name} = {difference};"
            if k < len(sums)
            else f"{name} = xyz_plus({name}, {difference});"
        )
    total = sums[0] if len(sums) == 1 else f"xyz_plus({', '.join(sums)})"
    return [*lines, f"return xyz_is_zero({total});"]


def _write_from_forces(model: NodePosition, function: PrunedFunction) -> tuple[list[int], list[str]]:
    """Return the nodes whose force a quantity needs, and its statements from these."""
    n_nodes, names = model.structure.n_nodes, function.arguments
    force = ca.SX.sym("force", 3, n_nodes)
    vectors = [[force[k, node] for k in range(3)] for node in range(n_nodes)]
    expression = ca.densify(ca.cse(model.with_net_force(vectors).builders()[function.quantity.name]()))
    nodes = [node for node in range(n_nodes) if ca.depends_on(expression, ca.vertcat(*vectors[node]))]
    symbols = [model.arguments.symbols[name] for name in names]
    body = print_body(
        ca.Function("rest", [force, *symbols], [expression]),
        ["force", *names],
        [function.quantity.name],
        place=lambda name, k: f"force[{k // 3 * 4 + k % 3}]" if name == "force" else f"{name}[{k}]",
    )
    stores = [f"xyz_store(force + {4 * node}, {_name_vector(model, 'force', node)});" for node in nodes]
    return nodes, [f"double force[{4 * n_nodes}];", *stores, *body.lines]


LANES = Emitter("lanes", UNROLLED.build, is_offered, prune, _write, write_lanes, UNROLLED.check)
