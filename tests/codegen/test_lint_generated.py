"""Generated C of example scenes under clang-tidy and cppcheck, with the reason of every rule that is off."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.cases import thorough
from tests.codegen.build_c import run, write_files
from tests.codegen.plain_c.test_lint import CHECKS, require
from tests.codegen.subjects import everything

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
