"""Generated C and its example program compile and link for other systems; where an emulator is, they run."""

import math
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import STRICT, run, write_files
from tests.codegen.compilers import require_compiler
from tests.codegen.other_machines import require
from tests.control.feedback.standing_prism import SCENE as STANDING

# Zig compiles the C library of each system the first time, for minutes where the processor is shared.
pytestmark = [pytest.mark.thorough, pytest.mark.timeout(1800)]

METHODS = ("rk4", "rk54", "rk853", "radau", "rodas")
QUANTITIES = ("acceleration", "state_jacobian", "member_tension", "total_energy")
SCENES = {"prism": list_examples()["prism"], "standing": STANDING}
WINCH = """
[[actuators]]
name = "winch"
members = "cord"
rate = 0.2
"""
# The system of zig, and what its programs are run by here.
SYSTEMS: Mapping[str, tuple[str, str]] = {
    "x86_64-windows-gnu": ("wine", "wine"),
    "x86_64-macos-none": ("", ""),
    "aarch64-macos-none": ("", ""),
    "aarch64-linux-musl": ("qemu-aarch64", "qemu-user"),
}
MARKS = {"windows": b"MZ", "macos": b"\xcf\xfa\xed\xfe", "linux": b"\x7fELF"}  # of binary files


def write_library(name: str, folder: Path) -> Path:
    """Write the library of a scene with all that a simulation calls, and its example program."""
    scene = folder / f"{name}.toml"
    scene.write_text(SCENES[name], encoding="utf-8")
    structure, request = load_scene(scene)
    wanted = ModelRequest(
        QUANTITIES, formulation=request.formulation, integrators=METHODS, events=("auto",), emitter="unrolled"
    )
    return write_files(folder / name, emit(structure, wanted).files)


def write_controller(folder: Path) -> Path:
    """Write a controller of a mass on a cord, with the model that it needs, and its example program."""
    scene = folder / "lift.toml"
    scene.write_text('axes = "z"\n' + list_examples()["two_nodes"] + WINCH, encoding="utf-8")
    model = compile_scene(scene, for_=("equilibrium", "control"))
    found = find_equilibrium(model)
    gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    return build_controller(
        scene, found, gains, code=ControllerCode(library=False), out=folder / "controller"
    ).folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sources")
    return {name: write_library(name, folder) for name in SCENES} | {"controller": write_controller(folder)}


def link(folder: Path, system: str) -> Path:
    """Compile all sources of a folder with warnings as errors, for this system where none is named."""
    compiler = require_compiler("zig")
    program = folder / f"example-{system}{'.exe' if 'windows' in system else ''}"
    words = ["-target", system] if system else []
    options = ["-std=c99", "-O1", "-ffp-contract=off", *STRICT, "-Wshadow"]
    sources = sorted(path.name for path in folder.glob("*.c"))
    command = [sys.executable, "-m", "ziglang", "cc", *words, *options, *sources, "-lm", "-o", program.name]
    run(command, folder, compiler)
    return program


@pytest.mark.parametrize("name", [*SCENES, "controller"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_the_example_program_is_linked_without_a_warning(
    system: str, name: str, folders: dict[str, Path]
) -> None:
    start = link(folders[name], system).read_bytes()[:4]
    assert start.startswith(next(mark for word, mark in MARKS.items() if word in system))


def is_close(ours: str, theirs: str) -> bool:
    try:
        return math.isclose(float(ours), float(theirs), rel_tol=1e-6, abs_tol=1e-9)
    except ValueError:
        return ours == theirs


@pytest.mark.parametrize("name", [*SCENES, "controller"])
@pytest.mark.parametrize("system", [system for system, (program, _) in SYSTEMS.items() if program])
def test_the_example_program_prints_what_it_prints_here(
    system: str, name: str, folders: dict[str, Path]
) -> None:
    emulator = require(*SYSTEMS[system])
    prefix = {"WINEPREFIX": str(folders[name] / "prefix"), "WINEDEBUG": "-all"} if emulator == "wine" else {}
    here = run([str(link(folders[name], ""))], folders[name]).stdout
    there = run([emulator, str(link(folders[name], system))], folders[name], **prefix).stdout
    pairs = list(zip(here.split(), there.split(), strict=True))
    assert len(pairs) > 20
    assert [pair for pair in pairs if not is_close(*pair)] == []
