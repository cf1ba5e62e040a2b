"""Generated expressions evaluated in another floating-point type, operation by operation.

The same operations in the same order as the generated C, each rounded to the type: what C code with another
`double` would compute.
"""

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.codegen.prune import PrunedFunction
from tensegrity_codegen.system.errors import FormulationError

OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_SQ: np.square,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.abs,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LT: lambda a, b: type(a)(a < b),
    ca.OP_LE: lambda a, b: type(a)(a <= b),
    ca.OP_AND: lambda a, b: type(a)(bool(a) and bool(b)),
    ca.OP_OR: lambda a, b: type(a)(bool(a) or bool(b)),
    ca.OP_NOT: lambda a: type(a)(not a),
    ca.OP_IF_ELSE_ZERO: lambda a, b: b if a else type(b)(0),
}


def evaluate_in(
    number: type[np.floating[Any]], function: PrunedFunction, arguments: Mapping[str, ArrayLike]
) -> NDArray[Any]:
    """Return the entries of a quantity, column by column, computed in the type `number`.

    number: np.float32, np.float64 or np.longdouble; arguments: name -> values, in the shape of the argument.
    Divisions by zero give infinities and NaN. Raises FormulationError for an operation that it does not know.
    """
    code = function.function
    inputs = [np.ravel(np.asarray(arguments[name], dtype=number)) for name in function.arguments]
    memory: dict[int, Any] = {}
    result = np.zeros(code.nnz_out(0), dtype=number)
    with np.errstate(all="ignore"):
        for k in range(code.n_instructions()):
            operation, read, written = (
                code.instruction_id(k),
                code.instruction_input(k),
                code.instruction_output(k),
            )
            if operation == ca.OP_INPUT:
                memory[written[0]] = inputs[read[0]][read[1]]
            elif operation == ca.OP_OUTPUT:
                result[written[1]] = memory[read[0]]
            elif operation == ca.OP_CONST:
                memory[written[0]] = number(code.instruction_constant(k))
            else:
                memory[written[0]] = _operation(operation)(*[memory[place] for place in read])
    return result


def _operation(code: int) -> Callable[..., Any]:
    if code not in OPERATIONS:
        raise FormulationError(
            "an operation of the expression has no meaning in other precisions yet",
            where="precision",
            given=code,
            allowed="sums, products, quotients, roots and comparisons",
        )
    return OPERATIONS[code]
