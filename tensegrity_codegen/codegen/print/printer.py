"""CasADi SX functions as C: a `const` of its own for each value that is read more than once.

A value that is read once stands in the expression that reads it, as long as lines stay short: the compiler
sees the same tree of operations. A value keeps the number of its CasADi instruction (`t12`) or the name that
it is given. Long parts that only matter under a condition stand in an `if`; their values are zero otherwise.
Such blocks cost jumps, which a core may foresee wrongly.

    const double length_bar1 = sqrt(x_bar1 * x_bar1 + y_bar1 * y_bar1 + coordinate[8] * coordinate[8]);
"""

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.codegen.print.instructions import Instruction, read_instructions
from tensegrity_codegen.codegen.print.member_loops import MemberLoop, find_member_loops
from tensegrity_codegen.codegen.print.operations import BINARY, Text, as_truth, count_reads, print_text
from tensegrity_codegen.tables.precision import PRECISIONS, Precision, check_precision

# Operations that a block saves for each value that its condition chooses: a condition with fewer has none.
MIN_SAVED_OPERATIONS = 20


def find_guards(instructions: Sequence[Instruction]) -> dict[int, int]:
    """Return operation -> the condition that guards it, of those in blocks; none is within another.

    An operation is guarded by a condition if everything that reads it is guarded by that, or chooses it or
    zero by that condition.
    """
    unguarded = frozenset[int]()
    guards: list[frozenset[int] | None] = [None] * len(instructions)
    guarded: dict[int, list[int]] = {}
    chosen: dict[int, set[int]] = {}
    for k in reversed(range(len(instructions))):
        instruction, conditions = instructions[k], guards[k] or unguarded
        for condition in conditions if instruction.is_operation else ():
            guarded.setdefault(condition, []).append(k)
        chooses = instruction.operation == ca.OP_IF_ELSE_ZERO
        for position, operand in enumerate(instruction.operands):
            previous, new = guards[operand], conditions
            if chooses and position == 1:
                new = conditions | {instruction.operands[0]}
                chosen.setdefault(instruction.operands[0], set()).add(operand)
            guards[operand] = new if previous is None else previous & new
    blocks: dict[int, int] = {}
    for condition, block in sorted(guarded.items(), key=lambda entry: -len(entry[1])):
        if len(block) >= MIN_SAVED_OPERATIONS * len(chosen[condition]) and blocks.keys().isdisjoint(block):
            blocks.update(dict.fromkeys(reversed(block), condition))
    return blocks


# C99 tells identifiers apart by 63 characters: a longer name would not fit behind a prefix.
LONGEST_NAME = 40
IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)
UNSAFE = re.compile(r"[^\w .,:()\-]", re.ASCII)


def name_local(prefix: str, name: str, number: int) -> str:
    """Return the name of a local variable of a member or node, by its name or number in the scene."""
    fits = len(name) <= LONGEST_NAME and IDENTIFIER.fullmatch(name)
    return f"{prefix}_{name}" if fits else f"{prefix}_{number}"


def plain_comment(text: str) -> str:
    """Return text that can stand in a C comment: every character that could end or change one is a "_"."""
    return UNSAFE.sub("_", text)


Place = Callable[[str, int], str]

DOUBLE = PRECISIONS["double"]

# An expression has at most so many characters and operations; a value that is read by an instruction further
# away than OLDEST is better kept as one number.
LONGEST_EXPRESSION = 80
MAX_OPERATIONS = 8
OLDEST = 40
LONGEST_LINE = 110  # with a comment behind the statement


ROW = 8  # values in one call of MEMBERS, see the template member_row.c


@dataclass(frozen=True)
class Annotations:
    """Names and comments for a body.

    name: instruction -> name of its value; heading: instruction -> comment before it, which stands once;
    entry: entry of the result -> comment behind its assignment; prefix: instruction -> name of such a value
    of any member; numbers: name of a property -> its number for each member; member: instruction -> member.
    """

    name: Mapping[int, str] = field(default_factory=dict)
    heading: Mapping[int, str] = field(default_factory=dict)
    entry: Mapping[int, str] = field(default_factory=dict)
    prefix: Mapping[int, str] = field(default_factory=dict)
    numbers: Mapping[str, Sequence[float]] = field(default_factory=dict)
    member: Mapping[int, int] = field(default_factory=dict)


@dataclass(frozen=True)
class PrintedBody:
    """Statements of one function body, which inputs they read, and how many loops over members they have."""

    lines: tuple[str, ...]
    reads: frozenset[int]
    n_loops: int = 0


def print_number(value: float, precision: Precision = DOUBLE, where: str = "") -> str:
    """Return `value` as a C literal that reads back bit-equal, in single precision rounded first."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    check_precision(value, precision, where)
    text = str(precision.dtype.type(value))  # the shortest text that reads back the same
    return (text if any(mark in text for mark in ".e") else text + ".0") + precision.suffix


def print_numbers(values: ArrayLike, precision: Precision = DOUBLE, where: str = "") -> list[str]:
    """Return numbers as `print_number` does, in the order of their memory; many doubles quickly."""
    numbers = np.asarray(values, dtype=np.float64).ravel()
    if precision is DOUBLE and np.isfinite(numbers).all():
        return list(map(repr, numbers.tolist()))
    return [print_number(number, precision, where) for number in numbers.tolist()]


def print_body(
    function: ca.Function,
    inputs: Sequence[str],
    outputs: Sequence[str],
    precision: Precision = DOUBLE,
    place: Place = lambda name, k: f"{name}[{k}]",
    annotations: Annotations | None = None,
    with_loops: bool = False,
) -> PrintedBody:
    """Return the C statements that evaluate an SX function.

    function: the SX function; inputs, outputs: names of its C arrays, of non-zeros in CasADi's column order,
    in that precision; place: how entry k of such an array is written; annotations: names and comments;
    with_loops: whether operations that members share stand in loops, which need the template member_row.c.
    """
    instructions = read_instructions(function)
    where, uses = f"a constant of {function.name()}", _uses(instructions)
    names = annotations or Annotations()
    body = _Body(instructions, inputs, outputs, precision, place, names, where, uses)
    body.loops = () if not with_loops else find_member_loops(instructions, uses, names.member, names.prefix)
    body.guards = find_guards(instructions)
    return body.print()


def print_columns(
    function: ca.Function, inputs: Sequence[str], seeds: Sequence[str], output: str, before: int = 0
) -> PrintedBody:
    """Return the C statements of a function that is linear in some inputs, for N_COLUMNS columns of these.

    Inputs named in `seeds`, and the output behind its first `before` entries, which depend on none of these,
    are arrays of rows with N_COLUMNS numbers each. Values without seeds are computed once, before a
    loop over as many columns as a column_lanes has.
    """

    def place(name: str, k: int) -> str:
        if name in seeds:
            return f"COLUMNS_OF({name} + {k} * N_COLUMNS + c)"
        return f"{name}[{k}]"

    instructions = read_instructions(function)
    linear: set[int] = set()
    for k, instruction in enumerate(instructions):
        is_seed = instruction.operation == ca.OP_INPUT and inputs[instruction.place[0]] in seeds
        if is_seed or linear.intersection(instruction.operands):
            linear.add(k)
    where, uses = f"a constant of {function.name()}", _uses(instructions)
    body = _Body(instructions, inputs, [output], DOUBLE, place, Annotations(), where, uses, frozenset(linear))
    body.before = before
    printed = body.print()
    loop = ("COLUMNS_EACH(c) {", *(f"  {line}" for line in body.in_loop), "}")
    zero = ("const column_lanes none = {0};",) if any("none" in line for line in loop) else ()
    return PrintedBody((*zero, "int start, c;", *printed.lines, *loop), printed.reads)


def _uses(instructions: Sequence[Instruction]) -> list[tuple[int, ...]]:
    """Return the instructions that read each value, once a place in their C form."""
    found: list[list[int]] = [[] for _ in instructions]
    for k, instruction in enumerate(instructions):
        operands = instruction.operands
        if operands and instruction.is_operation and instruction.operation not in BINARY:
            operands = operands[:1] * count_reads(instruction.operation)
        for operand in operands:
            found[operand].append(k)
    return [tuple(readers) for readers in found]


class _UniqueNames:
    """Names of arrays in one function."""

    def __init__(self, taken: set[str]) -> None:
        self.taken = taken

    def choose(self, name: str) -> str:
        """Return the name, with a number behind it where it is taken."""
        choices = (name if k == 1 else f"{name}_{k}" for k in itertools.count(1))
        unique = next(choice for choice in choices if choice not in self.taken)
        self.taken.add(unique)
        return unique


def _find_property(
    column: Sequence[float], members: Sequence[int | None], numbers: Mapping[str, Sequence[float]]
) -> str:
    """Return the name of the property that has these numbers for these members, "" for none."""
    for name, values in numbers.items():
        if None not in members and tuple(values[m] for m in members if m is not None) == tuple(column):
            return name
    return ""


# Numbers of members in loops that are no property, by the operation that takes them: length beyond which a
# cable is taut; offset of the square of its length; whether a member pushes too.
NUMBER_NAMES = {ca.OP_LT: "limit", ca.OP_ADD: "offset", ca.OP_OR: "is_bar"}


@dataclass
class _Body:
    instructions: Sequence[Instruction]
    inputs: Sequence[str]
    outputs: Sequence[str]
    precision: Precision
    place: Place
    annotations: Annotations
    where: str
    uses: Sequence[tuple[int, ...]]
    linear: frozenset[int] = frozenset()  # instructions that stand in the loop over columns
    before: int = 0  # entries of the result that stand before columns
    in_loop: list[str] = field(default_factory=list)
    guards: Mapping[int, int] = field(default_factory=dict)  # operation in a block -> its condition
    block: set[int] = field(default_factory=set)  # operations of the present block
    in_block: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    value: dict[int, Text] = field(default_factory=dict)
    reads: set[int] = field(default_factory=set)
    headings: set[str] = field(default_factory=set)
    suffix: str = ""  # of values without a name
    loops: Sequence[MemberLoop] = ()
    looped: set[int] = field(default_factory=set)  # operations within loops, and those evaluated before these

    def print(self) -> PrintedBody:
        for k, instruction in enumerate(self.instructions):
            if instruction.operation == ca.OP_CONST:
                number = print_number(instruction.value, self.precision, self.where)
                self.value[k] = Text(f"({number})" if number.startswith("-") else number)
            elif instruction.operation == ca.OP_INPUT:
                self.reads.add(instruction.place[0])
                self.value[k] = Text(self.place(self.inputs[instruction.place[0]], instruction.place[1]))
        if self.loops:
            self._put_loops()
        for k, instruction in enumerate(self.instructions):
            if k in self.looped or instruction.operation in (ca.OP_CONST, ca.OP_INPUT):
                continue
            if self._is_chosen(k) and instruction.operands[1] not in self.value:
                self._put_block(self.guards[instruction.operands[1]])
            if k in self.guards:
                continue
            for operand in instruction.operands if k in self.linear else ():
                if operand not in self.linear and self.value[operand].operations:
                    self._keep(operand)  # computed once, before the loop
            if instruction.operation == ca.OP_OUTPUT and self.linear and instruction.place[1] >= self.before:
                self._put_columns(*instruction.place, instruction.operands[0])
            elif instruction.operation == ca.OP_OUTPUT:
                result, entry = instruction.place
                comment = self.annotations.entry.get(entry, "") if result == 0 else ""
                text = (
                    f"{self.place(self.outputs[result], entry)} = {self.value[instruction.operands[0]].text};"
                )
                fits = comment and len(text) + len(comment) <= LONGEST_LINE
                self.lines.append(f"{text} /* {comment} */" if fits else text)
            else:
                self._evaluate(k)
        return PrintedBody(tuple(self.lines), frozenset(self.reads), len(self.loops))

    def _put_loops(self) -> None:
        """Print the loops over members, behind all that they take from outside."""
        inside = {k for loop in self.loops for step in loop.steps for k in step if k is not None}
        values = {k for loop in self.loops for member in loop.values for k in member}
        before, waiting = set[int](), list(values)
        while waiting:
            k = waiting.pop()
            if k not in before and self.instructions[k].is_operation:
                before.add(k)
                waiting += self.instructions[k].operands
        self.looped = inside | before
        self.guards = {
            k: condition
            for k, condition in self.guards.items()
            if not self.looped.intersection((k, condition))
        }
        for k in sorted(before):
            if k in values and before.isdisjoint(self.uses[k]):
                self.value[k] = self._express(self.instructions[k])
            else:
                self._evaluate(k)
        names = _UniqueNames({*self.inputs, *self.outputs, *self.annotations.name.values()})
        for loop in self.loops:
            self._put_loop(loop, names)

    def _put_loop(self, loop: MemberLoop, names: "_UniqueNames") -> None:
        """Print one loop: values and numbers of the members as arrays, then the operations of one member."""
        count, notes, c_type = len(loop.members), self.annotations, self.precision.c_type
        members = [notes.member.get(k) for k in loop.members]
        headings = [notes.heading[k] for k in loop.members if k in notes.heading]
        if headings:
            self.lines.append(f"/* {', '.join(headings)} */")
        value_names = [names.choose(notes.prefix.get(k, "value")) for k in loop.values[0]]
        one = print_number(1.0, self.precision)  # no length of zero in whole rows
        for slot, name in enumerate(value_names):
            texts = [self.value[row[slot]].text for row in loop.values] + [one] * (-count % ROW)
            rows = [f"MEMBERS({', '.join(texts[m : m + ROW])})" for m in range(0, count, ROW)]
            row_name = names.choose(f"{name}_row")
            self.lines += [
                f"const member_row {row_name}[] = {{{', '.join(rows)}}};",
                f"const {c_type} *const {name} = (const {c_type} *){row_name};",
            ]
        for m, row in enumerate(loop.values):
            for name, k in zip(value_names, row, strict=True):
                if self.value[k].operations:
                    self.value[k] = Text(f"{name}[{m}]")
        sources = [Instruction(ca.OP_INPUT, place=(slot, 0)) for slot in range(len(value_names))]
        arrays = list(value_names)
        constants: list[Instruction] = []
        named: dict[tuple[float, ...], int] = {}
        for column, operation in zip(zip(*loop.numbers, strict=True), loop.number_operations, strict=True):
            if len(set(column)) == 1:
                constants.append(Instruction(ca.OP_CONST, value=column[0]))
                continue
            if column not in named:
                name = _find_property(column, members, notes.numbers) or NUMBER_NAMES.get(operation, "number")
                name = names.choose(name)
                text = ", ".join(print_number(number, self.precision, self.where) for number in column)
                self.lines.append(f"static const {c_type} {name}[{count + -count % ROW}] = {{{text}}};")
                named[column] = len(arrays)
                arrays.append(name)
            constants.append(Instruction(ca.OP_INPUT, place=(named[column], 0)))
        self._put_steps(loop, names, [*sources, *constants], arrays)

    def _put_steps(
        self, loop: MemberLoop, names: "_UniqueNames", sources: Sequence[Instruction], arrays: Sequence[str]
    ) -> None:
        """Print the operations of one member as the body of a loop."""
        offset, prefix = len(sources), self.annotations.prefix
        start = {"value": 0, "number": len(loop.values[0]), "operation": offset}
        prefixes = [
            next((prefix[k] for k in step if k is not None and k in prefix), "") for step in loop.steps
        ]
        results = []
        for step in loop.results:
            operation, references = loop.body[step]
            texts = {"operation": prefixes, "value": arrays}
            factors = {texts[kind][k] if kind in texts else "" for kind, k in references}
            name = prefixes[step] or f"{self.outputs[0]}_term"
            if operation == ca.OP_MUL and "force_density" in factors and len(factors) == 2:
                name = f"pull_{(factors - {'force_density'}).pop()}"
            results.append(names.choose(name))
        instructions = [
            *sources,
            *(
                Instruction(operation, tuple(start[kind] + k for kind, k in references))
                for operation, references in loop.body
            ),
            *(
                Instruction(ca.OP_OUTPUT, (offset + step,), (place, 0))
                for place, step in enumerate(loop.results)
            ),
        ]
        own = _UniqueNames(set())  # members that share a length have two tensions
        notes = Annotations({offset + k: own.choose(f"{name}_e") for k, name in enumerate(prefixes) if name})
        body = _Body(
            instructions,
            arrays,
            results,
            self.precision,
            lambda name, k: f"{name}[e]",
            notes,
            self.where,
            _uses(instructions),
            suffix="_e",
        )
        count = len(loop.members)
        declared = ", ".join(f"{name}[{count + -count % ROW}]" for name in results)
        self.lines.append(f"{self.precision.c_type} {declared};")
        lines = body.print().lines
        self.lines += [
            f"for (int e = 0; e < WHOLE_ROWS({count}); ++e) {{",
            *(f"  {line}" for line in lines),
            "}",
        ]
        for name, step in zip(results, loop.results, strict=True):
            for m, k in enumerate(loop.steps[step]):
                if k is not None:
                    self.value[k] = Text(f"{name}[{m}]")

    def _evaluate(self, k: int) -> None:
        instruction, chosen = self.instructions[k], self._is_chosen(k)
        self.value[k] = self.value[instruction.operands[1]] if chosen else self._express(instruction)
        if self._leaves_block(k) or not (chosen or self._is_read_soon(k)):
            self._keep(k)

    def _is_chosen(self, k: int) -> bool:
        """Whether it is the value of a block, or zero, chosen outside of that block."""
        instruction = self.instructions[k]
        guard = (
            self.guards.get(instruction.operands[1]) if instruction.operation == ca.OP_IF_ELSE_ZERO else None
        )
        return guard is not None and guard != self.guards.get(k)

    def _leaves_block(self, k: int) -> bool:
        return k in self.block and not self.block.issuperset(self.uses[k])

    def _put_block(self, condition: int) -> None:
        """Print all that waits for a condition and whose operands are there."""
        for k, guard in self.guards.items():
            if guard == condition and k not in self.value:
                operands = self.instructions[k].operands
                if all(operand in self.value or operand in self.block for operand in operands):
                    self.block.add(k)
        self.in_block = []
        for k in sorted(self.block):
            self._evaluate(k)
        truth = as_truth(self.value[condition], self.precision.suffix)
        self.lines += (f"if ({truth}) {{", *(f"  {line}" for line in self.in_block), "}")
        self.block = set()

    def _put_columns(self, result: int, entry: int, source: int) -> None:
        """Give the columns of a result their values, zero without a seed."""
        value = self.value[source].text if source in self.linear else "none"
        offset = f"{self.before} + " if self.before else ""
        at = f"COLUMNS_AT({self.outputs[result]} + {offset}{entry - self.before} * N_COLUMNS + c)"
        self.in_loop.append(f"{at} = {value};")

    def _express(self, instruction: Instruction) -> Text:
        """Return the expression of an operation; parts of one that is too long become values before it."""
        if instruction.operation == ca.OP_IF_ELSE_ZERO and self.value[instruction.operands[1]].operations:
            self._keep(instruction.operands[1])  # computed whether it is chosen or not: faster than a jump
        is_linear = not self.linear.isdisjoint(instruction.operands)
        while True:
            value = print_text(
                instruction.operation, [self.value[k] for k in instruction.operands], self.precision
            )
            if is_linear and instruction.operation == ca.OP_IF_ELSE_ZERO:
                value = replace(value, text=f"{value.text.rpartition(' : ')[0]} : none")
            operands = [k for k in instruction.operands if self.value[k].operations]
            is_short = len(value.text) <= LONGEST_EXPRESSION and value.operations <= MAX_OPERATIONS
            if is_short or not operands:
                return value
            self._keep(max(operands, key=lambda k: len(self.value[k].text)))

    def _keep(self, k: int) -> None:
        """Give a value a line of its own."""
        name = self.annotations.name.get(k, f"t{k}{self.suffix}")
        heading = self.annotations.heading.get(k, "")
        if heading and heading not in self.headings:
            self.headings.add(heading)
            self.lines.append(f"/* {heading} */")
        kind, lines = (
            ("column_lanes", self.in_loop) if k in self.linear else (self.precision.c_type, self.lines)
        )
        if self._leaves_block(k):
            lines.append(f"{kind} {name} = {print_number(0.0, self.precision)};")
            self.in_block.append(f"{name} = {self.value[k].text};")
        else:
            lines = self.in_block if k in self.block else lines
            lines.append(f"const {kind} {name} = {self.value[k].text};")
        self.value[k] = Text(name)

    def _is_read_soon(self, k: int) -> bool:
        """Whether a value is read in one place, not far from here, and has no name; or costs nothing."""
        instruction = self.instructions[k]
        if instruction.operation == ca.OP_NEG and not self.value[instruction.operands[0]].operations:
            return True
        if len(self.uses[k]) != 1:
            return False
        (reader,) = self.uses[k]
        if self.instructions[reader].operation == ca.OP_OUTPUT:
            return True
        return k not in self.annotations.name and reader - k <= OLDEST
