"""Every operation over lanes, compared bit for bit with CasADi's virtual machine; how blocks are cut."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen import lane_printer
from tensegrity_codegen.codegen.compile import compile_library
from tensegrity_codegen.codegen.flags import FLAG_SETS
from tensegrity_codegen.codegen.instructions import read_instructions
from tensegrity_codegen.codegen.lane_printer import SCALAR_CALLS, PrintedLanes, print_lanes
from tensegrity_codegen.codegen.toolchain import find_compiler
from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.precision import PRECISIONS
from tests.codegen.test_printer import NAMES, PRINTED, operand_pairs, operation_function

WIDTH = 4
HEAD = """#include <math.h>
#define TENSEGRITY_OVER(a, root, inverse) ((a) / (root))
"""


def define(name: str, lanes: PrintedLanes, arguments: Sequence[str], result: str, width: int) -> str:
    """Return a C function of the blocks, with square roots taken one by one."""
    signature = ", ".join([*(f"const double *{name}" for name in arguments), f"double *{result}"])
    text = f"void {name}({signature});\nvoid {name}({signature})\n{{\n  int k;\n"
    text += f"  double spare[{max(1, lanes.n_spare) * width}], root[{max(1, lanes.n_roots) * width}];\n"
    text += "  (void)spare;\n  (void)root;\n" + "".join(f"  (void){name};\n" for name in arguments)
    for block in lanes.blocks:
        body = "\n    ".join(block.lines)
        text += f"  for (k = 0; k < {width}; ++k) {{\n    {body}\n  }}\n"
        first, last = block.first_root * width, (block.first_root + block.n_roots) * width
        text += f"  for (k = {first}; k < {last}; ++k) {{ root[k] = sqrt(root[k]); }}\n"
    return text + "}\n"


def load(text: str, folder: Path) -> ctypes.CDLL:
    artifact = compile_library(
        {"lanes.c": HEAD + text}, name="lanes", compiler=find_compiler(), flags=FLAG_SETS["reference"]
    )
    path = folder / artifact.file_name
    path.write_bytes(artifact.library)
    return ctypes.CDLL(str(path))


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """One library with one function over lanes an operation."""
    text = ""
    for operation in PRINTED:
        lanes = print_lanes(operation_function(operation), ("a", "b"), ("r",), WIDTH)
        text += define(f"op_{operation}", lanes, ("a", "b"), "r", WIDTH)
    return load(text, Path(tmp_path_factory.mktemp("lanes")))


@pytest.mark.parametrize("operation", PRINTED, ids=lambda number: NAMES[number][3:].lower())
def test_each_operation_in_lanes_is_that_of_the_virtual_machine(
    compiled: ctypes.CDLL, operation: int
) -> None:
    function, run = operation_function(operation), compiled[f"op_{operation}"]
    pairs = operand_pairs()
    for group in pairs[: len(pairs) // WIDTH * WIDTH].reshape(-1, WIDTH, 2):
        a, b, result = np.ascontiguousarray(group[:, 0]), np.ascontiguousarray(group[:, 1]), np.zeros(WIDTH)
        run(pointer(a), pointer(b), pointer(result))
        expected = np.array([float(function(x, y)) for x, y in group])
        np.testing.assert_array_equal(result, expected)
        if operation not in (ca.OP_FMIN, ca.OP_FMAX):  # C leaves open which of +0 and -0 is the smaller
            known = ~np.isnan(expected)
            np.testing.assert_array_equal(np.signbit(result[known]), np.signbit(expected[known]))


# --- blocks ----------------------------------------------------------------------------------------


def chain() -> ca.Function:
    """Square roots of square roots, quotients by them, calls between: every kind of border."""
    x = ca.SX.sym("x", 6)
    first = ca.sqrt(x * x + 1)
    angle = ca.sin(x / first) + ca.exp(-ca.sqrt(first))
    second = ca.sqrt(angle * angle + first)
    return ca.Function(
        "chain", [x], [ca.vertcat(1 / second, ca.sum1(x / first) * angle, second, ca.cumsum(x) * 3, 7.5)]
    )


@pytest.mark.parametrize("most", [1, 2, 5, 1000])
@pytest.mark.parametrize("width", [2, 8])
def test_blocks_of_any_length_give_the_same_bits(
    most: int, width: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane_printer, "BLOCK_STATEMENTS", most)
    function = chain()
    lanes = print_lanes(function, ("x",), ("r",), width)
    library = load(define("chain", lanes, ("x",), "r", width), tmp_path)
    x = np.random.default_rng(3).normal(size=(6, width))
    result = np.zeros((function.numel_out(0), width))
    library.chain(pointer(x), pointer(result))
    expected = np.array([np.array(function(x[:, k])).ravel() for k in range(width)]).T
    np.testing.assert_array_equal(result, expected)


def test_roots_are_due_before_they_are_read_and_once() -> None:
    lanes = print_lanes(chain(), ("x",), ("r",), 8)
    taken = [k for block in lanes.blocks for k in range(block.first_root, block.first_root + block.n_roots)]
    assert taken == list(range(lanes.n_roots))
    assert lanes.n_roots == 18
    done = 0
    for block in lanes.blocks:
        for line in block.lines:
            if "= root[" in line or "TENSEGRITY_OVER" in line:
                place = int(line.split("root[")[1].split(" ")[0]) // 8
                assert place < done, line
        done += block.n_roots


def test_functions_without_vectors_stand_in_loops_of_their_own() -> None:
    lanes = print_lanes(chain(), ("x",), ("r",), 8)
    for block in lanes.blocks:
        calls = [line for line in block.lines if "sin(" in line or "exp(" in line]
        if calls:
            others = [line for line in block.lines if line not in calls and "spare[" not in line]
            assert not others


def test_slots_are_used_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lane_printer, "BLOCK_STATEMENTS", 1)
    x = ca.SX.sym("x")
    value = x
    for _ in range(50):
        value = value * x + 1
    lanes = print_lanes(ca.Function("f", [x], [value]), ("x",), ("r",), 8)
    assert len(lanes.blocks) == 101
    assert lanes.n_spare == 2


def test_every_scalar_call_is_an_operation_that_is_printed() -> None:
    assert set(PRINTED) > SCALAR_CALLS


def test_an_operation_without_c_form_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(FormulationError, match="has no C form"):
        print_lanes(ca.Function("f", [x], [ca.erfinv(x)]), ("x",), ("r",), 8)


def test_single_precision_has_its_own_literals_and_functions() -> None:
    lanes = print_lanes(chain(), ("x",), ("r",), 8, PRECISIONS["single"])
    text = "\n".join(line for block in lanes.blocks for line in block.lines)
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
