"""Force densities and stiffness blocks of members as C over packs: the same operations, one lane a member."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from tensegrity_codegen.codegen.printer import print_number
from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.symbolic.member import Member
from tensegrity_codegen.symbolic.member_blocks import MemberBlocks

__all__ = ["BLOCKS", "DensityKernel", "KernelKind", "build_kernel"]

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


# Symmetric blocks by quantity: their upper triangles are results of a kernel, row by row.
BLOCKS: dict[str, Callable[[Member], MemberBlocks]] = {
    "material_stiffness": lambda m: m.static_blocks()[0],
    "geometric_stiffness": lambda m: m.static_blocks()[1],
    "tangent_stiffness": lambda m: m.static_blocks()[0].plus(m.static_blocks()[1]),
}


@dataclass(frozen=True)
class KernelKind:
    """Which values a law takes, and who pulls only: all members of a pack, none, or (`is_mixed`) some.

    values: those of VALUES that are not zero for all members; result: "density", or a name of BLOCKS.
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
    names = (*AXES, *RATES, *VALUES)
    symbols = {key: ca.SX.sym(key) for key in names}
    zero = ca.SX(0.0)
    values = {key: symbols[key] if key in kind.values else zero for key in VALUES}
    member = Member(
        [symbols[axis] for axis in AXES], [symbols[rate] for rate in RATES], values, kind.tension_only
    )
    result = ca.cse(ca.vertcat(*_results(kind, member)))
    parameters = tuple(key for key in names if ca.depends_on(result, symbols[key]))
    function = ca.Function(name, [symbols[key] for key in parameters], [ca.densify(result)])
    lines = _print_pack(function, parameters, MIXED if kind.is_mixed else PACK_OPERATIONS)
    stores = 0 if kind.result == "density" else int(result.numel())
    return DensityKernel(name, (*parameters, "two_sided") if kind.is_mixed else parameters, lines, stores)


def _results(kind: KernelKind, member: Member) -> list[Scalar]:
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
