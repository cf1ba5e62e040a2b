"""The generated files as an embedder uses them: any compiler, C or C++, no state, no surprises."""

import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import ABI_VERSION, FunctionSpec
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import (
    STRICT,
    check_object,
    check_sanitized,
    require_cpp,
    run,
    run_program,
    write_files,
)
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.drive_c import format_driver
from tests.codegen.subjects import bare, everything, in_single_precision
from tests.codegen.table.subjects import served
from tests.comparison import dense

REFERENCE = FLAG_SETS["reference"].options


def everything_in_single() -> tuple[Structure, ModelRequest]:
    return in_single_precision(everything)


def bare_in_batches() -> tuple[Structure, ModelRequest]:
    structure, request = bare()
    return structure, replace(request, batch_width=8)


def everything_in_tables() -> tuple[Structure, ModelRequest]:
    structure, request = everything()
    structure = structure.with_changes(member_mass=0 * structure.member_mass)
    integrators = tuple(name for name in request.integrators if name != "radau")
    request = replace(request, emitter="table", integrators=integrators)
    return structure, replace(request, quantities=served(structure, request))


SUBJECTS = {
    "everything": everything,
    "bare": bare,
    "single": everything_in_single,
    "batches": bare_in_batches,
    "tables": everything_in_tables,
}
EACH_CPP = ("g++", *thorough("clang++", "zig"))
each = pytest.mark.parametrize("subject", ["bare", "batches", *thorough("everything", "single", "tables")])


class Made(dict[str, Any]):
    """What is made of each subject, once and when it is wanted."""

    def __init__(self, make: Callable[[Structure, ModelRequest], Any]) -> None:
        super().__init__()
        self.make = make

    def __missing__(self, name: str) -> Any:
        self[name] = self.make(*SUBJECTS[name]())
        return self[name]


@pytest.fixture(scope="module")
def sources() -> dict[str, GeneratedSource]:
    """All subjects, with CasADi's interface where there is one."""

    def make(structure: Structure, request: ModelRequest) -> GeneratedSource:
        interfaces = () if request.precision == "single" else ("casadi",)
        return emit(structure, replace(request, interfaces=interfaces))

    return Made(make)


@pytest.fixture(scope="module")
def models() -> dict[str, CompiledModel]:
    return Made(lambda structure, request: build_library(structure, request).load())


# --- compilers and languages -----------------------------------------------------------------------


@each
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_it_is_c99_without_a_warning(sources: Any, subject: str, family: str, tmp_path: Path) -> None:
    compiler = require_compiler(family)
    files = sources[subject].files
    folder = write_files(tmp_path / "source", files)
    for unit in (f"{sources[subject].manifest.name}.c", "example.c"):
        run([*compiler.command, "-std=c99", *STRICT, "-c", unit, "-o", f"{unit}.o"], folder, compiler)


@each
@pytest.mark.parametrize("family", EACH_CPP)
def test_it_is_cpp11_without_a_warning(sources: Any, subject: str, family: str, tmp_path: Path) -> None:
    command, name = require_cpp(family), sources[subject].manifest.name
    folder = write_files(tmp_path / "source", sources[subject].files)
    options = ("-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Werror")
    zig = require_compiler("zig") if family == "zig" else None
    run([*command, *options, "-c", f"{name}.c", "-o", "scene.o"], folder, zig)


@pytest.mark.thorough
@each
def test_the_header_may_be_included_twice(sources: Any, subject: str, tmp_path: Path) -> None:
    compiler, name = find_compiler(), sources[subject].manifest.name
    folder = write_files(tmp_path / "source", sources[subject].files)
    text = f'#include "{name}.h"\n#include "{name}.h"\nint main(void) {{ return {name.upper()}_OK; }}\n'
    write_files(folder, {"twice.c": text})
    run([*compiler.command, "-std=c99", *STRICT, "-c", "twice.c", "-o", "twice.o"], folder, compiler)


@pytest.mark.thorough
def test_two_scenes_go_into_one_program(sources: Any, tmp_path: Path) -> None:
    chosen = (sources["everything"], sources["bare"])
    folder = write_files(tmp_path / "source", {n: t for s in chosen for n, t in s.files.items()})
    names = [source.manifest.name for source in chosen]
    includes = "".join(f'#include "{name}.h"\n' for name in names)
    sizes = " + ".join(f"{name}_descriptor.abi_version" for name in names)
    write_files(folder, {"main.c": f"{includes}int main(void) {{ return {sizes} - {2 * ABI_VERSION}; }}\n"})
    units = ["main.c", *(f"{name}.c" for name in names)]
    run_program(folder, "-std=c99", *units)


# --- what it prints is what Python computes --------------------------------------------------------


def parse_printed(text: str) -> dict[str, list[float]]:
    """Return title -> numbers of the blocks "title ...\\n  place number"."""
    found: dict[str, list[float]] = {}
    title = ""
    for line in text.splitlines():
        entry = re.match(r"^  \S.* +(\S+)$", line)
        if entry:
            found[title].append(float(entry[1]))
        else:
            title = line.split(" ")[0]
            found[title] = []
    return found


def stored_values(model: CompiledModel, spec: FunctionSpec) -> np.ndarray:
    """Return a quantity's numbers as C stores them."""
    found = model.compute(spec.quantity)
    return found.data if spec.pattern is not None else dense(found).ravel()


@each
@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_example_prints_what_python_computes(
    sources: Any, models: Any, subject: str, tmp_path: Path
) -> None:
    compiler = find_compiler()
    folder = write_files(tmp_path / "source", sources[subject].files)
    flags = [] if subject == "bare" else ["CFLAGS=-std=c99"]  # else those of the Makefile
    run(["make", "example", f"CC={' '.join(compiler.command)}", *flags], folder, compiler)
    printed = parse_printed(run([str(folder / "example")], folder).stdout)
    for spec in models[subject].manifest.functions:
        stored = stored_values(models[subject], spec)
        read = np.array(printed[spec.quantity], dtype=models[subject].dtype)
        np.testing.assert_array_equal(read, stored)
    run(["make", "clean"], folder)
    assert not (folder / "example").exists()


MOTION_ROW = re.compile(r"^  (\d\.\d+) s((?:  \S+ +\S+)+)$", re.MULTILINE)


@pytest.mark.parametrize("name", ["rk4", *thorough("rk54", "radau")])
def test_the_example_integrates_the_motion(models: Any, name: str, tmp_path: Path) -> None:
    """From the scene's own state, with each kind of integrator that a library can have alone."""
    structure, request = everything()
    request = replace(request, quantities=("acceleration",), integrators=(name,))
    folder = write_files(tmp_path / "source", emit(structure, request).files)
    text = run_program(folder, "-std=c99", "-O0", *STRICT, "example.c", "braced.c")
    assert f"motion by {name}, 0.1 s" in text
    rows = [(float(time), found.split()) for time, found in MOTION_ROW.findall(text)]
    assert [time for time, _ in rows] == [k / 100 for k in range(11)]
    model = models["everything"]
    motion = simulate(model, 0.1, samples=11, method="rk853", rtol=1e-10, stepping=Stepping(atol=1e-12))
    names = list(model.manifest.coordinate_name)
    for k, (_, words) in enumerate(rows):
        for coordinate, value in zip(words[::2], words[1::2], strict=True):
            expected = motion.coordinate[k, names.index(coordinate)]
            assert float(value) == pytest.approx(expected, abs=2e-6)


EMBEDDER = """
#include <stdio.h>
#include "braced.h"

int main(void)
{
  double tension[BRACED_N_MEMBERS], force[BRACED_N_NODES * BRACED_N_AXES];
  double coordinate[BRACED_N_COORDINATES];
  int k, status;
  for (k = 0; k < BRACED_N_COORDINATES; ++k) {
    coordinate[k] = braced_nominal_coordinate[k] + 0.001 * k;
  }
  status = braced_compute_member_tension(TENSION_ARGUMENTS, tension);
  status += braced_compute_node_force(FORCE_ARGUMENTS, force);
  printf("tension\\n");
  for (k = 0; k < BRACED_N_MEMBERS; ++k) {
    printf("  %d %.17g\\n", k, tension[k]);
  }
  printf("force\\n");
  for (k = 0; k < BRACED_N_NODES * BRACED_N_AXES; ++k) {
    printf("  %d %.17g\\n", k, force[k]);
  }
  printf("named\\n  0 %.17g\\n  1 %.17g\\n", tension[BRACED_MEMBER_e3],
         force[BRACED_NODE_n3 * BRACED_N_AXES + 2]);
  return status;
}
"""


def test_forces_in_a_program_of_one_s_own(models: Any, tmp_path: Path) -> None:
    """Header and source alone, linked into a program elsewhere, no Python and no CasADi."""
    model = models["everything"]
    structure, request = everything()
    files = emit(structure, request.wanting("member_tension", "node_force")).files

    def passed(quantity: str) -> str:
        names = model.function(quantity).arguments
        return ", ".join("coordinate" if n == "coordinate" else f"braced_nominal_{n}" for n in names)

    text = EMBEDDER.replace("TENSION_ARGUMENTS", passed("member_tension"))
    text = text.replace("FORCE_ARGUMENTS", passed("node_force"))
    folder = write_files(
        tmp_path / "elsewhere", {"main.c": text} | {n: files[n] for n in ("braced.c", "braced.h")}
    )
    printed = parse_printed(run_program(folder, *REFERENCE, *STRICT, "main.c", "braced.c"))
    coordinate = model.nominal("coordinate") + 0.001 * np.arange(8)
    tension = model.compute("member_tension", coordinate=coordinate)
    force = model.compute("node_force", coordinate=coordinate)
    np.testing.assert_array_equal(printed["tension"], tension)
    np.testing.assert_array_equal(printed["force"], force.ravel())
    assert printed["named"] == [tension[3], force[3, 2]]


# --- no state, no memory, no undefined behaviour ---------------------------------------------------


@each
@pytest.mark.parametrize("options", [("-std=c99",), *thorough((REFERENCE,))])
@pytest.mark.skipif(sys.platform != "linux", reason="reads the symbols of ELF objects")
def test_it_allocates_nothing_and_has_no_writable_data(
    sources: Any, subject: str, options: tuple[str, ...], tmp_path: Path
) -> None:
    name = sources[subject].manifest.name
    folder = write_files(tmp_path / "source", sources[subject].files)
    needed, exported = check_object(folder, f"{name}.c", *options)
    assert needed <= {"sqrt", "pow", "fmax", "fmin", "sqrtf", "fmaxf", "fminf"}
    assert all(symbol.startswith((f"{name}_", f"jac_{name}_")) for symbol in exported)


@pytest.mark.thorough
@each
def test_no_sanitizer_has_anything_to_say(sources: Any, subject: str, tmp_path: Path) -> None:
    source = sources[subject]
    driver = format_driver(source.manifest, source.files[f"{source.manifest.name}.c"])
    folder = write_files(tmp_path / "source", source.files | {"driver.c": driver})
    check_sanitized(folder, "driver.c", f"{source.manifest.name}.c")
