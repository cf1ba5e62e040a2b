"""Arithmetic that C compilers have for vectors of any width, as CasADi's virtual machine does it."""

import casadi as ca

# Operands a and b are vectors; one is a vector of ones.
ARITHMETIC: dict[int, str] = {
    ca.OP_ADD: "{a} + {b}",
    ca.OP_SUB: "{a} - {b}",
    ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}",
    ca.OP_NEG: "-{a}",
    ca.OP_TWICE: "{a} + {a}",
    ca.OP_SQ: "{a} * {a}",
    ca.OP_INV: "{one} / {a}",
}
