"""Trees of operations in one C expression: brackets exactly where C would else see another tree."""

import ctypes
import itertools
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.operations import OPERATIONS, Text, print_text
from tensegrity_codegen.codegen.print.printer import Annotations, print_body
from tensegrity_codegen.tables.precision import PRECISIONS

DOUBLE = PRECISIONS["double"]
A, B, C = Text("a"), Text("b"), Text("c")


def tree(outer: int, inner: int, side: int) -> str:
    operands = [print_text(inner, [A, B], DOUBLE), C]
    return print_text(outer, operands if side == 0 else operands[::-1], DOUBLE).text


@pytest.mark.parametrize(
    ("outer", "inner", "side", "expected"),
    [
        (ca.OP_ADD, ca.OP_ADD, 0, "a + b + c"),
        (ca.OP_ADD, ca.OP_ADD, 1, "c + (a + b)"),
        (ca.OP_SUB, ca.OP_ADD, 1, "c - (a + b)"),
        (ca.OP_SUB, ca.OP_MUL, 1, "c - a * b"),
        (ca.OP_MUL, ca.OP_SUB, 0, "(a - b) * c"),
        (ca.OP_MUL, ca.OP_MUL, 1, "c * (a * b)"),
        (ca.OP_DIV, ca.OP_DIV, 0, "a / b / c"),
        (ca.OP_DIV, ca.OP_MUL, 1, "c / (a * b)"),
        (ca.OP_SUB, ca.OP_NEG, 1, "c - (-a)"),
        (ca.OP_NEG, ca.OP_NEG, 0, "-(-a)"),
        (ca.OP_NEG, ca.OP_MUL, 0, "-(a * b)"),
        (ca.OP_SQRT, ca.OP_ADD, 0, "sqrt(a + b)"),
        (ca.OP_IF_ELSE_ZERO, ca.OP_LT, 0, "(a < b) ? c : 0.0"),
        (ca.OP_IF_ELSE_ZERO, ca.OP_ADD, 0, "(a + b != 0.0) ? c : 0.0"),
        (ca.OP_ADD, ca.OP_LT, 0, "((a < b) ? 1.0 : 0.0) + c"),
        (ca.OP_AND, ca.OP_OR, 1, "(c != 0.0 && (a != 0.0 || b != 0.0)) ? 1.0 : 0.0"),
        (ca.OP_NOT, ca.OP_LE, 0, "(!(a <= b)) ? 1.0 : 0.0"),
    ],
)
def test_brackets_stand_where_they_matter(outer: int, inner: int, side: int, expected: str) -> None:
    assert tree(outer, inner, side) == expected


def random_function(rng: np.random.Generator, n_operations: int) -> ca.Function:
    """A function of mixed operations, of which many are read once."""
    known = [operation for operation in OPERATIONS if operation not in (ca.OP_ASSIGN, ca.OP_CONSTPOW)]
    exact = [
        *(ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_TWICE, ca.OP_SQ, ca.OP_INV),
        *(ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_NOT, ca.OP_IF_ELSE_ZERO),
        *(ca.OP_SQRT, ca.OP_FABS, ca.OP_SIGN),
    ]
    assert set(exact) <= set(known)
    x = ca.SX.sym("x", 4)
    values = [x[k] for k in range(4)] + [ca.SX(-1.5), ca.SX(0.25)]
    for _ in range(n_operations):
        operation = int(rng.choice(exact))
        first, second = (values[-1 - int(rng.integers(0, min(6, len(values))))] for _ in range(2))
        if "{b}" in OPERATIONS[operation]:
            values.append(ca.SX.binary(operation, first, second))
        else:
            values.append(ca.SX.unary(operation, first))
    return ca.Function("f", [x], [ca.vertcat(*values[-3:])])


def test_nested_expressions_are_the_virtual_machine_to_the_last_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    functions = [random_function(rng, n) for n in itertools.chain(*[(3, 8, 20, 60)] * 4)]
    text = "#include <math.h>\n"
    for number, function in enumerate(functions):
        lines = "\n  ".join(print_body(function, ("x",), ("r",)).lines)
        text += f"void f{number}(const double *x, double *r);\nvoid f{number}(const double *x, double *r)\n"
        text += f"{{\n  (void)x;\n  {lines}\n}}\n"
    artifact = compile_library(
        {"f.c": text}, name="f", compiler=find_compiler(), flags=FLAG_SETS["reference"]
    )
    path = tmp_path / artifact.file_name
    path.write_bytes(artifact.library)
    library = ctypes.CDLL(str(path))
    points = np.vstack([rng.normal(size=(20, 4)), rng.integers(-1, 2, (20, 4)).astype(float)])
    for number, function in enumerate(functions):
        for point in points:
            found, expected = np.empty(3), np.array(function(point)).ravel()
            library[f"f{number}"](ctypes.c_void_p(point.ctypes.data), ctypes.c_void_p(found.ctypes.data))
            np.testing.assert_array_equal(found, expected, err_msg=f"{function.str(True)}\n{point}")


def test_a_value_that_is_read_once_stands_where_it_is_read() -> None:
    x = ca.SX.sym("x", 3)
    once = ca.Function("f", [x], [ca.sqrt(x[0] * x[1] + x[2])])
    assert print_body(once, ("x",), ("r",)).lines == ("r[0] = sqrt(x[0] * x[1] + x[2]);",)
    product = x[0] * x[1]
    twice = ca.Function("f", [x], [ca.vertcat(product + x[2], product - x[2])])
    first, *rest = print_body(twice, ("x",), ("r",)).lines
    assert first.startswith("const double t")
    assert len(rest) == 2


def test_names_and_comments_stand_beside_their_values() -> None:
    x = ca.SX.sym("x", 2)
    length = ca.sqrt(x[0] * x[1])
    function = ca.Function("f", [x], [ca.vertcat(length + 1, length - 1)])
    plain = print_body(function, ("x",), ("r",)).lines
    (number,) = {int(line[len("const double t") :].split()[0]) for line in plain if line.startswith("const")}
    notes = Annotations({number: "length_a"}, {number: "a: m to n"}, {0: "first"})
    assert print_body(function, ("x",), ("r",), annotations=notes).lines == (
        "/* a: m to n */",
        "const double length_a = sqrt(x[0] * x[1]);",
        "r[0] = length_a + 1.0; /* first */",
        "r[1] = length_a - 1.0;",
    )
