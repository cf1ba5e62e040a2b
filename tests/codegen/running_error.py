"""What rounding can do to an expression: a bound that runs along with the evaluation (Higham 2002, 3.3)."""

import math
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.emitter import PrunedFunction

# Operation -> its value for operands a, b, and what errors ea, eb of these become, to first order.
RULES: dict[int, Callable[..., tuple[float, float]]] = {
    ca.OP_ADD: lambda a, b, ea, eb: (a + b, ea + eb),
    ca.OP_SUB: lambda a, b, ea, eb: (a - b, ea + eb),
    ca.OP_MUL: lambda a, b, ea, eb: (a * b, abs(a) * eb + abs(b) * ea),
    ca.OP_DIV: lambda a, b, ea, eb: (a / b, (ea + abs(a / b) * eb) / abs(b)),
    ca.OP_NEG: lambda a, b, ea, eb: (-a, ea),
    ca.OP_TWICE: lambda a, b, ea, eb: (2 * a, 2 * ea),
    ca.OP_SQ: lambda a, b, ea, eb: (a * a, 2 * abs(a) * ea),
    ca.OP_INV: lambda a, b, ea, eb: (1 / a, ea / a**2),
    ca.OP_SQRT: lambda a, b, ea, eb: (math.sqrt(a), ea / (2 * math.sqrt(a)) if a else 0.0),
    ca.OP_FABS: lambda a, b, ea, eb: (abs(a), ea),
    ca.OP_FMIN: lambda a, b, ea, eb: (min(a, b), max(ea, eb)),
    ca.OP_FMAX: lambda a, b, ea, eb: (max(a, b), max(ea, eb)),
    ca.OP_IF_ELSE_ZERO: lambda a, b, ea, eb: (b, eb) if a else (0.0, 0.0),
    ca.OP_CONSTPOW: lambda a, b, ea, eb: (a**b, abs(b * a ** (b - 1)) * ea),
    ca.OP_SIN: lambda a, b, ea, eb: (math.sin(a), abs(math.cos(a)) * ea),
    ca.OP_COS: lambda a, b, ea, eb: (math.cos(a), abs(math.sin(a)) * ea),
    ca.OP_LT: lambda a, b, ea, eb: (float(a < b), 0.0),
    ca.OP_LE: lambda a, b, ea, eb: (float(a <= b), 0.0),
    ca.OP_EQ: lambda a, b, ea, eb: (float(a == b), 0.0),
    ca.OP_NE: lambda a, b, ea, eb: (float(a != b), 0.0),
    ca.OP_AND: lambda a, b, ea, eb: (float(bool(a) and bool(b)), 0.0),
    ca.OP_OR: lambda a, b, ea, eb: (float(bool(a) or bool(b)), 0.0),
    ca.OP_NOT: lambda a, b, ea, eb: (float(not a), 0.0),
}


def evaluate_with_bound(
    function: PrunedFunction, arguments: Mapping[str, np.ndarray], rounding: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the entries of a quantity in double precision, and how far off they are in another one.

    rounding: largest relative error of one operation. Conditions are taken to come out the same.
    """
    code = function.function
    inputs = [np.ravel(arguments[name]).astype(float) for name in function.arguments]
    memory: dict[int, tuple[float, float]] = {}
    found = np.zeros((code.nnz_out(0), 2))
    for k in range(code.n_instructions()):
        operation, read, written = (
            code.instruction_id(k),
            code.instruction_input(k),
            code.instruction_output(k),
        )
        if operation == ca.OP_INPUT:
            memory[written[0]] = (float(inputs[read[0]][read[1]]), 0.0)
        elif operation == ca.OP_CONST:
            constant = float(code.instruction_constant(k))
            memory[written[0]] = (constant, rounding * abs(constant))
        elif operation == ca.OP_OUTPUT:
            found[written[1]] = memory[read[0]]
        else:
            (a, ea), (b, eb) = memory[read[0]], memory[read[-1]]
            value, error = RULES[operation](a, b, ea, eb)
            memory[written[0]] = (value, error + rounding * abs(value))
    return found[:, 0], found[:, 1]
