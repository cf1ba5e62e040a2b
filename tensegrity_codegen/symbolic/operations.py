"""The number of operations of a function."""

import casadi as ca


def count_operations(function: ca.Function) -> int:
    """Return the number of floating-point operations in one evaluation of an SX function."""
    codes = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    count = function.n_instructions()
    return sum(function.instruction_id(k) not in codes for k in range(count))
