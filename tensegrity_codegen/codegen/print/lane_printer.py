"""CasADi SX functions as C over lanes: the same operations for W evaluations side by side.

A `wide` holds as many values as one register (templates/wide.c.j2), entries of arrays are `stride` apart:

    const wide t5 = wide_load(coordinate + 1 * stride) - wide_load(coordinate + 2 * stride);

Comparisons give a wide_mask, which chooses; functions without a vector form are called lane by lane.
Results are turned into rows while later ones are still worked out: a force waits for the divider.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import Instruction, order_instructions, read_instructions
from tensegrity_codegen.codegen.print.operations import ARITHMETIC, print_operation
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.tables.precision import PRECISIONS, Precision

# Operations on numbers a and b.
NUMBERS: dict[int, str] = ARITHMETIC | {
    ca.OP_ASSIGN: "{a}",
    ca.OP_FABS: "wide_size({a})",
    ca.OP_COPYSIGN: "wide_with_sign({a}, {b})",
    ca.OP_SIGN: "wide_sign({a})",
}

# Comparisons of numbers, and combinations of comparisons.
COMPARISONS: dict[int, str] = {
    ca.OP_LT: "wide_less({a}, {b})",
    ca.OP_LE: "wide_at_most({a}, {b})",
    ca.OP_EQ: "wide_equal({a}, {b})",
    ca.OP_NE: "wide_differs({a}, {b})",
}
COMBINED: dict[int, str] = {
    ca.OP_AND: "mask_and({a}, {b})",
    ca.OP_OR: "mask_or({a}, {b})",
    ca.OP_NOT: "mask_not({a})",
}
# One square root of so many is a minor one.
MINOR = 3

# Results that are turned into rows at once.
BLOCK = 8

TRUTHS = COMPARISONS.keys() | COMBINED.keys()


@dataclass(frozen=True)
class PrintedLanes:
    """Statements of one function body over lanes, and which inputs they read."""

    lines: tuple[str, ...]
    reads: frozenset[int]


def print_lanes(
    function: ca.Function, inputs: Sequence[str], output: str, precision: Precision = PRECISIONS["double"]
) -> PrintedLanes:
    """Return the statements that evaluate an SX function for as many lanes as a wide has."""
    return _Lanes(read_instructions(function), inputs, output, precision, function).print()


@dataclass
class _Lanes:
    instructions: list[Instruction]
    inputs: Sequence[str]
    output: str
    precision: Precision
    function: ca.Function
    results: dict[int, str] = field(default_factory=dict)  # entry -> its value
    roots: dict[int, int] = field(default_factory=dict)  # instruction -> its number
    reads: set[int] = field(default_factory=set)
    lines: list[str] = field(default_factory=list)

    def print(self) -> PrintedLanes:
        as_numbers = self._read_as_numbers()
        for k in order_instructions(self.instructions):
            instruction = self.instructions[k]
            if instruction.operation == ca.OP_OUTPUT:
                self._put(instruction.place[1], self._number(instruction.operands[0]))
            elif instruction.operation in TRUTHS:
                self.lines.append(f"const wide_mask m{k} = {self._truth(instruction)};")
                if k in as_numbers:
                    self.lines.append(f"const wide t{k} = wide_if(m{k}, {self._literal(1.0)});")
            elif instruction.operation == ca.OP_SQRT:
                self.lines.append(f"WIDE_{self._rank(k)}ROOT(t{k}, {self._number(instruction.operands[0])});")
            elif instruction.is_operation:
                self._print_number(k, instruction)
        return PrintedLanes(tuple(self.lines), frozenset(self.reads))

    def _put(self, entry: int, value: str) -> None:
        """Hand out a block of results as soon as it is complete."""
        self.results[entry] = value
        start = entry // BLOCK * BLOCK
        size = self.function.nnz_out(0)
        block = range(start, min(start + BLOCK, size))
        if all(k in self.results for k in block):
            values = [self.results[k] for k in block]
            values += values[-1:] * (BLOCK - len(values))
            arguments = f"{self.output}, {start}, {size}, {len(block)}, stride, in_lanes, {', '.join(values)}"
            self.lines.append(f"put_results({arguments}, &probe);")

    def _read_as_numbers(self) -> set[int]:
        """Return the comparisons whose one or zero something reckons with."""
        numeric: set[int] = set()
        for instruction in self.instructions:
            if instruction.operation in COMBINED:
                continue
            chooser = instruction.operation == ca.OP_IF_ELSE_ZERO
            numeric.update(instruction.operands[1:] if chooser else instruction.operands)
        return numeric

    def _truth(self, instruction: Instruction) -> str:
        if instruction.operation in COMPARISONS:
            operands = [self._number(k) for k in instruction.operands]
            return COMPARISONS[instruction.operation].format(a=operands[0], b=operands[-1])
        operands = [self._mask(k) for k in instruction.operands]
        return COMBINED[instruction.operation].format(a=operands[0], b=operands[-1])

    def _print_number(self, k: int, instruction: Instruction) -> None:
        operands = instruction.operands
        if instruction.operation == ca.OP_IF_ELSE_ZERO:
            value = f"wide_if({self._mask(operands[0])}, {self._number(operands[1])})"
        elif self._divides_by_root(instruction):
            dividend = self._number(operands[0]) if instruction.operation == ca.OP_DIV else self._literal(1.0)
            value = f"WIDE_{self._rank(operands[-1])}OVER({dividend}, t{operands[-1]})"
        elif instruction.operation in NUMBERS:
            a, b = self._number(operands[0]), self._number(operands[-1])
            value = NUMBERS[instruction.operation].format(a=a, b=b, one=self._literal(1.0))
        else:
            call = print_operation(
                instruction.operation,
                ["left_lane[lane]", "right_lane[lane]"][: len(set(operands))],
                self.precision,
            )
            a, b = self._number(operands[0]), self._number(operands[-1])
            self.lines.append(f"WIDE_EACH(t{k}, {a}, {b}, {call});")
            return
        self.lines.append(f"const wide t{k} = {value};")

    def _rank(self, root: int) -> str:
        """Return how a square root is called: cores may work out some by other means."""
        number = self.roots.setdefault(root, len(self.roots))
        return "MINOR_" if number % MINOR == MINOR - 1 else ""

    def _divides_by_root(self, instruction: Instruction) -> bool:
        divides = instruction.operation in (ca.OP_DIV, ca.OP_INV)
        return divides and self.instructions[instruction.operands[-1]].operation == ca.OP_SQRT

    def _mask(self, k: int) -> str:
        if self.instructions[k].operation in TRUTHS:
            return f"m{k}"
        return f"wide_differs({self._number(k)}, {self._literal(0.0)})"

    def _number(self, k: int) -> str:
        instruction = self.instructions[k]
        if instruction.operation == ca.OP_CONST:
            return self._literal(instruction.value)
        if instruction.operation == ca.OP_INPUT:
            self.reads.add(instruction.place[0])
            return f"wide_load({self.inputs[instruction.place[0]]} + {instruction.place[1]} * stride)"
        return f"t{k}"

    def _literal(self, value: float) -> str:
        return f"wide_all({print_number(value, self.precision, f'a constant of {self.function.name()}')})"
