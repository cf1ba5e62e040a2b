"""Functions that advance copies, as an embedder compiles them: strict, with sanitizers, with bad numbers."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.integrators.integrators import copies_context
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, check_sanitized, run_program, write_files
from tests.codegen.subjects import bare, everything
from tests.free_body_cases import make_random
from tests.ground_cases import make_block
from tests.ring_cases import make_swing
from tests.scene.samples import build

DRIVER = """\
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "{name}.h"
enum {{ COPIES = 21, S = {n_states}, BAD = 4, HUGE_ONE = 10 }};
static double state[COPIES][S], wanted[COPIES][S], step[COPIES], work[{PREFIX}_COPIES_WORK];
{arrays}
static long long count[COPIES];
static int status[COPIES];
static {name}_copies copies;
static int run(int is_bad)
{{
  int k, i, worst = 0;
  for (k = 0; k < COPIES; ++k) {{
    for (i = 0; i < S; ++i) {{
      state[k][i] = 0.0;
    }}
    memcpy(state[k], {name}_nominal_coordinate, sizeof {name}_nominal_coordinate);
    memcpy(state[k] + {n}, {name}_nominal_velocity, sizeof {name}_nominal_velocity);
    step[k] = 0.0;
    count[k] = 0;
    status[k] = 0;
{fill}
  }}
  if (is_bad) {{
    state[BAD][0] = NAN;
    state[HUGE_ONE][{n}] = 1e200;
  }}
  for (i = 0; i < 3; ++i) {{
    worst |= {symbol}_copies(&copies, 0, 8, work);
    worst |= {symbol}_copies(&copies, 8, COPIES, work);
  }}
  return worst;
}}
int main(void)
{{
  int k;
  copies.sample = 0.003;
  copies.rtol = 1e-5;
  copies.atol = 1e-6;
  copies.fixed_step = 0.001;
  copies.most_steps = 10000;
{watch}
  copies.state = state[0];
  copies.step = step;
  copies.count = count;
  copies.status = status;
{bind}
  if (run(0) != 0) {{
    puts("refused");
  }}
  memcpy(wanted, state, sizeof state);
  if (run(1) != 0 || {symbol}_copies(NULL, 0, 1, work) == 0 || {symbol}_copies(&copies, 2, 1, work) == 0) {{
    puts("refused, or not");
  }}
  for (k = 0; k < COPIES; ++k) {{
    const int is_same = memcmp(state[k], wanted[k], sizeof state[k]) == 0;
    if (k != BAD && k != HUGE_ONE && (!is_same || status[k] != 0 || count[k] != 3)) {{
      printf("copy %d: %d\\n", k, status[k]);
    }}
  }}
  if (status[BAD] != {NAME}_NON_FINITE_INPUT || state[BAD][1] == state[BAD][1]) {{
    puts("no status");
  }}
  puts("done");
  return 0;
}}
"""


def bodies() -> tuple[Structure, ModelRequest]:
    structure = build(make_random(3))[0]
    return structure, ModelRequest(("member_tension",), formulation="rigid_bar")


def write(subject: Callable[[], tuple[Structure, ModelRequest]], method: str, folder: Path) -> Manifest:
    """Write a library of copies, in lanes where it has them, and a program that advances some."""
    structure, request = subject()
    names = dict.fromkeys(("acceleration", "member_tension", "total_energy", *request.quantities))
    width = 0 if structure.is_rigid.any() else 4
    request = replace(
        request, quantities=tuple(names), integrators=(method,), copies=True, events=AUTO_EVENTS,
        batch_width=width, solvers=(), interfaces=(),
    )  # fmt: skip
    source = emit(structure, request)
    manifest = source.manifest
    own = {argument.name: len(argument.nominal) for argument in manifest.arguments if argument.nominal}
    own = {name: size for name, size in own.items() if f"*{name};" in read_struct(source.files, manifest)}
    spec = manifest.integrators[0]
    values = {"name": manifest.name, "NAME": manifest.name.upper()}
    driver = DRIVER.format(
        **values,
        n=len(manifest.coordinate_name),
        n_states=2 * len(manifest.coordinate_name) + manifest.n_internal,
        PREFIX=f"{manifest.name.upper()}_{spec.name.upper()}",
        symbol=spec.symbol,
        arrays="\n".join(
            [f"static double {name}[COPIES][{size}];" for name, size in own.items()]
            + [f"static double tension[COPIES][{len(manifest.member_name)}];"]
        ),
        fill="\n".join(
            f"    memcpy({name}[k], {manifest.name}_nominal_{name}, sizeof {name}[k]);" for name in own
        ),
        watch=f"  copies.watch = {manifest.name.upper()}_EVENT_CABLE;" if spec.events else "",
        bind="\n".join(f"  copies.{name} = {name}[0];" for name in own)
        + "\n  copies.member_tension = tension[0];",
    )
    write_files(folder, {**source.files, "driver.c": driver})
    return manifest


def read_struct(files: dict[str, str], manifest: Manifest) -> str:
    return files[f"{manifest.name}.h"].split(f"}} {manifest.name}_copies;")[0].rsplit("typedef struct", 1)[1]


@pytest.mark.parametrize("method", ["rk54", "rk4"])
@pytest.mark.parametrize("subject", [bare, *thorough(everything, bodies)])
def test_the_sanitizers_find_nothing_and_bad_copies_disturb_none(
    subject: Callable[[], tuple[Structure, ModelRequest]], method: str, tmp_path: Path
) -> None:
    manifest = write(subject, method, tmp_path)
    check_sanitized(tmp_path, "driver.c", f"{manifest.name}.c")
    found = run_program(tmp_path, "-std=c99", "-O1", *STRICT, "-Wunused", "driver.c", f"{manifest.name}.c")
    assert found == "done\n"


@pytest.mark.parametrize(
    ("structure", "called"),
    [
        (bare()[0], "_batch("),
        (make_swing(0.2), "_run("),
        (make_block([0.0, 0.0, 0.3], friction=0.0), "_batch("),
        (make_block([0.0, 0.0, 0.3], friction=0.5), "_batch("),
    ],
)
def test_lanes_are_for_forces_without_jumps(structure: Structure, called: str) -> None:
    """Their steps pass over the events at which others are cut."""
    quantities = ("acceleration", "member_tension")
    request = ModelRequest(quantities, integrators=("rk54",), copies=True, events=AUTO_EVENTS, batch_width=4)
    source = emit(structure, request)
    text = source.files[f"{source.manifest.name}.c"]
    body = text.partition("static void rk54_advance_copies(")[2].partition("\n}")[0]
    assert [word for word in ("_batch(", "_run(") if word in body] == [called]
    slipping = (*source.manifest.internal_name, "a_slips")  # as static friction has it, whose force jumps
    assert not replace(source.manifest, internal_name=slipping).has_only_bristles


def test_libraries_without_copies_have_nothing_of_them() -> None:
    structure, request = bare()
    source = emit(structure, replace(request, integrators=("rk54",)))
    assert not source.manifest.copies
    assert all("copies" not in text for text in source.files.values())
    assert copies_context(source.manifest, {}, ()) is None
