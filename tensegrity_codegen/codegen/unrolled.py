"""Emitter `unrolled`: every wanted function as straight-line C.

For scenes of up to about a hundred members: code and compile time grow with the structure. Values and results
have names: two instructions of different functions that apply the same operations to the same entries of
arguments have the same key, so that a value is found by its operands.
"""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.emitter import Bodies, Emitter, PrunedFunction, is_offered, prune
from tensegrity_codegen.codegen.print.instructions import Instruction, read_instructions
from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes, print_lanes
from tensegrity_codegen.codegen.print.printer import (
    Annotations,
    PrintedBody,
    name_local,
    plain_comment,
    print_body,
    print_columns,
    print_numbers,
)
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import ModelArgument, SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities import OF_COLUMNS
from tensegrity_codegen.tables.request import ModelRequest

# Quantities of members whose values get names in straight-line code, and the prefixes of these names.
MEMBER_PREFIXES = {"member_length": "length", "member_tension": "tension", "force_density": "force_density"}
ANCHORS = "anchor_position"
COMMUTATIVE = frozenset({ca.OP_ADD, ca.OP_MUL})


class NamedValues:
    """The values of a model that have names: components, lengths, tensions and force densities of members."""

    def __init__(self, model: SymbolicModel) -> None:
        self.model = model
        self._keys: dict[tuple[object, ...], int] = {}
        self._named: dict[int, tuple[str, str, str, int]] = {}  # key -> name, heading, prefix, member
        names = list(model.arguments)
        symbols = [argument.symbol for argument in model.arguments.values()]
        axes = tuple("xyz"[axis] for axis in model.frame.axes)
        named = {"member_vector": axes} | {name: (prefix,) for name, prefix in MEMBER_PREFIXES.items()}
        for quantity, prefixes in named.items():
            if not is_offered(model, quantity):
                continue
            function = ca.Function("named_values", symbols, [ca.densify(model.expression(quantity))])
            instructions = read_instructions(function)
            keys = self._find_keys(instructions, names)
            for instruction in instructions:
                if (
                    instruction.operation == ca.OP_OUTPUT
                    and instructions[instruction.operands[0]].is_operation
                ):
                    self._add(keys[instruction.operands[0]], prefixes, instruction.place[1])
                    divisor = instructions[instruction.operands[0]].operands[-1]
                    if quantity == "force_density" and instructions[divisor].operation == ca.OP_SQRT:
                        self._add(keys[divisor], ("length",), instruction.place[1])

    def annotate(self, function: PrunedFunction) -> Annotations:
        """Return names, headings and comments of the body of a function."""
        instructions = read_instructions(function.function)
        owner: dict[str, int] = dict.fromkeys((*function.arguments, function.quantity.name), -1)
        named = {
            k: self._named[key]
            for k, key in enumerate(self._find_keys(instructions, function.arguments))
            # A cable and a bar side by side have two lengths of one name, that of the first
            if key in self._named and owner.setdefault(self._named[key][0], key) == key
        }
        return Annotations(
            name={k: name for k, (name, _, _, _) in named.items()},
            heading={k: heading for k, (_, heading, _, _) in named.items()},
            entry=self.find_entries(function),
            prefix={k: prefix for k, (_, _, prefix, _) in named.items()},
            numbers=self._list_numbers(),
            member={k: member for k, (_, _, _, member) in named.items()},
        )

    def find_entries(self, function: PrunedFunction) -> dict[int, str]:
        """Return entry of the result -> whose it is, as a comment."""
        rows = [self._labels(dimension) for dimension in function.quantity.shape]
        if not rows or not all(rows):
            return {}
        pattern = function.pattern
        if pattern is not None:
            if pattern.shape != tuple(map(len, rows)):
                return {}
            columns = np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.column_start)).tolist()
            entries = zip(pattern.row.tolist(), columns, strict=True)
            return {k: plain_comment(f"{rows[0][i]}, {rows[1][j]}") for k, (i, j) in enumerate(entries)}
        labels = list(rows[0]) if len(rows) == 1 else [f"{a} {b}" for a in rows[0] for b in rows[1]]
        if len(labels) != function.shape[0] * function.shape[1]:
            return {}
        return {k: plain_comment(label) for k, label in enumerate(labels)}

    def _labels(self, dimension: str) -> Sequence[str]:
        frame = self.model.frame
        rates = tuple(f"rate of {name}" for name in frame.coordinate_name)
        labels: dict[str, Sequence[str]] = {
            "n_nodes": frame.node_name,
            "n_members": frame.member_name,
            "n_axes": ["xyz"[axis] for axis in frame.axes],
            "n_coordinates": frame.coordinate_name,
            "n_states": (*frame.coordinate_name, *rates),
            "n_inputs": frame.input_name,
            "n_tension_only": [frame.member_name[e] for e in np.flatnonzero(self.model.subject.tension_only)],
        }
        return labels.get(dimension, ())

    def _add(self, key: int, prefixes: Sequence[str], entry: int) -> None:
        member, component = divmod(entry, len(prefixes))
        frame = self.model.frame
        name = frame.member_name[member]
        heading = plain_comment(name)
        if member < len(frame.connectivity):
            start, end = frame.connectivity[member]
            rings = frame.ring_nodes[member] if frame.ring_nodes else ()
            passed = [frame.node_name[node] for node in (start, *rings, end)]
            heading = plain_comment(f"{name}: {' to '.join(passed)}")
        prefix = prefixes[component]
        self._named.setdefault(key, (name_local(prefix, name, member), heading, prefix, member))

    def _list_numbers(self) -> dict[str, list[float]]:
        """Return properties of members that stand as numbers in expressions."""
        structure = self.model.subject
        if not isinstance(structure, Structure):
            return {}
        return {
            "spring_constant": structure.mu.tolist(),
            "rest_length": structure.rest_length.tolist(),
            "damping": structure.damping.tolist(),
        }

    def _find_keys(self, instructions: Sequence[Instruction], names: Sequence[str]) -> list[int]:
        """Return one number for each instruction, the same for the same operations on the same arguments."""
        keys: list[int] = []
        for instruction in instructions:
            operands = [keys[k] for k in instruction.operands]
            if instruction.operation in COMMUTATIVE:
                operands.sort()
            key: tuple[object, ...] = (instruction.operation, *operands)
            if instruction.operation == ca.OP_INPUT:
                key = (instruction.operation, names[instruction.place[0]], instruction.place[1])
            elif instruction.operation == ca.OP_CONST:
                key = (instruction.operation, instruction.value.hex())
            keys.append(self._keys.setdefault(key, len(self._keys)))
        return keys


MAX_MEMBERS = 400
MAX_OPERATIONS = 150_000
COMPILED_OPERATIONS_A_SECOND = 4_000.0


def check_unrollable(structure: Structure | BodySystem) -> None:
    """Raise FormulationError if unrolling this many members would not compile in reasonable time."""
    if structure.n_members > MAX_MEMBERS:
        raise FormulationError(
            "this structure is too large for the emitter 'unrolled', whose code grows with every member",
            where=f"{structure.name}: model.emitter",
            given=f"{structure.n_members} members",
            allowed=f"at most {MAX_MEMBERS} members",
            hint="a smaller structure",
        ).unless_chosen_otherwise()


def _build(structure: Structure | BodySystem, request: ModelRequest) -> SymbolicModel:
    check_unrollable(structure)
    return build_model(structure, request)


def check_length(model: SymbolicModel, functions: tuple[PrunedFunction, ...]) -> None:
    """Raise FormulationError if these functions would take too long to compile."""
    operations = sum(function.operations for function in functions)
    if operations > MAX_OPERATIONS:
        longest = max(functions, key=lambda function: function.operations)
        seconds = operations / COMPILED_OPERATIONS_A_SECOND
        error = FormulationError(
            "the requested functions are too long for unrolled code",
            where=f"{model.name}: model.quantities",
            given=f"{operations} operations, {seconds:.0f} s to compile; "
            f"{longest.quantity.name} has {longest.operations}",
            allowed=f"at most {MAX_OPERATIONS} operations",
            hint="request fewer quantities (Jacobians are the longest) or use a smaller structure",
        )
        raise error if getattr(model.subject, "bodies", ()) else error.unless_chosen_otherwise()


def _write(model: SymbolicModel, functions: tuple[PrunedFunction, ...], precision: Precision) -> Bodies:
    """Return the statements of all functions; FormulationError if they would take too long to compile."""
    check_length(model, functions)
    landmarks, opened = NamedValues(model), _open_anchors(model)
    landmarks_opened = None if opened is None else NamedValues(opened)
    statements, n_loops = {}, 0
    for function in functions:
        name, arguments = function.quantity.name, list(function.arguments)
        if function.quantity.over_columns:
            before = function.sparsity.numel() // 2 if function.quantity.follows_state else 0
            printed = print_columns(function.function, arguments, OF_COLUMNS, name, before)
        else:
            printed = PrintedBody((), frozenset())
            if opened is not None and landmarks_opened is not None:
                with_anchors = _replace_anchors(opened, function)
                if with_anchors is not None:
                    symbols = opened.arguments[ANCHORS]
                    printed = _print(landmarks_opened, with_anchors, precision, symbols)
            if not printed.n_loops:
                printed = _print(landmarks, function, precision)
        n_loops += printed.n_loops
        statements[name] = printed.lines
    preamble = [render("member_row.c", {"real": precision.c_type})] if n_loops else []
    count = len(model.frame.column_name)
    return Bodies(statements, [*preamble, *([render("column_lanes.c", {"count": count})] if count else ())])


def _open_anchors(model: SymbolicModel) -> SymbolicModel | None:
    """Return the model with its anchors as symbols, so that all members have the same operations.

    None where it has no anchors, or where some of them can change.
    """
    structure = model.subject
    if model.formulation != "node_position" or ANCHORS in model.arguments:
        return None
    anchored = np.flatnonzero(structure.node_anchored[:, list(structure.axes)].any(axis=1))
    if not anchored.size:
        return None
    parameters = {**model.parts.arguments.parameters, ANCHORS: tuple(anchored.tolist())}
    return build_model(structure, ModelRequest(("member_length",), parameters=parameters))


def _replace_anchors(opened: SymbolicModel, function: PrunedFunction) -> PrunedFunction | None:
    """Return the function with anchors as symbols, None where it takes more arguments or is not there."""
    if not is_offered(opened, function.quantity.name):
        return None
    expression = ca.cse(opened.expression(function.quantity.name))
    if expression.shape != function.sparsity.shape:  # derivatives to all that can change
        return None
    expression = ca.project(expression, function.sparsity)
    names = (*function.arguments, ANCHORS)
    symbols = [opened.arguments[name].symbol for name in names]
    if any(ca.depends_on(expression, a.symbol) for name, a in opened.arguments.items() if name not in names):
        return None
    made = ca.Function(function.quantity.name, symbols, [expression])
    return replace(function, function=made, arguments=names)


def _print(
    landmarks: NamedValues,
    function: PrunedFunction,
    precision: Precision,
    anchors: ModelArgument | None = None,
) -> PrintedBody:
    """Return the body of a function; anchors: symbols that stand as numbers."""
    numbers = [] if anchors is None else print_numbers(anchors.nominal, precision)

    def place(array: str, k: int) -> str:
        number = numbers[k] if numbers and array == ANCHORS else ""
        return f"({number})" if number.startswith("-") else number or f"{array}[{k}]"

    arguments, annotations = list(function.arguments), landmarks.annotate(function)
    results = [function.quantity.name]
    return print_body(function.function, arguments, results, precision, place, annotations, with_loops=True)


# Bytes of stack and operations that a body over lanes may have; a longer one evaluates one by one.
MAX_LANE_STACK = 200_000
MAX_LANE_OPERATIONS = 20_000


def write_lanes(
    functions: Sequence[PrunedFunction], width: int, precision: Precision
) -> dict[str, PrintedLanes]:
    """Return the bodies in `width` lanes, by quantity, of functions short enough for compiler and stack."""
    bodies: dict[str, PrintedLanes] = {}
    for function in functions:
        rows = function.function.nnz_in() + function.function.nnz_out()
        is_small = rows * width * precision.dtype.itemsize <= MAX_LANE_STACK
        if function.arguments and function.operations <= MAX_LANE_OPERATIONS and is_small:
            name = function.quantity.name
            bodies[name] = print_lanes(function.function, list(function.arguments), name, precision)
    return bodies


UNROLLED = Emitter("unrolled", _build, is_offered, prune, _write, write_lanes, check_length)
