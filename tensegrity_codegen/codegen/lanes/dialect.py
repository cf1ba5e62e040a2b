"""Two ways to write vectors of members: packs of four, and rows of as many as a register holds."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.operations import ARITHMETIC
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.precision import PRECISIONS, Precision

Put = Callable[[int, str], str]

COMPARISONS = (ca.OP_LT, ca.OP_AND)


@dataclass(frozen=True)
class Dialect:
    """How vectors are declared, filled with one number, and worked with; what compares gives a `mask`."""

    vector: str
    mask: str
    fill: str
    operations: dict[int, str]
    precision: Precision = PRECISIONS["double"]

    def in_precision(self, precision: Precision) -> "Dialect":
        """Return the same for numbers of another precision."""
        return replace(self, precision=precision)

    def print(self, function: ca.Function, inputs: tuple[str, ...], put: Put) -> list[str]:
        """Return the statements that evaluate an SX function.

        inputs: names of its arguments; put: (entry, value) -> the statement that hands a result out. Raises
        FormulationError for an operation that has no form here.
        """
        lines: list[str] = []
        work: list[str] = []
        for k, item in enumerate(read_instructions(function)):
            operands = [work[operand] for operand in item.operands]
            work.append(f"t{k}")
            if item.operation == ca.OP_CONST:
                work[k] = self._number(item.value)
            elif item.operation == ca.OP_INPUT:
                work[k] = inputs[item.place[0]]
            elif item.operation == ca.OP_OUTPUT:
                lines.append(put(item.place[1], operands[0]))
            else:
                declared = self.mask if item.operation in COMPARISONS else self.vector
                lines.append(f"const {declared} t{k} = {self._operation(item.operation, operands)};")
        return lines

    def _operation(self, operation: int, operands: list[str]) -> str:
        if operation not in self.operations:
            raise FormulationError(
                f"CasADi operation {operation} has no form in lanes", where="codegen.lanes"
            )
        return self.operations[operation].format(a=operands[0], b=operands[-1], one=self._number(1.0))

    def _number(self, value: float) -> str:
        return f"{self.fill}({print_number(value, self.precision)})"


# Bars and cables in one pack: a lane whose member holds both ways takes its value whatever it compares.
HOLDS = "pack_or({a}, pack_less(pack_all(0.0), two_sided))"
PACKS = Dialect(
    vector="lanes_pack",
    mask="lanes_pack",
    fill="pack_all",
    operations=ARITHMETIC
    | {
        ca.OP_SQRT: "pack_sqrt({a})",
        ca.OP_LT: "pack_less({a}, {b})",
        ca.OP_AND: "pack_and({a}, {b})",
        ca.OP_IF_ELSE_ZERO: "pack_and({a}, {b})",
    },
)
MIXED = replace(PACKS, operations=PACKS.operations | {ca.OP_IF_ELSE_ZERO: f"pack_and({HOLDS}, {{b}})"})

# Members that repeat each other; a comparison gives a mask of a type of its own.
ROWS = Dialect(
    vector="lanes_row",
    mask="lanes_mask",
    fill="row_all",
    operations=ARITHMETIC
    | {
        ca.OP_SQRT: "row_sqrt({a})",
        ca.OP_LT: "row_less({a}, {b})",
        ca.OP_AND: "row_both({a}, {b})",
        ca.OP_IF_ELSE_ZERO: "row_where({a}, {b})",
    },
)
