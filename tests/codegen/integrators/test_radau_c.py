"""The C of the integrator radau as an embedder uses it: strict compilers, sanitizers, the same bits."""

from pathlib import Path

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import STRICT, has_sanitizers, run, run_program, write_files
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.quickly import SANITIZE
from tests.runtime.build import cable, make_structure
from tests.runtime.stiff_bars import class_two

MAIN = """
#include <stdio.h>
#include <string.h>
#include "chain.h"
int main(void)
{
  static double state[CHAIN_N_STATES], work[CHAIN_RADAU_WORK];
  static double sample[3][CHAIN_N_STATES], tension[3][CHAIN_RADAU_N_TENSIONS];
  const double at[3] = {0.0, 0.25, 0.5};
  double time = 0.0, step = 0.0, vibration[3];
  long long n_sampled = 1, count[6] = {0, 0, 0, 0, 0, 0};
  int status, k;
  memcpy(state, chain_nominal_coordinate, sizeof chain_nominal_coordinate);
  memset(work, 255, sizeof work); /* NAN: nothing may be read before it is written */
  status = chain_integrate_radau(0.5, 1e-6, 1e-6, 100000, &time, &step, state, PASSED
      3, at, &sample[0][0], &tension[0][0], &n_sampled, count, vibration, work);
  for (k = 0; k < CHAIN_N_STATES; ++k) printf("%a ", sample[2][k]);
  for (k = 0; k < CHAIN_RADAU_N_TENSIONS; ++k) printf("%a ", tension[2][k]);
  printf("%lld %lld %d", n_sampled, count[0], status);
  return status;
}
"""


def write(folder: Path, structure: Structure | None = None) -> Path:
    structure = (class_two(1e6, 0.3) if structure is None else structure).with_changes(name="chain")
    changeable = {"rest_length": tuple(range(structure.n_members)), "gravity": ()}
    source = emit(structure, ModelRequest(("member_tension",), changeable, integrators=("radau",)))
    passed = "".join(f"chain_nominal_{name}, " for name in source.manifest.integrators[0].arguments)
    return write_files(folder, {**source.files, "main.c": MAIN.replace("PASSED", passed)})


REFERENCE: dict[str, str] = {}


@pytest.mark.parametrize("family", EACH_FAMILY)
def test_it_compiles_without_a_warning_where_there_is_no_multiplier(family: str, tmp_path: Path) -> None:
    compiler = require_compiler(family)
    cables = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 0.9)], anchored={0: "xyz"}, axes="x")
    folder = write(tmp_path, cables)
    run([*compiler.command, "-std=c99", "-O1", *STRICT, "-c", "chain.c"], folder, compiler)


@pytest.mark.parametrize("family", EACH_FAMILY)
def test_every_compiler_takes_it_and_gives_the_same_bits(family: str, tmp_path: Path) -> None:
    compiler, folder = require_compiler(family), write(tmp_path)
    flags = ["-std=c99", "-O2", "-ffp-contract=off"]
    run([*compiler.command, *flags, *STRICT, "-c", "chain.c"], folder, compiler)
    said = run_program(folder, *flags, "main.c", "chain.o", family=family)
    assert said.endswith(" 0")
    assert said == REFERENCE.setdefault("bits", said)


@pytest.mark.thorough
def test_it_is_clean_under_sanitizers(tmp_path: Path) -> None:
    folder = write(tmp_path)
    if not has_sanitizers(require_compiler("gcc"), tmp_path):
        pytest.skip("the compiler here has no sanitizers")
    assert run_program(folder, "-std=c99", *SANITIZE, "chain.c", "main.c").endswith(" 0")


def test_single_precision_is_refused() -> None:
    request = ModelRequest(("member_tension",), integrators=("radau",), precision="single")
    with pytest.raises(FormulationError, match="double precision"):
        emit(class_two(1e6), request)


def test_other_formulations_are_told_what_is_missing() -> None:
    request = ModelRequest(("acceleration",), integrators=("radau",), formulation="node_distance")
    with pytest.raises(FormulationError, match="node coordinates"):
        emit(class_two(1e6), request)
