"""CasADi's instruction list as single static assignment, and the order in which its operations are printed.

Each operation names the ones it takes up.

Compilers keep the order of long straight-line code more or less (gcc does not schedule before it gives out
registers), and cores look a few hundred operations ahead. So operations are issued here as an idealised core
would: each as soon as its operands are there, the one first from which the longest way leads to a result;
where more values are alive than registers hold, the one first that ends most lives. None passes another that
stands LOOK_AHEAD places before it. The operations stay the same, and so do all results, to the bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Instruction:
    """One instruction; operands: indices of earlier ones, in the order that CasADi applies them.

    place: (argument, entry) of an input, (result, entry) of an output; value: of a constant.
    """

    operation: int
    operands: tuple[int, ...] = ()
    place: tuple[int, int] = (0, 0)
    value: float = 0.0

    @property
    def is_operation(self) -> bool:
        """Whether it computes something: no input, output or constant."""
        return self.operation not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)


def read_instructions(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function in CasADi's own order, whose work places are used again."""
    instructions: list[Instruction] = []
    work: dict[int, int] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            instructions.append(Instruction(operation, value=function.instruction_constant(k)))
        elif operation == ca.OP_INPUT:
            instructions.append(Instruction(operation, place=(source[0], source[1])))
        elif operation == ca.OP_OUTPUT:
            instructions.append(Instruction(operation, (work[source[0]],), (target[0], target[1])))
            continue
        else:
            instructions.append(Instruction(operation, tuple(work[slot] for slot in source)))
        work[target[0]] = k
    return instructions


# Cycles until a result is there, and for which the divider is taken: about those of current x86 cores.
LATENCY = {ca.OP_SQRT: 20, ca.OP_DIV: 13, ca.OP_INV: 13, ca.OP_OUTPUT: 1}
OTHERS = 4
OCCUPIED = {ca.OP_SQRT: 8, ca.OP_DIV: 4, ca.OP_INV: 4}
A_CYCLE = 3  # operations
REGISTERS = 26  # of 32; some stay for constants
LOOK_AHEAD = 800


def order_instructions(instructions: Sequence[Instruction]) -> list[int]:
    """Return indices of all operations and outputs in the order in which they are to be printed."""
    return _Order(instructions).run()


class _Order:
    def __init__(self, instructions: Sequence[Instruction]) -> None:
        self.printed = [
            k
            for k, instruction in enumerate(instructions)
            if instruction.is_operation or instruction.operation == ca.OP_OUTPUT
        ]
        self.operation = [instruction.operation for instruction in instructions]
        self.operands = [
            tuple({k for k in instruction.operands if instructions[k].is_operation})
            for instruction in instructions
        ]
        self.readers: list[list[int]] = [[] for _ in instructions]
        for k in self.printed:
            for operand in self.operands[k]:
                self.readers[operand].append(k)
        self.way = [0] * len(instructions)  # cycles from here to the end
        for k in reversed(self.printed):
            self.way[k] = self._latency(k) + max((self.way[r] for r in self.readers[k]), default=0)
        self.unread = [len(readers) for readers in self.readers]
        self.waits_for = [len(operands) for operands in self.operands]
        self.ready_at = [0] * len(instructions)
        self.alive = 0

    def _latency(self, k: int) -> int:
        return LATENCY.get(self.operation[k], OTHERS)

    def run(self) -> list[int]:
        """Issue operations cycle by cycle."""
        order: list[int] = []
        issued = set[int]()
        ready: list[int] = []
        cycle = divider = oldest = entered = 0
        while len(order) < len(self.printed):
            # Look ahead from the oldest operation that waits
            while oldest < len(self.printed) and self.printed[oldest] in issued:
                oldest += 1
            while entered < min(oldest + LOOK_AHEAD, len(self.printed)):
                ready += [self.printed[entered]] if not self.waits_for[self.printed[entered]] else []
                entered += 1
            limit = self.printed[entered - 1]
            # Issue the best of those whose operands and divider are free
            for _ in range(A_CYCLE):
                free = [
                    k
                    for k in ready
                    if self.ready_at[k] <= cycle and (divider <= cycle or self.operation[k] not in OCCUPIED)
                ]
                if not free:
                    break
                best = max(free, key=self._merit)
                ready.remove(best)
                order.append(best)
                issued.add(best)
                divider = max(divider, cycle + OCCUPIED.get(self.operation[best], 0))
                ready += [k for k in self._issue(best, cycle) if k <= limit]
            cycle += 1
        return order

    def _issue(self, k: int, cycle: int) -> list[int]:
        """Note that k runs; return the operations that waited for it alone."""
        for operand in self.operands[k]:
            self.unread[operand] -= 1
            self.alive -= self.unread[operand] == 0
        self.alive += bool(self.readers[k])
        for reader in self.readers[k]:
            self.waits_for[reader] -= 1
            self.ready_at[reader] = max(self.ready_at[reader], cycle + self._latency(k))
        return [reader for reader in self.readers[k] if not self.waits_for[reader]]

    def _merit(self, k: int) -> tuple[int, int, int]:
        ends = sum(self.unread[operand] == 1 for operand in self.operands[k]) - bool(self.readers[k])
        return (ends if self.alive >= REGISTERS else 0, self.way[k], -k)
