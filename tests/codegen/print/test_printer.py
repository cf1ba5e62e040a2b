"""Every operation as C, compared bit for bit with CasADi's virtual machine."""

import ctypes
import functools
import itertools
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.operations import BINARY, OPERATIONS
from tensegrity_codegen.codegen.print.printer import print_body, print_number, print_numbers
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.precision import PRECISIONS, Precision
from tests.cases import draws
from tests.codegen.compilers import EACH_FAMILY, require_compiler

pytestmark = pytest.mark.optimised

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


@functools.cache
def operand_pairs() -> np.ndarray:
    rng = np.random.default_rng(7)
    scattered = rng.normal(size=(300, 2)) * 10.0 ** rng.integers(-8, 8, (300, 2))
    unit = rng.uniform(-1, 1, (100, 2))
    return np.vstack([list(itertools.product(SPECIAL, SPECIAL)), scattered, unit])


def evaluate(operation: int, pairs: np.ndarray) -> np.ndarray:
    """Return the result of the virtual machine for each pair of operands."""
    return np.array(operation_function(operation)(*pairs.astype(float).T[:, None])).ravel()


@functools.cache
def compile_operations(family: str, precision: str, flags: str) -> ctypes.CDLL:
    """One library with one C function an operation, printed by the code under test."""
    compiler, kind = require_compiler(family), PRECISIONS[precision]
    text = "#include <math.h>\n"
    for operation in PRINTED:
        body = print_body(operation_function(operation), ("a", "b"), ("r",), kind)
        signature = f"void op_{operation}(const {kind.c_type} *a, const {kind.c_type} *b, {kind.c_type} *r)"
        used = "".join(f"  (void){name};\n" for name in "ab")
        text += f"{signature};\n{signature}\n{{\n{used}  " + "\n  ".join(body.lines) + "\n}\n"
    artifact = compile_library(
        {"operations.c": text}, name="operations", compiler=compiler, flags=FLAG_SETS[flags]
    )
    assert "warning" not in artifact.log
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / artifact.file_name
        path.write_bytes(artifact.library)
        return ctypes.CDLL(str(path))


with_each_operation = pytest.mark.parametrize(
    "operation", PRINTED, ids=lambda number: NAMES[number][3:].lower()
)
with_each_compiler = pytest.mark.parametrize("family", EACH_FAMILY)


def is_signless_zero(operation: int, value: float) -> bool:
    """Whether a zero may have either sign: which of +0 and -0 is the smaller is left open by C."""
    return operation in (ca.OP_FMIN, ca.OP_FMAX) and value == 0.0


@with_each_operation
@with_each_compiler
def test_each_operation_is_that_of_the_virtual_machine(family: str, operation: int) -> None:
    function = operation_function(operation)
    assert operation in instructions(function)
    run = compile_operations(family, "double", "reference")[f"op_{operation}"]
    result = ctypes.c_double()
    for (a, b), expected in zip(operand_pairs(), evaluate(operation, operand_pairs()), strict=True):
        run(ctypes.byref(ctypes.c_double(a)), ctypes.byref(ctypes.c_double(b)), ctypes.byref(result))
        if is_signless_zero(operation, expected):
            assert result.value == 0.0, (a, b)
        else:
            assert bits(result.value) == bits(expected), (a, b, result.value, expected)


# Functions of <math.h> that are right within a bound only; all others are exact or rounded once.
APPROXIMATE = {
    *(ca.OP_EXP, ca.OP_LOG, ca.OP_LOG1P, ca.OP_EXPM1, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_HYPOT, ca.OP_ERF),
    *(ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_ATAN2),
    *(ca.OP_SINH, ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH, ca.OP_ACOSH, ca.OP_ATANH),
}


@with_each_operation
@with_each_compiler
def test_each_operation_in_single_precision_is_rounded_to_float32(family: str, operation: int) -> None:
    """The exact result, which double precision is near enough to, rounded as NumPy rounds."""
    run = compile_operations(family, "single", "reference")[f"op_{operation}"]
    result, most = ctypes.c_float(), 3.0 if operation in APPROXIMATE else 0.0
    with np.errstate(all="ignore"):
        pairs = operand_pairs().astype(np.float32)
        for (a, b), exact in zip(pairs, evaluate(operation, pairs), strict=True):
            run(ctypes.byref(ctypes.c_float(a)), ctypes.byref(ctypes.c_float(b)), ctypes.byref(result))
            expected, found = np.float32(exact), np.float32(result.value)
            same = bits(float(found)) == bits(float(expected)) or is_signless_zero(operation, float(found))
            units = abs(float(found) - float(expected)) / float(np.spacing(np.abs(expected)))
            assert same or units <= most, (a, b, found, expected)


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
@draws(100)
def test_a_number_reads_back_to_the_last_bit(value: float) -> None:
    text = print_number(value)
    assert float(text).hex() == value.hex()
    assert any(mark in text for mark in ".e"), "would be an integer in C"


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
@example(1e-45)
@example(3.4028234663852886e38)
@example(16777216.0)
@draws(100)
def test_a_single_number_reads_back_to_the_last_bit(value: float) -> None:
    text = print_number(value, PRECISIONS["single"])
    assert text.endswith("f")
    assert np.float32(text[:-1]) == np.float32(value)
    assert any(mark in text for mark in ".e"), "would be an integer in C"


def test_a_number_is_rounded_to_the_nearest_float() -> None:
    assert print_number(0.1, PRECISIONS["single"]) == "0.1f"
    assert print_number(1 + 2.0**-30, PRECISIONS["single"]) == "1.0f"
    assert print_number(1e-60, PRECISIONS["single"]) == "0.0f"
    assert print_number(-np.inf, PRECISIONS["single"]) == "-INFINITY"


def test_a_number_beyond_float_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="too large for single precision") as caught:
        print_number(-3.5e38, PRECISIONS["single"], "mass")
    assert (caught.value.where, caught.value.given) == ("mass", -3.5e38)
    assert print_number(-3.5e38) == "-3.5e+38"


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


@pytest.mark.parametrize("precision", PRECISIONS.values(), ids=PRECISIONS)
def test_many_numbers_are_printed_as_each_alone(precision: Precision) -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=500) * 10.0 ** rng.integers(-37, 37, 500)
    values[:6] = (0.0, -0.0, 1.0, 1e16, -3.0, 123456789.0)
    assert print_numbers(values, precision) == [print_number(value, precision) for value in values]
    assert print_numbers(values.reshape(50, 10).tolist(), precision) == print_numbers(values, precision)
    values[7:10] = (np.inf, -np.inf, np.nan)
    assert print_numbers(values, precision)[7:10] == ["INFINITY", "-INFINITY", "NAN"]
    assert print_numbers((), precision) == []
