"""Blocks that run only under a condition: the same results to the last bit, and only where they save much."""

import ctypes
import re
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print import printer
from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.printer import find_guards, print_body
from tensegrity_codegen.tables.precision import PRECISIONS
from tests.cases import thorough

X = ca.SX.sym("x", 4)


def lengthen(value: Any, count: int) -> Any:
    """Return a value that takes 2 * count operations, of which each is read twice."""
    for _ in range(count):
        value = value + ca.sin(value * value)
    return value


def guarded(count: int) -> ca.Function:
    """Two results of one long part that only matters for x0 < x1, and a sum that always does."""
    condition, always = X[0] < X[1], X[2] + X[3]
    part = lengthen(always * X[2], count)
    chosen = [ca.if_else(condition, part, 0), ca.if_else(condition, part * part + always, 0)]
    return ca.Function("f", [X], [ca.vertcat(always, *chosen)])


def random_function(seed: int) -> ca.Function:
    """Conditions within each other, shared parts, and values of blocks within the next conditions."""
    rng = np.random.default_rng(seed)
    values = [X[k] for k in range(4)]
    conditions = [X[0] < X[1], X[1] < X[2], X[2] + X[3] < 1]
    for _ in range(80):
        a, b = (values[-1 - int(rng.integers(0, min(12, len(values))))] for _ in range(2))
        condition = conditions[rng.integers(len(conditions))]
        chosen = ca.if_else(condition, a * b, 0 if rng.random() < 0.6 else b)
        values.append([a + b, a - b * b, chosen, chosen, ca.fabs(a) + b, -a][rng.integers(6)])
        if rng.random() < 0.1:
            conditions.append(values[-1] < a)
    return ca.Function("f", [X], [ca.vertcat(*values[-3:])])


def compile_bodies(folder: Path, functions: list[ca.Function], precision: str = "double") -> ctypes.CDLL:
    """Return the library of all functions, f0 and so on; the compiler has nothing to say about it."""
    kind = PRECISIONS[precision]
    text = "#include <math.h>\n"
    for number, function in enumerate(functions):
        lines = "\n  ".join(print_body(function, ("x",), ("r",), kind).lines)
        head = f"void f{number}(const {kind.c_type} *x, {kind.c_type} *r)"
        text += f"{head};\n{head}\n{{\n  (void)x;\n  {lines}\n}}\n"
    made = compile_library({"f.c": text}, name="f", compiler=find_compiler(), flags=FLAG_SETS["reference"])
    assert "warning" not in made.log
    folder.mkdir()
    path = folder / made.file_name
    path.write_bytes(made.library)
    return ctypes.CDLL(str(path))


def evaluate(library: ctypes.CDLL, number: int, point: np.ndarray) -> bytes:
    """Return all bits of the three results; every NaN is the same."""
    found = np.empty(3, point.dtype)
    library[f"f{number}"](ctypes.c_void_p(point.ctypes.data), ctypes.c_void_p(found.ctypes.data))
    found[np.isnan(found)] = np.nan
    return found.tobytes()


def test_a_long_part_that_rarely_matters_stands_in_a_block() -> None:
    """What leaves the block is declared before it as zero; what stays is declared within."""
    lines = print_body(guarded(30), ("x",), ("r",)).lines
    start, end = lines.index(find_if(lines)), lines.index("}")
    before, within, behind = lines[:start], lines[start + 1 : end], lines[end + 1 :]
    declared = [line.split()[1] for line in before if line.endswith(" = 0.0;")]
    assert len(declared) == 2
    assert [line.split()[0] for line in within if not line.startswith("  const ")] == declared
    assert sum("sin(" in line for line in within) == 30
    assert not any("sin(" in line for line in (*before, *behind))
    assert behind[-2:] == (f"r[1] = {declared[0]};", f"r[2] = {declared[1]};")


def find_if(lines: tuple[str, ...]) -> str:
    """Return the line that begins the only block."""
    (found,) = [line for line in lines if re.fullmatch(r"if \(t\d+ != 0\.0\) \{", line)]
    return found


def test_short_parts_are_worked_out_always() -> None:
    instructions = read_instructions(guarded(5))
    assert find_guards(instructions) == {}
    assert not any("if (" in line for line in print_body(guarded(5), ("x",), ("r",)).lines)


def test_what_is_read_elsewhere_stands_in_no_block() -> None:
    part = lengthen(X[0], 30)
    chosen = ca.Function("f", [X], [ca.vertcat(ca.if_else(X[1] < X[2], part, 0), part)])
    assert find_guards(read_instructions(chosen)) == {}
    condition = ca.Function("f", [X], [ca.if_else(part < 2, part, 0)])
    assert find_guards(read_instructions(condition)) == {}


def test_blocks_do_not_stand_within_each_other() -> None:
    inner = ca.if_else(X[2] < X[3], lengthen(X[0] * X[1], 30), 0)
    outer = ca.Function("f", [X], [ca.if_else(X[0] < X[1], lengthen(inner, 30), 0)])
    instructions = read_instructions(outer)
    guards = find_guards(instructions)
    assert len(set(guards.values())) == 1
    assert len(guards) > 120
    assert sum(line.startswith("if (") for line in print_body(outer, ("x",), ("r",)).lines) == 1


@pytest.mark.parametrize(("precision", "first"), [("double", 0), ("single", 20), *thorough(("double", 40))])
def test_blocks_change_no_bit_of_a_result(
    precision: str, first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of functions where all that can stand in blocks does, beside the same ones without blocks."""
    monkeypatch.setattr(printer, "MIN_SAVED_OPERATIONS", 0)
    functions = [guarded(30), *(random_function(seed) for seed in range(first, first + 20))]
    kinds = [len(set(find_guards(read_instructions(item)).values())) for item in functions]
    assert sum(kinds) > len(functions)
    with_blocks = compile_bodies(tmp_path / "with", functions, precision)
    monkeypatch.setattr(printer, "find_guards", lambda instructions: {})
    without = compile_bodies(tmp_path / "without", functions, precision)
    rng = np.random.default_rng(1)
    seen = set()
    for number in range(len(functions)):
        for point in rng.normal(size=(60, 4)).astype(PRECISIONS[precision].dtype):
            found = evaluate(with_blocks, number, point)
            assert found == evaluate(without, number, point), (number, point)
            seen.add(found)
    assert len(seen) > 20 * len(functions)


def test_columns_have_no_blocks() -> None:
    """The loop over columns works in vectors, which cannot jump."""
    assert printer.print_columns(guarded(30), ("x",), (), "r").lines
    assert not any("if (" in line for line in printer.print_columns(guarded(30), ("x",), (), "r").lines)
