"""Internal states in generated C and in its plain files: declared, counted, absent where there are none."""

import json
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.codegen.integrators.work_memory import count_bytes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import STRICT, require_cpp, run, run_program, write_files
from tests.codegen.compilers import require_compiler
from tests.codegen.plain_c.alone import compile_alone, options_for, run_c
from tests.ground_cases import make_block, make_prism

QUANTITIES = ("acceleration", "member_tension", "total_energy", "contact_force", "penetration")


def write_c(structure: Structure, *integrators: str, events: tuple[str, ...] = ("auto",)) -> GeneratedSource:
    formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
    request = ModelRequest(QUANTITIES, integrators=integrators, formulation=formulation, events=events)
    return emit(structure, request, account=False)


@pytest.mark.parametrize("language", ["c", "c++"])
@pytest.mark.parametrize("events", [("auto",), ()])
def test_generated_sources_compile_without_a_warning(
    language: str, events: tuple[str, ...], tmp_path: Path
) -> None:
    source = write_c(make_prism(), "rk4", "rk54", "rk853", events=events)
    write_files(tmp_path, source.files)
    command = require_compiler("gcc").command if language == "c" else require_cpp("g++")
    standard = "-std=c99" if language == "c" else "-std=c++11"
    for unit in ("small.c", "example.c"):
        words = [*command, standard, *STRICT, "-x", language, "-fsyntax-only", unit]
        run(words, tmp_path)


def test_the_example_program_moves_the_structure(tmp_path: Path) -> None:
    write_files(tmp_path, write_c(make_prism(), "rk54").files)
    assert "0.100 s" in run_program(tmp_path, "-std=c99", "-O1", "example.c", "small.c")


def test_header_and_manifest_name_internal_states_and_contacts() -> None:
    source = write_c(make_prism(), "rk54")
    header, manifest = source.files["small.h"], Manifest.from_json(source.files["manifest.json"])
    for line in ("SMALL_N_STATES = 48", "SMALL_N_INTERNAL = 12", "SMALL_N_CONTACTS = 6"):
        assert line in header
    assert "SMALL_EVENT_GROUND = 16" in header
    assert "SMALL_EVENT_STICK = 32" in header
    assert manifest.internal_name[:2] == ("n0_stick1", "n0_stick2")
    assert manifest.contact_name == tuple(f"n{k}" for k in range(6))
    assert manifest == source.manifest


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_without_friction_or_ground_there_are_none(friction: float) -> None:
    structure = make_block([0.0, 0.0, 0.5], friction=friction)
    with_ground = write_c(structure, "rk54").files
    assert ("N_INTERNAL" in with_ground["small.h"]) == (friction > 0)
    assert ("internal" in with_ground["small.c"]) == (friction > 0)
    request = ModelRequest(QUANTITIES[:3], integrators=("rk54",), events=("auto",))
    without = emit(structure.with_changes(ground=None), request, account=False).files
    assert not {"internal_name", "contact_name"} & set(json.loads(without["manifest.json"]))
    for word in ("N_INTERNAL", "N_CONTACTS", "EVENT_GROUND"):
        assert word not in without["small.c"]


@pytest.mark.parametrize("language", ["c", "c++"])
@pytest.mark.parametrize("n", [1, 15])
def test_plain_files_compile_alone_with_internal_states(n: int, language: str, tmp_path: Path) -> None:
    family = "gcc" if language == "c" else "g++"
    options = (*options_for(n, False), "-DWITH_INTERNAL=1")
    compile_alone(
        ["explicit.h", "tableau.h", "sample.h", "extrapolate.h"], family, language, options, tmp_path
    )


MEMORY = """
#include "events.h"
#include "explicit.h"
#include <stdio.h>
int main(void) { printf("%d %d\\n", (int)sizeof(event_memory), (int)sizeof(method_work)); return 0; }
"""


def test_memory_is_counted_as_the_compiler_does(tmp_path: Path) -> None:
    n = 4
    sizes = {"N": n, "N_STATES": 2 * n + 1, "N_SLOPES": n + 1, "N_OLD": 3 * n + 2, "N_MARGINS": 2}
    sizes |= {"METHOD_RATES": 3, "METHOD_HAS_DENSE": 1, "METHOD_DENSE": 3, "WITH_EVENTS": 1}
    sizes |= {"METHOD_KEEPS_ENERGY": 1, "WITH_PROFILE": 1, "N_DRIVEN": 1, "AXES": 1, "N_MASSES": n}
    sizes["event_memory"] = events = count_bytes("event_memory", "events.h", sizes)
    sizes["energy_memory"] = count_bytes("energy_memory", "energy.h", sizes)
    work = count_bytes("method_work", "explicit.h", sizes)
    printed = run_c(MEMORY, tmp_path, *options_for(n, False), "-DWITH_INTERNAL=1")
    assert [int(word) for word in printed.split()] == [events, work]


HERMITE = """
#include "interpolate.h"
#include <stdio.h>
int main(void)
{
  /* One coordinate at rest; z = 1 + 2 t - 3 t^2 + 4 t^3 on a step of 0.5. */
  const double h = 0.5, z1 = 1.0 + 2.0 * h - 3.0 * h * h + 4.0 * h * h * h, d1 = 2.0 - 6.0 * h + 12.0 * h * h;
  const double old[5] = {1.0, 0.0, 1.0, 0.0, 2.0}, end[3] = {1.0, 0.0, z1}, slope[2] = {0.0, d1};
  double out[3];
  motion_interpolate(0.3, h, old, end, end + 1, slope, out);
  printf("%.17g %.17g %.17g\\n", out[0], out[1], out[2]);
  return 0;
}
"""


def test_internal_states_are_interpolated_by_a_cubic(tmp_path: Path) -> None:
    printed = run_c(HERMITE, tmp_path, *options_for(1, False), "-DWITH_INTERNAL=1")
    q, v, z = map(float, printed.split())
    t = 0.15
    assert (q, v) == (1.0, 0.0)
    assert z == pytest.approx(1 + 2 * t - 3 * t**2 + 4 * t**3, rel=1e-14)
