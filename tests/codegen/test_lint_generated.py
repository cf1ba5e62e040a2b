"""Generated C of example scenes under clang-tidy and cppcheck, with the reason of every rule that is off."""

import platform
import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import run, write_files
from tests.codegen.plain_c.test_lint import CHECKS, require
from tests.codegen.subjects import all_parameters, everything, offered
from tests.random_structures import AXES, make_structure

Files = dict[str, str]

SMALLEST = "two_nodes"
ENABLED = "warning,performance,portability"
# Rules of cppcheck that are off, and why.
OFF = {
    # --max-configs=1 checks what users compile, without macros that choose other parts; the combinations of
    # some 30 settings take minutes, and are never compiled.
    "toomanyconfigs": "information about the line above, no finding",
    # Settings of a scene are constants of its C, so that conditions on them have one result.
    "knownConditionTrueFalse": "conditions on settings",
}


def example(name: str) -> Callable[[Path], Files]:
    def make(folder: Path) -> Files:
        path = folder / f"{name}.toml"
        path.write_text(list_examples()[name], encoding="utf-8")
        return dict(emit(*load_scene(path)).files)

    return make


def with_everything(_: Path) -> Files:
    """Every quantity, all integrators, batches and the interface for CasADi."""
    structure, request = everything()
    integrators = (*request.integrators, "tsit5")
    wide = replace(request, batch_width=8, interfaces=("casadi",), integrators=integrators)
    return dict(emit(structure, wide).files)


def in_single_precision(folder: Path) -> Files:
    path = folder / "prism.toml"
    path.write_text(list_examples()["prism"], encoding="utf-8")
    structure, request = load_scene(path)
    return dict(emit(structure, replace(request, precision="single")).files)


MAKERS: dict[str, Callable[[Path], Files]] = {name: example(name) for name in list_examples()}
MAKERS |= {"everything": with_everything, "single": in_single_precision}
# Not under cppcheck: its analysis of values takes minutes for 1,100 lines without a branch, as in the
# accelerations of these; clang-tidy reads them.
LONG = ("svd_tower", "everything")
OTHERS = thorough(*(name for name in MAKERS if name != SMALLEST))
SHORT = thorough(*(name for name in MAKERS if name not in (SMALLEST, *LONG)))


@pytest.fixture
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_files(tmp_path / "made", MAKERS[request.param](tmp_path))


def units(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.c"))


@pytest.mark.parametrize("folder", [SMALLEST, *OTHERS], indirect=True)
def test_clang_tidy_finds_nothing_in_generated_code(folder: Path) -> None:
    tidy = [require("clang-tidy"), "--quiet", f"--checks={CHECKS}", "--warnings-as-errors=*"]
    run([*tidy, "--header-filter=.*", *units(folder), "--", "-std=c99"], folder)


@pytest.mark.parametrize("folder", [SMALLEST, *SHORT], indirect=True)
def test_cppcheck_finds_nothing_in_generated_code(folder: Path) -> None:
    off = [f"--suppress={name}" for name in OFF]
    command = [require("cppcheck"), "-q", "--std=c99", f"--enable={ENABLED}", "--max-configs=1", *off]
    run([*command, "--error-exitcode=1", *units(folder)], folder)


UNUSED = (
    "-Wall",
    "-Wextra",
    "-Wunused-macros",
    "-Wunused-const-variable",
    "-Wno-attributes",
    "-Werror",
    "-fsyntax-only",
)


def check_use(structure: Subject, request: ModelRequest, folder: Path) -> None:
    """Nothing in the C of a request is unused, for narrow and wide registers and without any."""
    files = emit(structure, request, account=False).files
    # Neither an attribute nor `inline` hides what is not used.
    files = {name: re.sub(r",? ?\bunused\b|(?<=static )inline\b", "", text) for name, text in files.items()}
    write_files(folder, files)
    flags: tuple[tuple[str, ...], ...] = ((), ("-DTENSEGRITY_NO_LANES",))
    if platform.machine() in ("x86_64", "AMD64"):
        flags = (*flags, ("-mavx2",), ("-mavx512f", "-mavx512dq"))
    # Loops of the emitter `table` name the nodes of members of which not all look at them.
    loops = ("-Wno-unused-variable",) * (request.emitter == "table")
    for options in flags:
        run(["cc", "-std=c99", *UNUSED, *loops, *options, *units(folder)], folder)


@pytest.mark.parametrize("name", list_examples())
@pytest.mark.parametrize("analyses", [(), ("simulate",)], ids=["build", "simulate"])
def test_nothing_is_unused_in_the_c_of_a_shipped_scene(
    name: str, analyses: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(list_examples()[name], encoding="utf-8")
    structure, request = load_scene(path)
    check_use(structure, want_analyses(structure, request, analyses), tmp_path)


@pytest.mark.parametrize("seed", [*range(4), *thorough(*range(4, 50))])
def test_nothing_is_unused_in_the_c_of_a_random_scene(seed: int, tmp_path: Path) -> None:
    chosen, rng = random.Random(seed), np.random.default_rng(seed)
    features = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")
    wants = {feature: chosen.random() < 0.5 for feature in features}
    structure = make_structure(rng, chosen.randint(2, 7), chosen.choice(AXES), wants)
    parameters = all_parameters(structure) if chosen.random() < 0.3 else {}
    # Quantities without an entry in this structure are none that can be requested.
    functions = offered(structure, ModelRequest((), parameters=parameters))
    request = ModelRequest(
        tuple(chosen.sample(sorted(functions), min(len(functions), chosen.randint(1, 4)))),
        parameters=parameters,
        emitter=chosen.choice(("table", "unrolled")),
        precision=chosen.choice(("double", "double", "single")),
        batch_width=chosen.choice((0, 0, 8)),
        flags=chosen.choice(("reference", "native")),
    )
    if chosen.random() < 0.5:
        methods = chosen.sample(("rk4", "rk54", "rk853"), chosen.randint(1, 2))
        request = request.wanting(*request.quantities, "acceleration", integrators=tuple(methods))
    try:
        check_use(structure, request, tmp_path)
    except FormulationError:  # the emitter `table` serves less
        check_use(structure, replace(request, emitter="unrolled"), tmp_path)
