"""Force densities and stiffness blocks of members as C over vectors: the same operations, one lane a member.

Vectors are packs of four, or rows of as many members as a register holds.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.operations import ARITHMETIC
from tensegrity_codegen.codegen.print.printer import print_number
from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.members.member_blocks import MemberBlocks
from tensegrity_codegen.symbolic.members.member_kernel import KERNELS
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.laws import MEMBER_VALUES
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


Scalar = Any

AXES = ("x", "y", "z")
RATES = ("x_rate", "y_rate", "z_rate")

# Symmetric blocks by quantity: their upper triangles are results of a kernel, row by row.
BLOCKS: dict[str, Callable[[Member], MemberBlocks]] = {
    "material_stiffness": lambda m: m.material_block(),
    "geometric_stiffness": lambda m: m.geometric_block(),
    "tangent_stiffness": lambda m: m.tangent_block(),
}


@dataclass(frozen=True)
class KernelKind:
    """Which values a law takes, and who pulls only: all members of a pack, none, or (`is_mixed`) some.

    values: those of MEMBER_VALUES that are not zero for all members; result: "density", or a name of
    BLOCKS, or over rows one of KERNELS.
    """

    values: tuple[str, ...]
    is_static: bool
    tension_only: bool
    is_mixed: bool = False
    result: str = "density"


@dataclass(frozen=True)
class DensityKernel:
    """One C function over packs: its name, its parameters, its statements.

    stores: how many results it stores, four apart, to return the sum of their sizes; one that stores none
    returns its result.
    """

    name: str
    parameters: tuple[str, ...]
    lines: tuple[str, ...]
    stores: int = 0


@functools.cache
def build_kernel(kind: KernelKind, name: str) -> DensityKernel:
    """Return the kernel of a kind; FormulationError for an operation that packs do not have."""
    function, parameters = _build(kind, name, len(AXES))
    result, sizes = int(function.size1_out(0)), list[str]()

    def put(entry: int, value: str) -> str:
        if result == 1:
            return f"return {value};"
        sizes.append(f"pack_absolute({value})")
        return f"pack_store(block + {4 * entry}, {value});"

    lines = (MIXED if kind.is_mixed else PACKS).print(function, parameters, put)
    if sizes:
        lines.append(f"return {' + '.join(sizes)};")
    stores = 0 if kind.result == "density" else result
    parameters = (*parameters, "two_sided") if kind.is_mixed else parameters
    return DensityKernel(name, parameters, tuple(lines), stores)


@functools.cache
def build_row_kernel(kind: KernelKind, name: str, n_axes: int, precision: Precision) -> DensityKernel:
    """Return the kernel of a kind over rows, of members in so many axes; errors as of build_kernel."""
    function, parameters = _build(kind, name, n_axes)
    lines = ROWS.in_precision(precision).print(
        function, parameters, lambda entry, value: f"result[{entry}] = {value};"
    )
    return DensityKernel(name, parameters, tuple(lines), int(function.size1_out(0)))


def _build(kind: KernelKind, name: str, n_axes: int) -> tuple[ca.Function, tuple[str, ...]]:
    """Return what a kernel computes as a function of its parameters."""
    axes, rates = AXES[:n_axes], RATES[:n_axes]
    names = (*axes, *rates, *MEMBER_VALUES)
    symbols = {key: ca.SX.sym(key) for key in names}
    zero = ca.SX(0.0)
    values = {key: symbols[key] if key in kind.values else zero for key in MEMBER_VALUES}
    member = Member(
        [symbols[axis] for axis in axes], [symbols[rate] for rate in rates], values, kind.tension_only
    )
    result = ca.cse(ca.vertcat(*_results(kind, member)))
    parameters = tuple(key for key in names if ca.depends_on(result, symbols[key]))
    return ca.Function(name, [symbols[key] for key in parameters], [ca.densify(result)]), parameters


def _results(kind: KernelKind, member: Member) -> list[Scalar]:
    if kind.result in KERNELS and kind.result != "density":
        return KERNELS[kind.result](member)
    if kind.result != "density":
        block = BLOCKS[kind.result](member).entries
        return [block[r][c] for r in range(len(block)) for c in range(r, len(block))]
    return [member.static_density if kind.is_static else member.density]
