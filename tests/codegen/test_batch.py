"""Batch functions in C: bit-equal to single evaluations, refusals by status, nothing outside the arrays."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen import unrolled
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import PRECISIONS
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, has_sanitizers, run_program, write_files
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.quickly import SANITIZE
from tests.codegen.subjects import bare, everything
from tests.runtime.build import bar, make_structure, prism

pytestmark = pytest.mark.optimised

CHECKED = (*FLAG_SETS["reference"].options, *STRICT)
COUNTS = (0, 1, 7, 8, 9, 17)

HEAD = """\
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "{name}.h"

static int worst = 0;

static void expect(int holds, const char *what, int n)
{{
  if (!holds) {{
    printf("%s, n = %d\\n", what, n);
    worst = 1;
  }}
}}

/* Rows of the nominal values, each a little different; as long as needed, for the sanitizers to see. */
static {real} *rows(const {real} *nominal, int size, int n)
{{
  {real} *values = ({real} *)malloc((size_t)(n * size + 1) * sizeof({real}));
  int k;
  values = ({real} *)realloc(values, (size_t)(n * size > 0 ? n * size : 1) * sizeof({real}));
  for (k = 0; k < n * size; ++k) {{
    values[k] = nominal[k % size] * (({real})1 + ({real})1e-4 * ({real})(k % 37));
  }}
  return values;
}}
"""

# One block a function: batch against single, then a NaN in the middle, then what is refused.
BLOCK = """
static void check_{quantity}(int n)
{{
  {rows}
  {real} *result = ({real} *)malloc((size_t)(n > 0 ? n : 1) * {size} * sizeof({real}));
  {real} one[{size}];
  int *status = (int *)malloc((size_t)(n > 0 ? n : 1) * sizeof(int));
  int k, answer = {symbol}_batch(n, {given}result, status);
  expect(answer == 0, "{quantity}: status", n);
  for (k = 0; k < n; ++k) {{
    expect({symbol}({element}one) == 0 && status[k] == 0, "{quantity}: status of an element", k);
    expect(memcmp(one, result + k * {size}, sizeof one) == 0, "{quantity}: bits", k);
  }}
  if (n > 4) {{
    {first}[{first_size} * 4 + {first_size} - 1] = NAN;
    answer = {symbol}_batch(n, {given}result, status);
    expect(answer == {NAME}_NON_FINITE_INPUT, "{quantity}: status of a bad batch", n);
    for (k = 0; k < n; ++k) {{
      expect(status[k] == {symbol}({element}one), "{quantity}: status beside a bad one", k);
      expect(k == 4 ? isnan(result[4 * {size}]) && isnan(result[5 * {size} - 1])
                    : memcmp(one, result + k * {size}, sizeof one) == 0,
             "{quantity}: bits beside a bad one", k);
    }}
    expect({symbol}_batch(n, {given}result, NULL) == answer, "{quantity}: without statuses", n);
    {shared}
  }}
  expect({symbol}_batch(-1, {given}result, status) == {NAME}_INVALID_ARGUMENT, "{quantity}: negative n", n);
  expect({symbol}_batch(n, {overlapping}result, status) == {overlap}, "{quantity}: overlap", n);
  expect({symbol}_batch(n, {given}NULL, status) == {NAME}_NULL_POINTER, "{quantity}: no result", n);
  expect({symbol}_batch(n, {missing}result, status) == {NAME}_NULL_POINTER, "{quantity}: no argument", n);
  {free}
  free(result);
  free(status);
}}
"""

SHARED = """answer = {symbol}_batch(n, {all_shared}result, status);
    expect(answer == 0, "{quantity}: shared status", n);
    for (k = 0; k < n; ++k) {{
      expect({symbol}({nominal}one) == 0, "{quantity}: single", k);
      expect(memcmp(one, result + k * {size}, sizeof one) == 0, "{quantity}: shared", k);
    }}"""


def check_function(manifest: Manifest, spec: FunctionSpec) -> str:
    sizes = {name: len(manifest.argument(name).nominal) for name in spec.arguments}
    first = spec.arguments[0]
    names = {
        "NAME": manifest.name.upper(),
        "quantity": spec.quantity,
        "symbol": spec.symbol,
        "real": PRECISIONS[manifest.precision].c_type,
        "size": len(spec.pattern.row) if spec.pattern else math.prod(spec.shape),
        "rows": "".join(
            f"{PRECISIONS[manifest.precision].c_type} *{a} = rows({manifest.name}_nominal_{a}, {n}, n);\n  "
            for a, n in sizes.items()
        ),
        "given": "".join(f"{a}, {n}, " for a, n in sizes.items()),
        "element": "".join(f"{a} + k * {n}, " for a, n in sizes.items()),
        "overlapping": "".join(f"{a}, {n - 1}, " for a, n in sizes.items()),
        "overlap": 0 if max(sizes.values()) == 1 else f"{manifest.name.upper()}_INVALID_ARGUMENT",
        "missing": "".join(f"NULL, {n}, " for n in sizes.values()),
        "nominal": "".join(f"{manifest.name}_nominal_{a}, " for a in sizes),
        "all_shared": "".join(f"{manifest.name}_nominal_{a}, 0, " for a in sizes),
        "first": first,
        "first_size": sizes[first],
        "free": "".join(f"free({a});\n  " for a in sizes),
    }
    return BLOCK.format(**names, shared=SHARED.format(**names))


def format_batch_driver(manifest: Manifest) -> str:
    """Return a C program that checks every batch function against the single one; 0 if all is well."""
    real = PRECISIONS[manifest.precision].c_type
    functions = [spec for spec in manifest.functions if spec.arguments]
    blocks = "".join(check_function(manifest, spec) for spec in functions)
    calls = "".join(f"  check_{spec.quantity}({n});\n" for spec in functions for n in COUNTS)
    main = f"\nint main(void)\n{{\n{calls}  return worst;\n}}\n"
    return HEAD.format(name=manifest.name, real=real) + blocks + main


def lane_request(request: ModelRequest, width: int, **changes: str) -> ModelRequest:
    plain = replace(request, integrators=(), solvers=())
    return replace(plain, batch_width=width, **changes)  # type: ignore[arg-type]


def run_driver(
    source: GeneratedSource, folder: Path, family: str = "gcc", options: tuple[str, ...] = CHECKED
) -> None:
    write_files(folder, {**source.files, "driver.c": format_batch_driver(source.manifest)})
    run_program(folder, *options, "driver.c", f"{source.manifest.name}.c", family=family)


@pytest.mark.thorough
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_a_batch_has_the_bits_of_single_evaluations(family: str, tmp_path: Path) -> None:
    structure, request = everything()
    source = emit(structure, lane_request(request, 8))
    run_driver(source, tmp_path, family)


@pytest.mark.thorough
@pytest.mark.parametrize("width", [2, 4, 16, 64])
@pytest.mark.parametrize("precision", ["double", "single"])
def test_every_width_and_precision_has_the_bits_of_single_evaluations(
    width: int, precision: str, tmp_path: Path
) -> None:
    structure, request = bare()
    wanted = request.wanting("member_tension", "acceleration", "tangent_stiffness", "total_energy")
    source = emit(structure, lane_request(wanted, width, precision=precision))
    run_driver(source, tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("flags", FLAG_SETS)
def test_the_sanitizers_find_nothing(flags: str, tmp_path: Path) -> None:
    compiler = require_compiler("gcc")
    if not has_sanitizers(compiler, tmp_path):
        pytest.skip("no sanitizers here")
    structure, request = bare()
    wanted = request.wanting("member_tension", "acceleration", "tangent_stiffness")
    source = emit(structure, replace(lane_request(wanted, 8), flags=flags))
    run_driver(source, tmp_path, "gcc", (*FLAG_SETS[flags].options, *SANITIZE))


@pytest.mark.thorough
def test_a_function_too_long_for_lanes_runs_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    structure, request = bare()
    shortest = min(spec.operations for spec in emit(structure, request).manifest.functions)
    monkeypatch.setattr(unrolled, "MAX_LANE_OPERATIONS", shortest)
    source = emit(structure, lane_request(request, 8))
    text = source.files["triangle.c"]
    assert "member_tension_wide" in text
    assert "acceleration_wide" not in text
    assert "one after the other" in source.files["triangle.h"]
    run_driver(source, tmp_path)


@pytest.mark.parametrize("name", ["MAX_LANE_STACK", *thorough("MAX_LANE_OPERATIONS")])
def test_without_any_lanes_nothing_of_them_is_left(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unrolled, name, 0)
    structure, request = bare()
    source = emit(structure, lane_request(request, 8))
    assert "lanes" not in source.files["triangle.c"]
    run_driver(source, tmp_path)


def test_a_function_of_nothing_fills_every_row(tmp_path: Path) -> None:
    held = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 0.9)], anchored={0: "xyz", 1: "xyz"})
    source = emit(held, ModelRequest(("member_tension",), batch_width=4))
    text = """#include "small.h"
int main(void)
{
  double tension[3] = {0.0, 0.0, 0.0}, one[1];
  int status[3] = {9, 9, 9};
  small_compute_member_tension(one);
  if (small_compute_member_tension_batch(3, tension, status) != 0) return 1;
  return !(tension[0] == one[0] && tension[2] == one[0] && status[0] == 0 && status[2] == 0 && one[0] != 0.0);
}
"""
    folder = write_files(tmp_path / "source", source.files | {"main.c": text})
    run_program(folder, "-std=c99", *STRICT, "main.c", "small.c")


@pytest.mark.thorough
def test_what_is_not_asked_for_is_not_there() -> None:
    structure, request = everything()
    assert request.batch_width == 0
    files = emit(structure, request).files
    assert "batch" not in files["braced.c"] + files["braced.h"]
    assert "TENSEGRITY_ALIGNED" not in files["braced.c"]


@pytest.mark.parametrize("width", [1, 3, 6, 12, 128, -8, True])
def test_other_widths_are_refused(width: int) -> None:
    with pytest.raises(InvalidValueError) as caught:
        ModelRequest(("member_tension",), batch_width=width)
    assert caught.value.where == "model.batch_width"
    assert caught.value.given == width
    assert "power of two from 2 to 64" in caught.value.allowed


def test_the_table_emitter_runs_one_by_one(tmp_path: Path) -> None:
    wanted = ModelRequest(("member_tension", "acceleration"), emitter="table", batch_width=8)
    source = emit(prism(150.0, anchored={0: "xyz"}), wanted)
    assert "one after the other" in source.files["small.h"]
    run_driver(source, tmp_path)
