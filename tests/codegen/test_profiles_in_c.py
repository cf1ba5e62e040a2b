"""The C of docs/integrating_in_c.md drives a motor as `simulate` does; libraries with profiles."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import Profile, load_scene, simulate
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.codegen.build_c import STRICT, require_cpp, run, write_files
from tests.codegen.compilers import require_compiler
from tests.codegen.subjects import bare, everything, in_single_precision
from tests.models import EXAMPLES, ROOT

SECTION = "## Arguments over time"
MAIN = """
#include <stdio.h>
#include <string.h>
#include "prism12.h"
int main(void)
{
  int k;
  BODY
  for (k = 0; k < PRISM12_N_STATES; ++k) printf("%.17g\\n", state[k]);
  printf("%d %.17g\\n", status, time);
  return 0;
}
"""


def compiler() -> list[str]:
    return [*require_compiler("gcc").command, "-std=c99", "-O0", *STRICT]


@pytest.fixture(scope="module")
def prism12(tmp_path_factory: pytest.TempPathFactory) -> tuple[CompiledModel, Path]:
    """The model of the page, and a folder with its header and object file."""
    structure, request = load_scene(EXAMPLES / "prism12.toml")
    request = request.wanting(*SIMULATION_QUANTITIES, integrators=("rk54", "rk853"))
    request = replace(request, events=("auto",))
    folder = tmp_path_factory.mktemp("prism12")
    write_files(folder, emit(structure, request).files)
    run([*compiler(), "-c", "prism12.c"], folder)
    return build_library(structure, request).load(), folder


def run_with(folder: Path, name: str, text: str) -> list[str]:
    """Compile a program, link it with the model, and return the lines that it prints."""
    (folder / f"{name}.c").write_text(text, encoding="utf-8")
    run([*compiler(), f"{name}.c", "prism12.o", "-lm", "-o", name], folder)
    return run([str(folder / name)], folder).stdout.splitlines()


def test_the_documented_program_steps_the_model(prism12: tuple[CompiledModel, Path]) -> None:
    """The whole program of the page as printed, beside one `simulate` for each period."""
    text = (ROOT / "docs/integrating_in_c.md").read_text(encoding="utf-8")
    found = re.search(r"```c\n(.*?)```", text, re.DOTALL)
    assert found is not None
    model, folder = prism12
    shown = "\n".join(run_with(folder, "stepping", found[1]))
    printed = re.findall(r"^(\S+) s  t1_z (\S+) m  vertical1 (\S+) N$", shown, re.MULTILINE)
    assert [float(row[0]) for row in printed] == pytest.approx([0.02 * k for k in range(1, 11)])
    start = {name: model.nominal(name) for name in ("coordinate", "velocity")}
    motor_input = model.nominal("input").copy()
    motor = list(model.manifest.input_name).index("v1")
    height = list(model.manifest.coordinate_name).index("t1_z")
    for k in range(1, 41):
        motor_input[motor] = -1e-4 * k
        motion = simulate(
            model,
            1e-3,
            samples=2,
            method="rk54",
            rtol=1e-9,
            stepping=Stepping(atol=1e-12),
            arguments={"input": motor_input},
            **start,
        )
        start = {"coordinate": motion.coordinate[-1], "velocity": motion.velocity[-1]}
        if k % 20 == 0:
            _, position, tension = printed[k // 20 - 1]
            assert float(position) == pytest.approx(motion.coordinate[-1, height], abs=1e-7)
            assert float(tension) == pytest.approx(motion.tension("vertical1")[-1], abs=1e-3)


def test_the_documented_c_drives_the_motor_as_simulate_does(prism12: tuple[CompiledModel, Path]) -> None:
    text = (ROOT / "docs/integrating_in_c.md").read_text(encoding="utf-8").split(SECTION)[1]
    found = re.search(r"```c\n(.*?)```", text, re.DOTALL)
    assert found is not None
    model, folder = prism12
    lines = run_with(folder, "main", MAIN.replace("BODY", found[1]))
    *state, (status, time) = [line.split() for line in lines]
    assert (int(status), float(time)) == (0, 1.0)
    pull = Profile([0.0, 0.1, 0.3, 1.0], {"v1": [0.0, 0.0, -0.01, -0.01]})
    driven = simulate(
        model,
        1.0,
        samples=2,
        method="rk853",
        rtol=1e-8,
        stepping=Stepping(atol=1e-10, control="steps"),
        schedule=pull,
    )
    expected = np.concatenate([driven.coordinate[-1], driven.velocity[-1]])
    np.testing.assert_allclose([float(word[0]) for word in state], expected, atol=1e-9)
    assert np.abs(driven.velocity[-1]).max() > 1e-3


def write_library(folder: Path, structure: Structure, request: object) -> list[str]:
    """Write the C of a library; returns its source files."""
    files = emit(structure, request).files  # type: ignore[arg-type]
    write_files(folder, files)
    return [name for name in files if name.endswith(".c") and name != "example.c"]


@pytest.mark.parametrize("case", ["fixed step", *thorough("all", "no events", "single", "batches")])
def test_libraries_with_profiles_compile_without_a_warning(case: str, tmp_path: Path) -> None:
    structure, request = in_single_precision(everything) if case == "single" else everything()
    request = replace(request, quantities=("acceleration",))
    if case == "no events":
        request = replace(request, events=())
    if case == "batches":
        request = replace(request, batch_width=8)
    kinds = (("rk4",),) if case == "fixed step" else (request.integrators, ("rk4",))
    for integrators in kinds:
        folder = tmp_path / "_".join(integrators)
        folder.mkdir()
        sources = write_library(folder, structure, replace(request, integrators=integrators))
        header = (folder / f"{structure.name}.h").read_text()
        assert f"}} {structure.name}_profile;" in header
        gcc = [*require_compiler("gcc").command, "-std=c99"]
        for command in (gcc, [*require_cpp("g++"), "-std=c++11", "-x", "c++"]):
            run([*command, "-O0", *STRICT, "-c", *sources], folder)


def test_a_library_without_inputs_has_no_profiles() -> None:
    structure, request = bare()
    source = emit(structure, replace(request, integrators=("rk4", "rk54")))
    assert source.manifest.driven == ()
    assert not any("profile" in text for name, text in source.files.items() if name.endswith((".c", ".h")))
