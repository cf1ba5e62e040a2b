"""Every operation that an SX function can hold as a C expression, with brackets where C needs them.

Each operation has a form and a precedence. Operands of lower precedence stand in brackets, so that the
compiler sees the tree of operations that CasADi has: no result changes by writing a tree in one line.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.precision import Precision

# How tightly a C expression holds together, loosest first.
CONDITIONAL, COMPARISON, SUM, PRODUCT, SIGNED, PRIMARY = range(6)

# Arithmetic that compilers have for vectors of any width. a and b are vectors; one is a vector of ones.
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


@dataclass(frozen=True)
class Text:
    """A C expression: its text, how tightly it holds together, how many operations it has.

    truth: of a comparison that is handed out as 1 or 0, the comparison itself.
    """

    text: str
    precedence: int = PRIMARY
    operations: int = 0
    truth: str = ""

    def within(self, precedence: int) -> str:
        """Return the text as an operand that has to hold together at least this tightly."""
        return self.text if self.precedence >= precedence else f"({self.text})"


# Operations that C has functions for, by the name that both share; of one and of two operands.
UNARY_FUNCTIONS = (
    *("sqrt", "exp", "log", "log1p", "expm1", "erf", "fabs", "floor", "ceil"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
BINARY_FUNCTIONS = ("pow", "hypot", "atan2", "fmod", "remainder", "fmin", "fmax", "copysign")

# Operands a and b; f: suffix of literals and functions of the precision. CasADi's meaning of NaN is kept.
OPERATIONS: dict[int, str] = ARITHMETIC | {
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}{{f}}({{a}})" for name in UNARY_FUNCTIONS},
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}{{f}}({{a}}, {{b}})" for name in BINARY_FUNCTIONS},
    ca.OP_CONSTPOW: "pow{f}({a}, {b})",
    ca.OP_ASSIGN: "{a}",
    ca.OP_TWICE: "2.0{f} * {a}",
    ca.OP_INV: "1.0{f} / {a}",
    ca.OP_SIGN: "({a} < 0.0{f}) ? -1.0{f} : (({a} > 0.0{f}) ? 1.0{f} : {a})",
    ca.OP_LT: "{a} < {b}",
    ca.OP_LE: "{a} <= {b}",
    ca.OP_EQ: "{a} == {b}",
    ca.OP_NE: "{a} != {b}",
    ca.OP_AND: "{a} && {b}",
    ca.OP_OR: "{a} || {b}",
    ca.OP_NOT: "!({a})",
    ca.OP_IF_ELSE_ZERO: "({a}) ? {b} : 0.0{f}",
}

BINARY = {operation for operation, text in OPERATIONS.items() if "{b}" in text}

# Comparisons of numbers, and combinations of comparisons: their results are 1 or 0.
COMPARISONS = frozenset({ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE})
COMBINED = frozenset({ca.OP_AND, ca.OP_OR, ca.OP_NOT})

# Precedence of the result, and those that its operands need.
PRECEDENCES: dict[int, tuple[int, int, int]] = {
    ca.OP_ASSIGN: (PRIMARY, PRIMARY, PRIMARY),
    ca.OP_ADD: (SUM, SUM, PRODUCT),
    ca.OP_SUB: (SUM, SUM, PRODUCT),
    ca.OP_MUL: (PRODUCT, PRODUCT, PRIMARY),
    ca.OP_DIV: (PRODUCT, PRODUCT, PRIMARY),
    ca.OP_NEG: (SIGNED, PRIMARY, PRIMARY),
    ca.OP_TWICE: (PRODUCT, PRIMARY, PRIMARY),
    ca.OP_SQ: (PRODUCT, PRIMARY, PRIMARY),
    ca.OP_INV: (PRODUCT, PRIMARY, PRIMARY),
    ca.OP_SIGN: (CONDITIONAL, PRIMARY, PRIMARY),
    ca.OP_IF_ELSE_ZERO: (CONDITIONAL, CONDITIONAL, SUM),
}
FUNCTION = (PRIMARY, CONDITIONAL, CONDITIONAL)


def count_reads(operation: int) -> int:
    """Return how many times the C form of a unary operation reads its operand."""
    return OPERATIONS[operation].count("{a}") if operation in OPERATIONS else 1


def print_operation(operation: int, operands: Sequence[str], precision: Precision) -> str:
    """Return the C expression of one CasADi operation; raises FormulationError for one without a C form."""
    return print_text(operation, [Text(operand) for operand in operands], precision).text


def print_text(operation: int, operands: Sequence[Text], precision: Precision) -> Text:
    """Return the C expression of one CasADi operation; raises FormulationError for one without a C form."""
    if operation not in OPERATIONS:
        raise FormulationError(f"CasADi operation {operation} has no C form", where="codegen.printer")
    a, b, f = operands[0], operands[-1], precision.suffix
    count = 1 + a.operations + (b.operations if operation in BINARY else 0)
    if operation in COMPARISONS or operation in COMBINED:
        truth = _truth(operation, a, b, f)
        return Text(f"({truth}) ? 1.0{f} : 0.0{f}", CONDITIONAL, count, truth)
    precedence, left_precedence, right = PRECEDENCES.get(operation, FUNCTION)
    left_text = as_truth(a, f) if operation == ca.OP_IF_ELSE_ZERO else a.within(left_precedence)
    second = b.within(right)
    if precedence in (SUM, PRODUCT) and second.startswith("-"):
        second = f"({second})"
    return Text(OPERATIONS[operation].format(a=left_text, b=second, f=f), precedence, count)


def _truth(operation: int, a: Text, b: Text, f: str) -> str:
    if operation in COMPARISONS:
        return OPERATIONS[operation].format(a=a.within(SUM), b=b.within(SUM))
    left_truth, second = as_truth(a, f), as_truth(b, f)
    if operation != ca.OP_NOT:
        left_truth, second = (
            f"({text})" if "&&" in text or "||" in text else text for text in (left_truth, second)
        )
    return OPERATIONS[operation].format(a=left_truth, b=second)


def as_truth(value: Text, f: str) -> str:
    """Return a number as a condition: whether it is not zero; f: suffix of literals."""
    return value.truth or f"{value.within(SUM)} != 0.0{f}"
