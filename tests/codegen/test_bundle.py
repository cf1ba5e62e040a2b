"""A folder with a library: other projects find two of them by CMake and by pkg-config."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen import casadi_functions
from tensegrity_codegen.codegen.bundle import LICENCE, emit_bundle
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.codegen.quickly import without_optimisation
from tests.codegen.subjects import bare

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"
NAMES = ("prism", "planar")

PROGRAM = """
#include <stdio.h>
#include "planar.h"
#include "prism.h"

int main(void)
{
  double of_prism[PRISM_N_MEMBERS], of_planar[PLANAR_N_MEMBERS];
  int k;
  if (prism_compute_member_tension(prism_nominal_coordinate, of_prism) != PRISM_OK ||
      planar_compute_member_tension(planar_nominal_coordinate, planar_nominal_velocity,
                                    of_planar) != PLANAR_OK) {
    return 1;
  }
  for (k = 0; k < PRISM_N_MEMBERS; ++k) {
    printf("prism %s %.17g\\n", prism_member_name[k], of_prism[k]);
  }
  for (k = 0; k < PLANAR_N_MEMBERS; ++k) {
    printf("planar %s %.17g\\n", planar_member_name[k], of_planar[k]);
  }
  puts(prism_status_text(PRISM_NULL_POINTER));
  return 0;
}
"""

CMAKE = """
cmake_minimum_required(VERSION 3.12)
project(elsewhere {language})
find_package(tensegrity_prism 1.0 REQUIRED)
find_package(tensegrity_planar 1 REQUIRED)
find_package(tensegrity_planar 2 QUIET)
if(tensegrity_planar_FOUND)
  message(FATAL_ERROR "version 2 of the interface was found")
endif()
add_executable(program program.{ending})
target_link_libraries(program PRIVATE tensegrity::prism tensegrity::planar)
"""


@pytest.fixture(scope="module")
def libraries() -> dict[str, BuiltLibrary]:
    with without_optimisation():
        return {name: build_library(*narrow(name)) for name in NAMES}


def narrow(name: str):  # type: ignore[no-untyped-def]
    structure, request = load_scene(EXAMPLES / f"{name}.toml")
    return structure, request.wanting("member_tension")


@pytest.fixture(scope="module")
def bundles(libraries: dict[str, BuiltLibrary], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bundles") / "with space"
    return {name: library.export(folder / name) for name, library in libraries.items()}


def require(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed; on Debian: apt-get install {program}")


def run(command: Sequence[str | Path], folder: Path, **environment: str) -> str:
    own = find_compiler()
    base = {**os.environ, "CC": own.command[0]} if len(own.command) == 1 else dict(os.environ)
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=base | environment,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def check_numbers(printed: str, libraries: dict[str, BuiltLibrary]) -> None:
    rows = [line.split() for line in printed.splitlines()[:-1]]
    for name, library in libraries.items():
        model = library.load()
        assert [row[1] for row in rows if row[0] == name] == list(model.manifest.member_name)
        found = np.array([float(row[2]) for row in rows if row[0] == name])
        expected = model.compute("member_tension")
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    assert printed.splitlines()[-1] == "a pointer that is needed is NULL"


def write_project(folder: Path, language: str = "C") -> Path:
    ending = {"C": "c", "CXX": "cpp"}[language]
    folder.mkdir()
    (folder / f"program.{ending}").write_text(PROGRAM, encoding="utf-8")
    text = CMAKE.replace("{language}", language).replace("{ending}", ending)
    (folder / "CMakeLists.txt").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="the paths are those of Linux")
def test_a_project_with_cmake_finds_an_installed_and_a_plain_bundle(
    bundles: dict[str, Path], libraries: dict[str, BuiltLibrary], tmp_path: Path
) -> None:
    require("cmake", "make")
    prefix, build, plain = tmp_path / "prefix", tmp_path / "build", ["-G", "Unix Makefiles"]
    run(["cmake", *plain, "-S", bundles["prism"], "-B", build, f"-DCMAKE_INSTALL_PREFIX={prefix}"], tmp_path)
    run(["cmake", "--build", build], tmp_path)
    assert "bar1" in run([build / "example"], tmp_path)
    run(["cmake", "--install", build], tmp_path)
    project = write_project(tmp_path / "project")
    found = f"-DCMAKE_PREFIX_PATH={prefix};{bundles['planar']}"
    run(["cmake", *plain, "-S", project, "-B", project / "build", found], tmp_path)
    run(["cmake", "--build", project / "build"], tmp_path)
    check_numbers(run([project / "build" / "program"], tmp_path), libraries)
    if shutil.which("pkg-config") is not None:
        words = run(
            ["pkg-config", "--cflags", "--libs", "tensegrity_prism"],
            tmp_path,
            PKG_CONFIG_PATH=str(next(prefix.rglob("pkgconfig"))),
        )
        assert any(
            Path(word[2:]).resolve() == prefix / "include/tensegrity_prism" for word in shlex.split(words)
        )


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="the paths are those of Linux")
def test_a_project_of_c_plus_plus_alone_compiles_the_sources(
    bundles: dict[str, Path], libraries: dict[str, BuiltLibrary], tmp_path: Path
) -> None:
    require("cmake", "make", "c++")
    project = write_project(tmp_path / "project", "CXX")
    found = "-DCMAKE_PREFIX_PATH=" + ";".join(str(folder) for folder in bundles.values())
    run(["cmake", "-G", "Unix Makefiles", "-S", project, "-B", project / "build", found], tmp_path)
    run(["cmake", "--build", project / "build"], tmp_path)
    check_numbers(run([project / "build" / "program"], tmp_path), libraries)


def test_headers_of_scenes_that_differ_in_case_are_not_mixed(tmp_path: Path) -> None:
    structure, request = bare()
    for name in ("Mast", "mast"):
        header = emit(replace(structure, name=name), request).files[f"{name}.h"]
        # file systems that do not distinguish cases keep both
        (tmp_path / f"{name}_{name.isupper() or name[0].isupper()}.h").write_text(header, encoding="utf-8")
    both = tmp_path / "both.c"
    both.write_text('#include "Mast_True.h"\n#include "mast_False.h"\n', encoding="utf-8")
    done = subprocess.run(
        [*find_compiler().command, "-c", str(both), "-o", str(tmp_path / "both.o")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "upper and lower case" in done.stderr


SHARED = """
cmake_minimum_required(VERSION 3.12)
project(inside C)
find_package(tensegrity_prism REQUIRED)
add_library(inside SHARED inside.c)
target_link_libraries(inside PRIVATE tensegrity::prism)
"""
INSIDE = """
#include "prism.h"
int inside(double *tension);
int inside(double *tension) { return prism_compute_member_tension(prism_nominal_coordinate, tension); }
"""


@pytest.mark.thorough
def test_a_shared_library_can_contain_a_bundle(bundles: dict[str, Path], tmp_path: Path) -> None:
    require("cmake", "make")
    (tmp_path / "inside.c").write_text(INSIDE, encoding="utf-8")
    (tmp_path / "CMakeLists.txt").write_text(SHARED, encoding="utf-8")
    build = tmp_path / "build"
    prefix = f"-DCMAKE_PREFIX_PATH={bundles['prism']}"
    run(["cmake", "-G", "Unix Makefiles", "-S", tmp_path, "-B", build, prefix], tmp_path)
    run(["cmake", "--build", build], tmp_path)
    assert list(build.glob("*inside*"))


@pytest.mark.skipif(sys.platform != "linux", reason="the shared libraries are those of Linux")
def test_a_program_finds_two_bundles_by_pkg_config(
    bundles: dict[str, Path], libraries: dict[str, BuiltLibrary], tmp_path: Path
) -> None:
    require("pkg-config")
    project = write_project(tmp_path / "project")
    path = os.pathsep.join(str(folder) for folder in bundles.values())
    words = run(
        ["pkg-config", "--cflags", "--libs", "tensegrity_prism", "tensegrity_planar"],
        project,
        PKG_CONFIG_PATH=path,
    )
    run([*find_compiler().command, "program.c", "-o", "program", *shlex.split(words)], project)
    check_numbers(run([project / "program"], project), libraries)


def test_the_folder_explains_itself(bundles: dict[str, Path]) -> None:
    page = (bundles["prism"] / "README.md").read_text(encoding="utf-8")
    listed = {path.name for path in bundles["prism"].iterdir()} - {"SHA256SUMS"}
    for name in listed:
        assert name in page or name.endswith(".cmake") or name == "README.md", name
    assert "prism_compute_member_tension" in page
    places = [
        page.index(words) for words in ("cmake -B build", "cmake --build build", "cmake --install build")
    ]
    assert places == sorted(places)
    assert LICENCE.splitlines()[2] in (bundles["prism"] / "NOTICE.md").read_text(encoding="utf-8")
    sums = (bundles["prism"] / "SHA256SUMS").read_text(encoding="utf-8")
    assert all(name in sums for name in listed)


def test_the_licence_is_that_of_the_project() -> None:
    assert (ROOT / "LICENSE").read_text(encoding="utf-8") == LICENCE


def test_all_sources_are_compiled_where_tables_are_apart() -> None:
    source = emit(*bare())
    files = emit_bundle(source.manifest, ["triangle.c", "triangle_tables.c"], "libtriangle.so")
    listed = files["tensegrity_triangleSources.cmake"]
    assert "/triangle.c" in listed
    assert "/triangle_tables.c" in listed
    assert all(text.endswith("\n") for text in files.values())


def test_the_folder_names_derivatives_that_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    structure, request = bare()
    request = replace(request.wanting("node_residual", "acceleration"), interfaces=("casadi",))

    def read_page() -> str:
        page = emit_bundle(emit(structure, request).manifest, ["triangle.c"], "libtriangle.so")["README.md"]
        return page.partition("## In CasADi")[2].partition("##")[0]

    assert "with first derivatives.\n" in read_page()
    monkeypatch.setattr(casadi_functions, "MAX_MEMBERS", 2)
    assert "with first derivatives. These are missing, since their code would be too long: " in read_page()
    assert "`jac_acceleration`." in read_page()
    request = replace(request, quantities=("acceleration",))
    assert "without derivatives. These are missing" in read_page()


@pytest.mark.thorough
def test_the_folder_names_the_functions_of_other_programs() -> None:
    structure, request = load_scene(EXAMPLES / "prism12.toml")
    request = request.wanting("acceleration", "state_derivative")
    source = emit(structure, replace(request, interfaces=("acados",), emitter="auto"))
    page = emit_bundle(source.manifest, ["prism12.c"], "libprism12.so")["README.md"]
    in_acados = page.partition("## In acados")[2].partition("##")[0]
    size = len(source.manifest.coordinate_name)
    assert f"x is\n`coordinate` ({size}), `velocity` ({size})" in in_acados
    assert all(f"`{name}`" in in_acados for name in source.manifest.input_name)
    for word in re.findall(r"`(?:prism12)?(_(?:expl|impl)_\w+)`", in_acados):
        assert f"int prism12{word}(" in source.files["prism12.c"], word
    source = emit(structure, replace(request, interfaces=("casadi",)))
    page = emit_bundle(source.manifest, ["prism12.c"], "libprism12.so")["README.md"]
    name = re.findall(r'casadi.external\("(\w+)"', page)[0]
    assert f"int {name}(const double **arg" in source.files["prism12.c"]
