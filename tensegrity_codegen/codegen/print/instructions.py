"""CasADi's instruction list as single static assignment: each operation names the ones it takes up."""

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
    found: list[Instruction] = []
    work: dict[int, int] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            found.append(Instruction(operation, value=function.instruction_constant(k)))
        elif operation == ca.OP_INPUT:
            found.append(Instruction(operation, place=(source[0], source[1])))
        elif operation == ca.OP_OUTPUT:
            found.append(Instruction(operation, (work[source[0]],), (target[0], target[1])))
            continue
        else:
            found.append(Instruction(operation, tuple(work[place] for place in source)))
        work[target[0]] = k
    return found
