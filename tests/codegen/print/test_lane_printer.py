"""Every operation over lanes, bit for bit that of CasADi's virtual machine, for every width of registers."""

import ctypes
import functools
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, FlagSet
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.lane_printer import BLOCK, COMPARISONS, NUMBERS, print_lanes
from tensegrity_codegen.codegen.print.operations import OPERATIONS
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.precision import PRECISIONS
from tests.cases import thorough
from tests.codegen.print.test_printer import NAMES, PRINTED, evaluate, operand_pairs, operation_function

pytestmark = pytest.mark.optimised

WIDTH = 8

# Registers -> options of the compiler, and what the CPU must have.
REGISTERS = {
    "none": (("-DTENSEGRITY_NO_LANES",), ()),
    "128 bit": ((), ()),
    "256 bit": (("-mavx",), ("avx",)),
    "512 bit": (("-mavx512f", "-mavx512dq"), ("avx512f", "avx512dq")),
    "512 bit, by estimate": (("-mavx512f", "-mavx512dq", "-DTENSEGRITY_NATIVE"), ("avx512f", "avx512dq")),
}


def common(width: int) -> str:
    """Return what all functions over lanes stand on."""
    batch = {"width": width, "has_avx512": width % 8 == 0}
    context = {"batch": batch, "real": "double", "suffix": "", "NAME": "LANES"}
    return f"#include <math.h>\n#include <stddef.h>\n{render('batch_common.c', context)}"


def define(function: ca.Function, name: str, arguments: Sequence[str], width: int) -> str:
    """Return a C function of rows of arguments, one a lane, to rows of results."""
    lines = "\n  ".join(print_lanes(function, arguments, "result").lines)
    sizes = [function.nnz_in(k) for k in range(len(arguments))]
    lanes = ", ".join(f"const double *{argument}" for argument in arguments)
    text = f"static void {name}_lanes({lanes}, int stride, int in_lanes, double *result)\n{{\n"
    text += "  wide probe = wide_all(0.0);\n  wide_mask odd = wide_less(probe, probe);\n  "
    text += f"{lines}\n  (void)probe;\n  (void)odd;\n"
    text += "".join(f"  (void){argument};\n" for argument in arguments)
    text += f"}}\nvoid {name}({lanes}, double *result);\nvoid {name}({lanes}, double *result)\n{{\n  int i;\n"
    text += f"  double filled[{max(sizes)} * WIDE];\n"
    text += "".join(
        f"  double {argument}_lanes[{size} * WIDE];\n"
        for argument, size in zip(arguments, sizes, strict=True)
    )
    text += f"  for (i = 0; i < {width}; i += WIDE) {{\n"
    for argument, size in zip(arguments, sizes, strict=True):
        rows = f"{argument} + i * {size}, {size}, {size}, {width} - i, filled, {argument}_lanes"
        text += f"    load_lanes({rows});\n"
    passed = ", ".join(f"{argument}_lanes" for argument in arguments)
    return text + f"    {name}_lanes({passed}, WIDE, 0, result + i * {function.nnz_out(0)});\n  }}\n}}\n"


def load(text: str, folder: Path, registers: str) -> ctypes.CDLL:
    options, needed = REGISTERS[registers]
    if not set(needed) <= cpu_flags():
        pytest.skip(f"this CPU has no registers of {registers}")
    flags = FlagSet("lanes", (*FLAG_SETS["reference"].options, *options))
    artifact = compile_library({"lanes.c": text}, name="lanes", compiler=find_compiler(), flags=flags)
    path = folder / artifact.file_name
    path.write_bytes(artifact.library)
    return ctypes.CDLL(str(path))


@functools.cache
def cpu_flags() -> frozenset[str]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return frozenset()
    return frozenset(next((line for line in lines if line.startswith("flags")), "").split())


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@functools.cache
def expected_of(operation: int) -> np.ndarray:
    pairs = operand_pairs()
    return evaluate(operation, pairs[: len(pairs) // WIDTH * WIDTH])


OTHERS = thorough(*(name for name in REGISTERS if "estimate" not in name and name != "128 bit"))


@pytest.fixture(scope="module", params=["128 bit", *OTHERS])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """One library with one function over lanes an operation."""
    functions = [(operation, operation_function(operation)) for operation in PRINTED]
    text = common(WIDTH) + "".join(define(f, f"op_{k}", ("a", "b"), WIDTH) for k, f in functions)
    return load(text, Path(tmp_path_factory.mktemp("lanes")), request.param)


@pytest.mark.parametrize("operation", PRINTED, ids=lambda number: NAMES[number][3:].lower())
def test_each_operation_in_lanes_is_that_of_the_virtual_machine(
    compiled: ctypes.CDLL, operation: int
) -> None:
    expected, run = expected_of(operation), compiled[f"op_{operation}"]
    result = np.zeros(len(expected))
    for first in range(0, len(expected), WIDTH):
        a, b = np.ascontiguousarray(operand_pairs()[first : first + WIDTH].T)
        run(pointer(a), pointer(b), pointer(result[first:]))
    np.testing.assert_array_equal(result, expected)
    if operation not in (ca.OP_FMIN, ca.OP_FMAX):  # C leaves open which of +0 and -0 is the smaller
        known = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(result[known]), np.signbit(expected[known]))


def chain() -> ca.Function:
    """Square roots of square roots, quotients by them, calls between, comparisons that are reckoned with."""
    x = ca.SX.sym("x", 6)
    first = ca.sqrt(x * x + 1)
    angle = ca.sin(x / first) + ca.exp(-ca.sqrt(first))
    second = ca.sqrt(angle * angle + first)
    larger = x < angle
    chosen = ca.if_else(ca.logic_or(larger, ca.logic_not(second < 1.2)), x, 3 * larger - angle)
    rows = (1 / second, ca.sum1(x / first) * angle, second, ca.cumsum(x) * 3, 7.5, chosen)
    return ca.Function("chain", [x], [ca.vertcat(*rows)])


@pytest.mark.thorough
@pytest.mark.parametrize("registers", REGISTERS)
@pytest.mark.parametrize("width", [2, 8, 16])
def test_whole_functions_have_the_bits_of_the_virtual_machine(
    registers: str, width: int, tmp_path: Path
) -> None:
    function = chain()
    library = load(common(width) + define(function, "chain", ("x",), width), tmp_path, registers)
    x = np.random.default_rng(3).normal(size=(width, 6))
    result = np.zeros((width, function.numel_out(0)))
    library.chain(pointer(x), pointer(result))
    expected = np.array([np.array(function(row)).ravel() for row in x])
    np.testing.assert_array_equal(result, expected)


def test_comparisons_choose_without_being_numbers_first() -> None:
    x = ca.SX.sym("x", 2)
    chosen = ca.Function("f", [x], [ca.if_else(x[0] < x[1], x[0] * 2, 0)])
    text = "\n".join(print_lanes(chosen, ("x",), "r").lines)
    assert "const wide_mask" in text
    assert text.count("wide_if(m") == 1
    reckoned = ca.Function("f", [x], [(x[0] < x[1]) * x[0]])
    assert "wide_all(1.0)" in "\n".join(print_lanes(reckoned, ("x",), "r").lines)


@pytest.mark.parametrize("size", [1, 7, 8, 9, 24])
def test_results_are_handed_out_in_blocks_each_once(size: int) -> None:
    x = ca.SX.sym("x", size)
    lines = print_lanes(ca.Function("f", [x], [x * x]), ("x",), "r").lines
    blocks = [line for line in lines if line.startswith("put_results(")]
    places = [[int(word) for word in line.split(", ")[1:4]] for line in blocks]
    assert sorted(first for first, _, _ in places) == list(range(0, size, BLOCK))
    assert {whole for _, whole, _ in places} == {size}
    assert sum(count for _, _, count in places) == size


def test_every_operation_has_a_form() -> None:
    x = ca.SX.sym("x")
    assert set(OPERATIONS) > NUMBERS.keys() | COMPARISONS.keys()
    for operation in PRINTED:
        assert print_lanes(operation_function(operation), ("a", "b"), "r").lines
    assert print_lanes(ca.Function("f", [x], [x]), ("x",), "r").reads == {0}


def test_an_operation_without_c_form_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(FormulationError, match="has no C form"):
        print_lanes(ca.Function("f", [x], [ca.erfinv(x)]), ("x",), "r")


def test_single_precision_has_its_own_literals_and_functions() -> None:
    text = "\n".join(print_lanes(chain(), ("x",), "r", PRECISIONS["single"]).lines)
    assert "sinf(" in text
    assert "1.0f" in text
    assert "double" not in text


def test_instructions_name_what_they_take_up() -> None:
    x = ca.SX.sym("x", 2)
    instructions = read_instructions(ca.Function("f", [x], [(x[0] + 2) * x[1]]))
    (product,) = [item for item in instructions if item.operation == ca.OP_MUL]
    operands = [instructions[k] for k in product.operands]
    assert {item.operation for item in operands} == {ca.OP_ADD, ca.OP_INPUT}
    assert [item.place for item in instructions if item.operation == ca.OP_INPUT] == [(0, 0), (0, 1)]
    assert sum(item.is_operation for item in instructions) == 2
