"""CasADi SX functions as plain C: one constant a operation, in CasADi's own order.

The order and the operations are those of CasADi's virtual machine, so that without contraction of
multiply-adds (`-ffp-contract=off`) the results are the same to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from tensegrity_codegen.errors import FormulationError

__all__ = ["PrintedBody", "print_body", "print_number"]

Printer = Callable[..., str]


def _infix(symbol: str) -> Printer:
    return lambda a, b: f"{a} {symbol} {b}"


def _call(name: str) -> Printer:
    return lambda *operands: f"{name}({', '.join(operands)})"


def _truth(symbol: str) -> Printer:
    return lambda a, b: f"({a} {symbol} {b}) ? 1.0 : 0.0"


# Every operation that an SX function can hold, with CasADi's meaning of NaN kept.
OPERATIONS: dict[int, Printer] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _infix("+"),
    ca.OP_SUB: _infix("-"),
    ca.OP_MUL: _infix("*"),
    ca.OP_DIV: _infix("/"),
    ca.OP_NEG: lambda a: f"-{a}",
    ca.OP_TWICE: lambda a: f"2.0 * {a}",
    ca.OP_SQ: lambda a: f"{a} * {a}",
    ca.OP_INV: lambda a: f"1.0 / {a}",
    ca.OP_SQRT: _call("sqrt"),
    ca.OP_EXP: _call("exp"),
    ca.OP_LOG: _call("log"),
    ca.OP_LOG1P: _call("log1p"),
    ca.OP_EXPM1: _call("expm1"),
    ca.OP_POW: _call("pow"),
    ca.OP_CONSTPOW: _call("pow"),
    ca.OP_HYPOT: _call("hypot"),
    ca.OP_SIN: _call("sin"),
    ca.OP_COS: _call("cos"),
    ca.OP_TAN: _call("tan"),
    ca.OP_ASIN: _call("asin"),
    ca.OP_ACOS: _call("acos"),
    ca.OP_ATAN: _call("atan"),
    ca.OP_ATAN2: _call("atan2"),
    ca.OP_SINH: _call("sinh"),
    ca.OP_COSH: _call("cosh"),
    ca.OP_TANH: _call("tanh"),
    ca.OP_ASINH: _call("asinh"),
    ca.OP_ACOSH: _call("acosh"),
    ca.OP_ATANH: _call("atanh"),
    ca.OP_ERF: _call("erf"),
    ca.OP_FABS: _call("fabs"),
    ca.OP_FLOOR: _call("floor"),
    ca.OP_CEIL: _call("ceil"),
    ca.OP_FMOD: _call("fmod"),
    ca.OP_REMAINDER: _call("remainder"),
    ca.OP_FMIN: _call("fmin"),
    ca.OP_FMAX: _call("fmax"),
    ca.OP_COPYSIGN: _call("copysign"),
    ca.OP_SIGN: lambda a: f"({a} < 0.0) ? -1.0 : (({a} > 0.0) ? 1.0 : {a})",
    ca.OP_LT: _truth("<"),
    ca.OP_LE: _truth("<="),
    ca.OP_EQ: _truth("=="),
    ca.OP_NE: _truth("!="),
    ca.OP_AND: lambda a, b: f"({a} != 0.0 && {b} != 0.0) ? 1.0 : 0.0",
    ca.OP_OR: lambda a, b: f"({a} != 0.0 || {b} != 0.0) ? 1.0 : 0.0",
    ca.OP_NOT: lambda a: f"({a} == 0.0) ? 1.0 : 0.0",
    ca.OP_IF_ELSE_ZERO: lambda a, b: f"({a} != 0.0) ? {b} : 0.0",
}


@dataclass(frozen=True)
class PrintedBody:
    """Statements of one function body, and which inputs they read."""

    lines: tuple[str, ...]
    reads: frozenset[int]


def print_number(value: float) -> str:
    """Return `value` as a C double that reads back bit-equal."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else text + ".0"


def print_body(function: ca.Function, inputs: Sequence[str], outputs: Sequence[str]) -> PrintedBody:
    """Return the C statements that evaluate an SX function.

    function: the SX function; inputs, outputs: names of its C arrays of doubles, of non-zeros in CasADi's
    column order. Raises FormulationError for an operation that has no C form here.
    """
    lines: list[str] = []
    work: dict[int, str] = {}
    reads: set[int] = set()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_CONST:
            number = print_number(function.instruction_constant(k))
            work[target[0]] = f"({number})" if number.startswith("-") else number
        elif operation == ca.OP_INPUT:
            reads.add(source[0])
            work[target[0]] = f"{inputs[source[0]]}[{source[1]}]"
        elif operation == ca.OP_OUTPUT:
            lines.append(f"{outputs[target[0]]}[{target[1]}] = {work[source[0]]};")
        else:
            lines.append(f"const double t{k} = {_expression(operation, [work[s] for s in source])};")
            work[target[0]] = f"t{k}"
    return PrintedBody(tuple(lines), frozenset(reads))


def _expression(operation: int, operands: list[str]) -> str:
    printer = OPERATIONS.get(operation)
    if printer is None:
        raise FormulationError(f"CasADi operation {operation} has no C form", where="codegen.printer")
    # Unary operations list their operand once or twice, depending on CasADi's instruction.
    return printer(*operands[: _arity(operation)])


def _arity(operation: int) -> int:
    return 2 if operation in BINARY else 1


BINARY = {
    ca.OP_ADD,
    ca.OP_SUB,
    ca.OP_MUL,
    ca.OP_DIV,
    ca.OP_POW,
    ca.OP_CONSTPOW,
    ca.OP_HYPOT,
    ca.OP_ATAN2,
    ca.OP_FMOD,
    ca.OP_REMAINDER,
    ca.OP_FMIN,
    ca.OP_FMAX,
    ca.OP_COPYSIGN,
    ca.OP_LT,
    ca.OP_LE,
    ca.OP_EQ,
    ca.OP_NE,
    ca.OP_AND,
    ca.OP_OR,
    ca.OP_IF_ELSE_ZERO,
}
