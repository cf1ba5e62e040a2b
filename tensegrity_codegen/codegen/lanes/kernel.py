"""Force densities and stiffness blocks of members as C over packs: the same operations, one lane a member."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.instructions import read_instructions
from tensegrity_codegen.codegen.printer import print_number
from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.precision import Precision
from tensegrity_codegen.symbolic.member import Member
from tensegrity_codegen.symbolic.member_blocks import MemberBlocks
from tensegrity_codegen.symbolic.member_kernel import KERNELS

__all__ = ["BLOCKS", "DensityKernel", "KernelKind", "build_kernel", "build_row_kernel"]

Scalar = Any

AXES = ("x", "y", "z")
RATES = ("x_rate", "y_rate", "z_rate")
VALUES = ("spring_constant", "axial_stiffness", "rest_length", "damping")

# Operations of CasADi's virtual machine over packs; what compares gives a mask. Bars and cables in one pack:
# a lane whose member holds both ways takes its value whatever the comparison says.
PACK_OPERATIONS: dict[int, str] = {
    ca.OP_ADD: "{a} + {b}",
    ca.OP_SUB: "{a} - {b}",
    ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}",
    ca.OP_NEG: "-{a}",
    ca.OP_TWICE: "{a} + {a}",
    ca.OP_SQ: "{a} * {a}",
    ca.OP_INV: "pack_all(1.0) / {a}",
    ca.OP_SQRT: "pack_sqrt({a})",
    ca.OP_LT: "pack_less({a}, {b})",
    ca.OP_AND: "pack_and({a}, {b})",
    ca.OP_IF_ELSE_ZERO: "pack_and({a}, {b})",
}
HOLDS = "pack_or({a}, pack_less(pack_all(0.0), two_sided))"
MIXED = PACK_OPERATIONS | {ca.OP_IF_ELSE_ZERO: f"pack_and({HOLDS}, {{b}})"}

# The same over rows of members that repeat each other; a comparison gives a mask of a type of its own.
ROW_OPERATIONS = PACK_OPERATIONS | {
    ca.OP_INV: "row_all({one}) / {a}",
    ca.OP_SQRT: "row_sqrt({a})",
    ca.OP_LT: "row_less({a}, {b})",
    ca.OP_AND: "row_both({a}, {b})",
    ca.OP_IF_ELSE_ZERO: "row_where({a}, {b})",
}
MASKS = (ca.OP_LT, ca.OP_AND)


# Symmetric blocks by quantity: their upper triangles are results of a kernel, row by row.
BLOCKS: dict[str, Callable[[Member], MemberBlocks]] = {
    "material_stiffness": lambda m: m.static_blocks()[0],
    "geometric_stiffness": lambda m: m.static_blocks()[1],
    "tangent_stiffness": lambda m: m.static_blocks()[0].plus(m.static_blocks()[1]),
}


@dataclass(frozen=True)
class KernelKind:
    """Which values a law takes, and who pulls only: all members of a pack, none, or (`is_mixed`) some.

    values: those of VALUES that are not zero for all members; result: "density", or a name of
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
    result = function.size1_out(0)
    lines = _print_pack(function, parameters, MIXED if kind.is_mixed else PACK_OPERATIONS)
    stores = 0 if kind.result == "density" else int(result)
    return DensityKernel(name, (*parameters, "two_sided") if kind.is_mixed else parameters, lines, stores)


@functools.cache
def build_row_kernel(kind: KernelKind, name: str, n_axes: int, precision: Precision) -> DensityKernel:
    """Return the kernel of a kind over rows, of members in so many axes; errors as of build_kernel."""
    function, parameters = _build(kind, name, n_axes)
    lines: list[str] = []
    work: list[str] = []
    for k, item in enumerate(read_instructions(function)):
        operands = [work[operand] for operand in item.operands]
        work.append(f"t{k}")
        if item.operation == ca.OP_CONST:
            work[k] = f"row_all({print_number(item.value, precision)})"
        elif item.operation == ca.OP_INPUT:
            work[k] = parameters[item.place[0]]
        elif item.operation == ca.OP_OUTPUT:
            lines.append(f"result[{item.place[1]}] = {operands[0]};")
        else:
            kind_of_row = "lanes_mask" if item.operation in MASKS else "lanes_row"
            lines.append(f"const {kind_of_row} t{k} = {_row_operation(item.operation, operands, precision)};")
    return DensityKernel(name, parameters, tuple(lines), int(function.size1_out(0)))


def _row_operation(operation: int, operands: list[str], precision: Precision) -> str:
    if operation not in ROW_OPERATIONS:
        raise FormulationError(f"CasADi operation {operation} has no form in lanes", where="codegen.lanes")
    one = f"1.0{precision.suffix}"
    form: str = ROW_OPERATIONS[operation]
    return form.format(a=operands[0], b=operands[-1], one=one)


def _build(kind: KernelKind, name: str, n_axes: int) -> tuple[ca.Function, tuple[str, ...]]:
    """Return what a kernel computes as a function of its parameters."""
    axes, rates = AXES[:n_axes], RATES[:n_axes]
    names = (*axes, *rates, *VALUES)
    symbols = {key: ca.SX.sym(key) for key in names}
    zero = ca.SX(0.0)
    values = {key: symbols[key] if key in kind.values else zero for key in VALUES}
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


def _print_pack(
    function: ca.Function, inputs: tuple[str, ...], operations: dict[int, str]
) -> tuple[str, ...]:
    lines: list[str] = []
    sizes: list[str] = []
    work: dict[int, str] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[target[0]] = f"pack_all({print_number(function.instruction_constant(k))})"
        elif operation == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]]
        elif operation == ca.OP_OUTPUT:
            stored = function.numel_out(0) > 1
            what = work[source[0]]
            lines.append(f"pack_store(block + {4 * target[1]}, {what});" if stored else f"return {what};")
            sizes.append(f"pack_size({what})")
        elif operation in operations:
            a, b = work[source[0]], work[source[-1]]
            lines.append(f"const lanes_pack t{k} = {operations[operation].format(a=a, b=b)};")
            work[target[0]] = f"t{k}"
        else:
            raise FormulationError(
                f"CasADi operation {operation} has no form in lanes", where="codegen.lanes"
            )
    if len(sizes) > 1:
        lines.append(f"return {' + '.join(sizes)};")
    return tuple(lines)
