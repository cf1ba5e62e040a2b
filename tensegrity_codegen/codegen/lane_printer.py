"""CasADi SX functions as C over lanes: the same operations for W evaluations side by side.

Every array holds W values an entry, [entry][W]. The statements stand in blocks, each a loop over the lanes
that compilers turn into vector instructions:

    block: squared lengths ... | roots: l = sqrt(s), 1 / l | block: tensions, forces ...

A block ends where square roots are needed, before and after functions that have no vector form, and after
BLOCK_STATEMENTS. What one block leaves to a later one stands in `spare`, [slot][W].
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from tensegrity_codegen.codegen.instructions import Instruction, read_instructions
from tensegrity_codegen.codegen.printer import print_number, print_operation
from tensegrity_codegen.precision import PRECISIONS, Precision

__all__ = ["LaneBlock", "PrintedLanes", "print_lanes"]

# gcc makes no vectors of a loop with more than about a thousand loads and stores.
BLOCK_STATEMENTS = 250

# Functions that compilers do not put into vectors without relaxed rules; they stand in loops of their own.
SCALAR_CALLS = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        *("EXP", "LOG", "LOG1P", "EXPM1", "POW", "CONSTPOW", "HYPOT", "SIN", "COS", "TAN", "ASIN", "ACOS"),
        *("ATAN", "ATAN2", "SINH", "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "ERF", "FLOOR", "CEIL", "FMOD"),
        *("REMAINDER", "FMIN", "FMAX"),
    )
)


@dataclass(frozen=True)
class LaneBlock:
    """Statements of one loop over the lanes; then square roots are due: the first of them and how many."""

    lines: tuple[str, ...]
    first_root: int = 0
    n_roots: int = 0


@dataclass(frozen=True)
class PrintedLanes:
    """Blocks of one function body, how many values a lane stand between them, and which inputs they read."""

    blocks: tuple[LaneBlock, ...]
    n_spare: int
    n_roots: int
    reads: frozenset[int]


def print_lanes(
    function: ca.Function,
    inputs: Sequence[str],
    outputs: Sequence[str],
    width: int,
    precision: Precision = PRECISIONS["double"],
) -> PrintedLanes:
    """Return the blocks that evaluate an SX function in `width` lanes, k being the lane.

    inputs, outputs: names of its C arrays, [non-zero][width]. A division by a square root is printed as
    TENSEGRITY_OVER(a, root, inverse root). Raises what print_body raises.
    """
    instructions = read_instructions(function)
    return _Lanes(instructions, inputs, outputs, width, precision, function.name()).print()


def _steps(instructions: list[Instruction]) -> list[int]:
    """Return the earliest step of each instruction: even ones compute and then take roots, odd ones call."""
    step: list[int] = []
    for item in instructions:
        calls = item.operation in SCALAR_CALLS
        earliest = int(calls)
        for k in item.operands:
            after = _delay(instructions[k].operation, step[k], calls)
            earliest = max(earliest, step[k] + after)
        step.append(earliest)
    return step


def _delay(operation: int, step: int, for_call: bool) -> int:
    if for_call:
        return 1 - step % 2
    return 2 if operation == ca.OP_SQRT else step % 2


def _blocks(instructions: list[Instruction]) -> list[list[int]]:
    """Return the instructions of each block, in an order that keeps CasADi's within a block."""
    step = _steps(instructions)
    printed = [
        k for k, item in enumerate(instructions) if item.is_operation or item.operation == ca.OP_OUTPUT
    ]
    printed.sort(key=lambda k: (step[k], k))
    blocks: list[list[int]] = []
    for _, group in itertools.groupby(printed, key=lambda k: step[k]):
        members = list(group)
        count = -(-len(members) // BLOCK_STATEMENTS)
        blocks += [members[len(members) * n // count : len(members) * (n + 1) // count] for n in range(count)]
    return blocks


@dataclass
class _Lanes:
    instructions: list[Instruction]
    inputs: Sequence[str]
    outputs: Sequence[str]
    width: int
    precision: Precision
    name: str
    root: dict[int, int] = field(default_factory=dict)  # instruction -> its place in `root`
    slot: dict[int, int] = field(default_factory=dict)  # instruction -> its place in `spare`
    reads: set[int] = field(default_factory=set)

    def print(self) -> PrintedLanes:
        blocks = _blocks(self.instructions)
        n_spare = self._take_slots(blocks)
        printed: list[LaneBlock] = []
        n_due = 0
        for number, block in enumerate(blocks):
            lines = self._lines(block)
            n_due += sum(self.instructions[k].operation == ca.OP_SQRT for k in block)
            following = blocks[number + 1] if number + 1 < len(blocks) else []
            due = n_due if self._reads_roots(following, len(self.root) - n_due) else 0
            printed.append(LaneBlock(tuple(lines), len(self.root) - n_due, due))
            n_due -= due
        return PrintedLanes(tuple(printed), n_spare, len(self.root), frozenset(self.reads))

    def _reads_roots(self, block: list[int], first: int) -> bool:
        operands = {k for item in block for k in self.instructions[item].operands}
        return any(self.root.get(k, -1) >= first for k in operands)

    def _take_slots(self, blocks: list[list[int]]) -> int:
        """Give a slot to every value that a later block reads; return how many there are."""
        block_of = {k: number for number, block in enumerate(blocks) for k in block}
        last: dict[int, int] = {}
        for k, number in block_of.items():
            for operand in self.instructions[k].operands:
                last[operand] = max(last.get(operand, 0), number)
        ends: dict[int, list[int]] = {}
        free: list[int] = []
        total = 0
        for number, block in enumerate(blocks):
            for k in block:
                item = self.instructions[k]
                if item.is_operation and item.operation != ca.OP_SQRT and last.get(k, number) > number:
                    if not free:
                        free, total = [total], total + 1
                    self.slot[k] = free.pop()
                    ends.setdefault(last[k], []).append(self.slot[k])
            # Only now: a block must not write over what it still reads.
            free += ends.get(number, [])
        return total

    def _lines(self, block: list[int]) -> list[str]:
        lines: list[str] = []
        known: set[int] = set()
        for k in block:
            item = self.instructions[k]
            if self._divides_by_root(item):
                lines.append(f"const {self.precision.c_type} t{k} = {self._quotient(item, known, lines)};")
                self._keep(k, known, lines)
                continue
            operands = [self._operand(operand, known, lines) for operand in item.operands]
            if item.operation == ca.OP_OUTPUT:
                lines.append(f"{self._at(self.outputs[item.place[0]], item.place[1])} = {operands[0]};")
            elif item.operation == ca.OP_SQRT:
                self.root[k] = len(self.root)
                lines.append(f"{self._at('root', self.root[k])} = {operands[0]};")
            else:
                value = print_operation(item.operation, operands, self.precision)
                lines.append(f"const {self.precision.c_type} t{k} = {value};")
                self._keep(k, known, lines)
        return lines

    def _keep(self, k: int, known: set[int], lines: list[str]) -> None:
        known.add(k)
        if k in self.slot:
            lines.append(f"{self._at('spare', self.slot[k])} = t{k};")

    def _divides_by_root(self, item: Instruction) -> bool:
        return item.operation in (ca.OP_DIV, ca.OP_INV) and item.operands[-1] in self.root

    def _quotient(self, item: Instruction, known: set[int], lines: list[str]) -> str:
        dividend = f"1.0{self.precision.suffix}"
        if item.operation == ca.OP_DIV:
            dividend = self._operand(item.operands[0], known, lines)
        place = self.root[item.operands[-1]]
        return f"TENSEGRITY_OVER({dividend}, {self._at('root', place)}, {self._at('inverse', place)})"

    def _operand(self, k: int, known: set[int], lines: list[str]) -> str:
        """Return an operand as a C expression, fetching it first if another block made it."""
        item = self.instructions[k]
        if item.operation == ca.OP_CONST:
            number = print_number(item.value, self.precision, f"a constant of {self.name}")
            return f"({number})" if number.startswith("-") else number
        if item.operation == ca.OP_INPUT:
            self.reads.add(item.place[0])
            return self._at(self.inputs[item.place[0]], item.place[1])
        if k not in known:
            place = self._at("root", self.root[k]) if k in self.root else self._at("spare", self.slot[k])
            lines.append(f"const {self.precision.c_type} t{k} = {place};")
            known.add(k)
        return f"t{k}"

    def _at(self, array: str, entry: int) -> str:
        return f"{array}[{entry * self.width} + k]"
