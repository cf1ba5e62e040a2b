"""Every operation as C, compared bit for bit with CasADi's virtual machine."""

from __future__ import annotations

import ctypes
import itertools
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compile import compile_library
from tensegrity_codegen.codegen.flags import FLAG_SETS
from tensegrity_codegen.codegen.printer import BINARY, OPERATIONS, print_body, print_number
from tensegrity_codegen.codegen.toolchain import find_compiler
from tensegrity_codegen.errors import FormulationError

NAMES = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, 5e-324, 1e308, -1e308, np.inf, -np.inf, np.nan)
# An assignment never stays in an SX function: CasADi hands the operand on.
PRINTED = sorted(set(OPERATIONS) - {ca.OP_ASSIGN})


def operation_function(operation: int) -> ca.Function:
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    if operation == ca.OP_ASSIGN:
        result = a
    elif operation == ca.OP_CONSTPOW:
        result = ca.SX.binary(operation, a, 2.5)
    elif operation in BINARY:
        result = ca.SX.binary(operation, a, b)
    else:
        result = ca.SX.unary(operation, a)
    return ca.Function("f", [a, b], [result])


def instructions(function: ca.Function) -> set[int]:
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def operand_pairs() -> np.ndarray:
    rng = np.random.default_rng(7)
    scattered = rng.normal(size=(300, 2)) * 10.0 ** rng.integers(-8, 8, (300, 2))
    unit = rng.uniform(-1, 1, (100, 2))
    return np.vstack([list(itertools.product(SPECIAL, SPECIAL)), scattered, unit])


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """One library with one C function an operation, printed by the code under test."""
    text = "#include <math.h>\n"
    for operation in PRINTED:
        body = print_body(operation_function(operation), ("a", "b"), ("r",))
        signature = f"void op_{operation}(const double *a, const double *b, double *r)"
        used = "".join(f"  (void){name};\n" for name in "ab")
        text += f"{signature};\n{signature}\n{{\n{used}  " + "\n  ".join(body.lines) + "\n}\n"
    artifact = compile_library(
        {"operations.c": text}, name="operations", compiler=find_compiler(), flags=FLAG_SETS["reference"]
    )
    path = Path(tmp_path_factory.mktemp("printer")) / artifact.file_name
    path.write_bytes(artifact.library)
    return ctypes.CDLL(str(path))


@pytest.mark.parametrize("operation", PRINTED, ids=lambda number: NAMES[number][3:].lower())
def test_each_operation_is_that_of_the_virtual_machine(compiled: ctypes.CDLL, operation: int) -> None:
    function = operation_function(operation)
    assert operation in instructions(function)
    run = compiled[f"op_{operation}"]
    result = ctypes.c_double()
    for a, b in operand_pairs():
        run(ctypes.byref(ctypes.c_double(a)), ctypes.byref(ctypes.c_double(b)), ctypes.byref(result))
        expected = float(function(a, b))
        if operation in (ca.OP_FMIN, ca.OP_FMAX) and expected == 0.0:
            # Which of +0 and -0 is the smaller is left open by C.
            assert result.value == 0.0, (a, b)
        else:
            assert bits(result.value) == bits(expected), (a, b, result.value, expected)


def bits(value: float) -> str:
    """All bits of a number; every NaN is the same."""
    return "nan" if np.isnan(value) else value.hex()


def test_an_assignment_leaves_no_instruction() -> None:
    assert ca.OP_ASSIGN not in instructions(operation_function(ca.OP_ASSIGN))


def test_every_binary_operation_is_a_known_one() -> None:
    assert set(OPERATIONS) >= BINARY


def test_an_operation_without_c_form_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(FormulationError, match="has no C form"):
        print_body(ca.Function("f", [x], [ca.erfinv(x)]), ("x",), ("r",))


def test_a_body_says_what_it_reads() -> None:
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b")
    body = print_body(ca.Function("f", [a, b], [3 * a[1]]), ("a", "b"), ("r",))
    assert "a[1]" in body.lines[0]
    assert "3.0" in body.lines[0]
    assert body.lines[-1].startswith("r[0] = ")


def test_a_negative_constant_is_set_apart() -> None:
    a = ca.SX.sym("a")
    body = print_body(ca.Function("f", [a], [a - ca.SX(-2.5)]), ("a",), ("r",))
    assert "--" not in "".join(body.lines)


@given(st.floats(allow_nan=False, allow_infinity=False))
@example(-0.0)
@example(5e-324)
@example(2.2250738585072014e-308)
@example(1.7976931348623157e308)
@example(1e16)
@example(1e22)
@settings(max_examples=300)
def test_a_number_reads_back_to_the_last_bit(value: float) -> None:
    text = print_number(value)
    assert float(text).hex() == value.hex()
    assert any(mark in text for mark in ".e"), "would be an integer in C"


@pytest.mark.parametrize(
    ("value", "text"), [(np.nan, "NAN"), (np.inf, "INFINITY"), (-np.inf, "-INFINITY"), (3.0, "3.0")]
)
def test_special_numbers_have_their_names(value: float, text: str) -> None:
    assert print_number(value) == text


def test_numbers_read_back_by_the_c_compiler(tmp_path: Path) -> None:
    values = [0.1, -0.0, 5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 1e22, 1 / 3]
    listed = ", ".join(print_number(value) for value in values)
    text = f"extern const double v[{len(values)}];\nconst double v[{len(values)}] = {{{listed}}};\n"
    artifact = compile_library(
        {"numbers.c": text}, name="numbers", compiler=find_compiler(), flags=FLAG_SETS["reference"]
    )
    path = tmp_path / artifact.file_name
    path.write_bytes(artifact.library)
    found = (ctypes.c_double * len(values)).in_dll(ctypes.CDLL(str(path)), "v")
    assert [value.hex() for value in found] == [value.hex() for value in values]
