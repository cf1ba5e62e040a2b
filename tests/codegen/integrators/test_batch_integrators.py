"""Integrations side by side in C: the bits of single ones, a status for each, strict compilers."""

import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.codegen.integrators.work_memory import count_batch_work
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import PRECISIONS
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import STRICT, has_sanitizers, require_cpp, run, run_program, write_files
from tests.codegen.compilers import OTHERS, require_compiler
from tests.codegen.quickly import SANITIZE
from tests.codegen.subjects import bare, everything, in_single_precision
from tests.runtime.build import prism

pytestmark = pytest.mark.optimised

INTEGRATORS = ("rk4", "rk54", "rk853")
WIDTH = 4
QUICK = tuple(option.replace("-O2", "-O1") for option in FLAG_SETS["reference"].options)

HEAD = """\
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "{name}.h"
typedef {real} real;
#ifdef WATCHED /* by valgrind, which knows what was never written */
#define KEPT
#define EMPTY(array) (void)0
#else
#define KEPT static
#define EMPTY(array) memset(array, 255, sizeof(array)) /* NAN */
#endif
enum {{ N = {n}, S = {n_states}, W = {width}, T = 4 }};
static const double at[T] = {{0.0, 1e-3, 3.7e-3, 1e-2}};
static int worst = 0;
static void expect(int holds, const char *what, int k)
{{
  if (!holds) {{
    printf("%s, %d\\n", what, k);
    worst = 1;
  }}
}}
static void start(real *state, int k)
{{
  int i;
  for (i = 0; i < N; ++i) {{
    state[i] = {name}_nominal_coordinate[i] * ((real)1 + (real)1e-3 * (real)(k * (i % 3)));
    state[N + i] = {name}_nominal_velocity[i] + (real)0.1 * (real)k;
  }}
}}
"""

# One integrator: lane 1 begins with a NaN, lane 2 where nodes coincide; the others must not notice.
CHECK = """
static void check_{method}(void)
{{
  KEPT real state[W * S], samples[W * T * S], one[S], own[T * S];
  KEPT real work[{NAME}_{METHOD}_BATCH_WORK + 3], spare[{work}];
  long long sampled[W], count[3 * W], done = 0, n = 0;
  double time[W], step[W];
  int status[W], k, i, round;
{rows}
  for (round = 0; round < 3; ++round) {{ /* whole; in short calls; with fewer states than lanes */
    const int width = round == 2 ? W - 1 : W, odd = round == 1 ? 3 : 0;
    int answer = 0, calls = 0;
    EMPTY(work); /* nothing may be read before it is written */
    memset(count, 0, sizeof count);
    for (k = 0; k < W; ++k) {{
      start(state + k * S, k);
      sampled[k] = 0;
      time[k] = step[k] = 0.0;
      status[k] = 0;
    }}
    state[S + 1] = NAN;
    for (i = 0; i < S; ++i) state[2 * S + i] = 0;
    do {{
      {batch}
    }} while (++calls < {calls});
    expect(answer == {NAME}_NON_FINITE_INPUT, "{method}: answer", answer);
    for (k = 0; k < width; ++k) {{
      if (k == 1 || k == 2) {{
        answer = k == 1 ? {NAME}_NON_FINITE_INPUT : {NAME}_NON_FINITE_RESULT;
        expect(status[k] == answer, "{method}: status", status[k]);
        continue;
      }}
      expect(status[k] == 0 && sampled[k] == T, "{method}: status of a good one", k);
      start(one, k);
      n = 0;
      {single}
      expect(n == T && memcmp(one, state + k * S, sizeof one) == 0, "{method}: bits of the state", k);
      expect(memcmp(own, samples + k * T * S, sizeof own) == 0, "{method}: bits of the samples", k);
    }}
    expect(width == W || (status[W - 1] == 0 && sampled[W - 1] == 0), "{method}: not there", width);
  }}
  for (k = 0; k < W; ++k) {{ sampled[k] = status[k] = 0; start(state + k * S, k); }}
{refusals}
  (void)done;
  (void)time;
  (void)step;
}}
"""

# Rows of an argument; what stands between them is no number.
ROWS = """\
  static real {argument}[W * {pitch}];
  for (i = 0; i < W * {pitch}; ++i) {{
    const real more = (real)1 + (real){share} * (real)(i / {pitch} % 2);
    {argument}[i] = i % {pitch} < {size} ? {name}_nominal_{argument}[i % {pitch}] * more : (real)NAN;
  }}"""


def driver(manifest: Manifest) -> str:
    """Return a C program that holds every batch integrator to the single one; 0 if all is well."""
    n = len(manifest.coordinate_name)
    real = PRECISIONS[manifest.precision].c_type
    head = HEAD.format(name=manifest.name, real=real, n=n, n_states=2 * n, width=WIDTH)
    checks = "".join(_check(manifest, spec) for spec in manifest.integrators)
    calls = "".join(f"  check_{spec.name}();\n" for spec in manifest.integrators)
    return f"{head}{checks}\nint main(void)\n{{\n{calls}  return worst;\n}}\n"


def _check(manifest: Manifest, spec: IntegratorSpec) -> str:
    """The arguments of odd lanes are a little larger; that of the last argument is shared."""
    name, rows, given, single = manifest.name, [], [], []
    for place, argument in enumerate(spec.arguments):
        size = len(manifest.argument(argument).nominal)
        shared = place == len(spec.arguments) - 1 and place > 0
        stride = 0 if shared else size + 1
        share = "0" if shared else "1e-3"
        rows.append(ROWS.format(argument=argument, name=name, size=size, pitch=size + 1, share=share))
        given += [argument, str(stride)]
        single.append(f"{argument} + k * {stride}")
    return CHECK.format(
        method=spec.name,
        METHOD=spec.name.upper(),
        NAME=name.upper(),
        work=spec.work_size,
        rows="\n".join(rows),
        batch=_batch_call(spec, given),
        calls="(round == 1 ? 400 : 1)",
        single=_single_call(spec, single, name),
        refusals="\n".join(_refusals(spec, given, name.upper())),
    )


def _batch_call(spec: IntegratorSpec, given: list[str], **changes: str) -> str:
    v = {"width": "width", "state": "state", "n": "T", "sampled": "sampled", "work": "work + odd"} | changes
    passed = "".join(f"{item}, " for item in given)
    tail = f"{v['n']}, at, samples, {v['sampled']}, "
    if spec.name == "rk4":
        steps = v.get("steps", "odd ? calls * 25 : 0, odd ? (calls < 4 ? 25 : 0) : 100")
        step = v.get("tolerance", "1e-4")
        head = f"0.0, {step}, {steps}, {v['state']}, "
    else:
        steps, tolerance = v.get("steps", "odd ? 3 : 10000"), v.get("tolerance", "1e-6")
        head = f"1e-2, {tolerance}, 1e-9, {steps}, time, step, {v['state']}, "
    return f"answer = {spec.symbol}_batch({v['width']}, {head}{passed}{tail}count, status, {v['work']});"


def _single_call(spec: IntegratorSpec, passed: list[str], name: str) -> str:
    given = "".join(f"{item}, " for item in passed)
    if spec.name == "rk4":
        return (
            f"expect({spec.symbol}(0.0, 1e-4, 0, 100, one, {given}T, at, own, &n, &done, spare) == 0, "
            f'"{spec.name}: single", k);'
        )
    call = f"{spec.symbol}_run(1e-2, 1e-6, 1e-9, 10000, &t, &h, one, {given}T, at, own, &n, &run, spare)"
    counts = "run.n_accepted == own_[0] && run.n_rejected == own_[1] && run.n_evaluations == own_[2]"
    return (
        f"{{ {name}_run run; const long long *own_ = count + 3 * k; double t = 0.0, h = 0.0; "
        f"memset(&run, 0, sizeof run); "
        f'expect({call} == 0, "{spec.name}: single", k); expect({counts}, "{spec.name}: counts", k); }}'
    )


def _refusals(spec: IntegratorSpec, given: list[str], name: str) -> list[str]:
    whole = {"steps": "0, 5" if spec.name == "rk4" else "5", "work": "work"}
    cases = [
        ({"width": "0"}, "INVALID_ARGUMENT"),
        ({"width": "W + 1"}, "INVALID_ARGUMENT"),
        ({"width": "W", "state": "NULL"}, "NULL_POINTER"),
        ({"width": "W", "work": "NULL"}, "NULL_POINTER"),
        ({"width": "W", "sampled": "NULL"}, "NULL_POINTER"),
        ({"width": "W", "tolerance": "-1.0"}, "INVALID_ARGUMENT"),
    ]
    calls = [(_batch_call(spec, given, **(whole | change)), word) for change, word in cases]
    if given:
        calls.append((_batch_call(spec, ["NULL", *given[1:]], **whole, width="W"), "NULL_POINTER"))
    if len(given) > 1 and given[1] not in ("0", "2"):
        calls.append((_batch_call(spec, [given[0], "1", *given[2:]], **whole, width="W"), "INVALID_ARGUMENT"))
    return [
        f'  {{ int answer; {call} expect(answer == {name}_{word}, "{spec.name}: refusal", {place}); }}'
        for place, (call, word) in enumerate(calls)
    ]


def in_batches(structure: Structure, request: ModelRequest, **changes: object) -> GeneratedSource:
    wanted = replace(request, quantities=("acceleration",), integrators=INTEGRATORS, events=())
    return emit(structure, replace(wanted, **{"batch_width": WIDTH} | changes))  # type: ignore[arg-type]


TABLED = prism(150.0, anchored={0: "xyz"}).with_changes(name="tabled")
RIGID = prism(150.0).with_changes(name="rigid")
PARAMETERS = {"rest_length": (1, 2), "node_load": (3,)}
SUBJECTS: dict[str, Callable[[], GeneratedSource]] = {
    "everything": lambda: in_batches(*everything()),
    "for this machine": lambda: in_batches(*everything(), flags="native"),
    "single": lambda: in_batches(*in_single_precision(everything)),
    "plane": lambda: in_batches(*bare()),
    "table": lambda: in_batches(TABLED, ModelRequest((), PARAMETERS), emitter="table"),
    "rigid bars": lambda: in_batches(
        RIGID, ModelRequest(()), formulation="rigid_bar", options={"bars": "all"}
    ),
}


def write(subject: str, folder: Path) -> str:
    """Write a library and its driver; returns its source file."""
    source = SUBJECTS[subject]()
    write_files(folder, {**source.files, "driver.c": driver(source.manifest)})
    return f"{source.manifest.name}.c"


@pytest.mark.thorough
@pytest.mark.parametrize("subject", ["everything", "single", "table", "rigid bars"])
def test_every_lane_has_the_bits_of_a_single_run(subject: str, tmp_path: Path) -> None:
    run_program(tmp_path, *QUICK, *STRICT, "driver.c", write(subject, tmp_path))


@pytest.mark.thorough
@pytest.mark.parametrize("family", OTHERS)
def test_other_compilers_take_it_too(family: str, tmp_path: Path) -> None:
    run_program(tmp_path, *QUICK, *STRICT, "driver.c", write("plane", tmp_path), family=family)


@pytest.mark.thorough
def test_it_is_cpp_without_a_warning(tmp_path: Path) -> None:
    native = FLAG_SETS["native"].options[1:]
    options = ("-std=c++11", "-x", "c++", *native, "-O0", *STRICT, "-c")
    run([*require_cpp("g++"), *options, write("for this machine", tmp_path), "-o", "x.o"], tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("subject", ["plane", "table"])
def test_the_sanitizers_find_nothing(subject: str, tmp_path: Path) -> None:
    if not has_sanitizers(require_compiler("gcc"), tmp_path):
        pytest.skip("no sanitizers here")
    options = ("-std=c99", "-ffp-contract=off", *SANITIZE)
    run_program(tmp_path, *options, "driver.c", write(subject, tmp_path))


@pytest.mark.thorough
@pytest.mark.parametrize("subject", ["plane", "table"])
def test_valgrind_finds_nothing(subject: str, tmp_path: Path) -> None:
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("valgrind is not installed")
    options = ("-std=c99", "-O1", "-ffp-contract=off", "-DWATCHED")
    run_program(tmp_path, *options, "driver.c", write(subject, tmp_path))
    run([valgrind, "-q", "--error-exitcode=9", "./program"], tmp_path)


def test_the_memory_fits_lanes_that_begin_anywhere() -> None:
    rates, dense, row_size = 7, 0, math.ceil(8 * 5 / 8) * 8
    size = count_batch_work("rk54", 5, 0, [3, 1], 8, PRECISIONS["double"])
    assert size == 8 + row_size + 8 * (1 + 10 * (5 + rates + dense) + 4)


def test_a_library_without_batches_has_none_of_it() -> None:
    source = in_batches(*everything(), batch_width=0)
    assert all(spec.batch_work_size == 0 for spec in source.manifest.integrators)
    assert "_batch" not in source.files[f"{source.manifest.name}.h"]
    assert "motion_batch" not in source.files[f"{source.manifest.name}.c"]
