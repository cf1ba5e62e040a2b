"""Libraries for other machines give the numbers of this one; where they cannot be run, they are linked."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.targets import TARGETS, WASM_STACK, find_host, library_file_name
from tests.codegen.build_c import run
from tests.codegen.compilers import require_compiler
from tests.codegen.other_machines import Numbers, compare, in_c, in_qemu, in_wasm, in_wine, require
from tests.codegen.subjects import everything

# Zig compiles the C library of each machine the first time, for minutes where the processor is shared.
pytestmark = [pytest.mark.thorough, pytest.mark.optimised, pytest.mark.timeout(1800)]

ROOT = Path(__file__).resolve().parent.parent.parent
Run = Callable[..., Numbers]
RUNS: dict[str, Run] = {"aarch64-linux": in_qemu, "thumbv7em": in_qemu, "wasm32": in_wasm}
# Rounding differs where a C library computes a power or a sine of its own; sums amplify it.
BOUND = {"double": 1e-12, "single": 1e-3}


@pytest.fixture(scope="module")
def subject() -> tuple[Structure, ModelRequest]:
    require_compiler("zig")
    return everything()


@pytest.mark.parametrize("name", RUNS)
def test_every_function_gives_the_numbers_of_this_machine(
    name: str, subject: tuple[Structure, ModelRequest], tmp_path: Path
) -> None:
    built = build_library(*subject, target=name)
    folder = built.export(tmp_path / "library")
    assert built.manifest.target == name
    with pytest.raises(LibraryError, match="compiled for another machine"):
        built.load()
    there, here = RUNS[name](folder, built.manifest), in_c(folder, built.manifest)
    assert {call: error for call, error in compare(here, there).items() if error > BOUND["double"]} == {}


@pytest.mark.parametrize("name", RUNS)
def test_single_precision_gives_the_numbers_of_this_machine(
    name: str, subject: tuple[Structure, ModelRequest], tmp_path: Path
) -> None:
    structure, request = subject
    narrow = replace(
        request.wanting("acceleration", "member_tension", integrators=("rk4",)), precision="single"
    )
    built = build_library(structure, narrow, target=name)
    folder = built.export(tmp_path / "library")
    there, here = RUNS[name](folder, built.manifest), in_c(folder, built.manifest)
    assert {call: error for call, error in compare(here, there).items() if error > BOUND["single"]} == {}


@pytest.mark.parametrize("name", [name for name in TARGETS if name not in RUNS])
def test_a_library_of_the_other_machines_is_linked(
    name: str, subject: tuple[Structure, ModelRequest], tmp_path: Path
) -> None:
    built = build_library(*subject, target=name)
    folder = built.export(tmp_path / "library", wheel=bool(TARGETS[name].wheel_tag))
    assert [path.name for path in folder.glob(f"*-py3-none-{TARGETS[name].wheel_tag}.whl")]
    path = folder / library_file_name("braced", TARGETS[name])
    assert describe_binary(path.read_bytes()) == TARGETS[name].binary
    if name == find_host():
        assert built.load().has("acceleration")


def test_the_library_of_windows_runs_under_wine(
    subject: tuple[Structure, ModelRequest], tmp_path: Path
) -> None:
    require("wine", "wine")
    built = build_library(*subject, target="x86_64-windows")
    folder = built.export(tmp_path / "library")
    there, here = in_wine(folder, built.manifest), in_c(folder, built.manifest)
    assert {call: error for call, error in compare(here, there).items() if error > BOUND["double"]} == {}


@pytest.mark.parametrize("name", ["aarch64-linux", "x86_64-linux"])
def test_a_library_of_linux_needs_no_newer_c_library_than_its_wheel_tag_says(
    name: str, subject: tuple[Structure, ModelRequest]
) -> None:
    data = build_library(*subject, target=name).path.read_bytes()
    versions = {tuple(map(int, found.split(b"."))) for found in re.findall(rb"GLIBC_([\d.]+)", data)}
    assert max(versions, default=(2, 0)) <= (2, 17)


def test_each_target_has_a_library_of_its_own_in_the_cache(subject: tuple[Structure, ModelRequest]) -> None:
    request = ModelRequest(("member_tension",))
    first = build_library(subject[0], request, target="thumbv7em")
    again = build_library(subject[0], request, target="thumbv7em")
    here = build_library(subject[0], request)
    assert again.from_cache
    assert again.entry.key == first.entry.key != here.entry.key
    assert here.manifest.target == ""


def test_the_page_calls_the_module_from_javascript(tmp_path: Path) -> None:
    require_compiler("zig")
    node = require("node", "nodejs")
    (tmp_path / "prism.toml").write_text(list_examples()["prism"], encoding="utf-8")
    structure, request = load_scene(tmp_path / "prism.toml")
    folder = build_library(structure, request, target="wasm32").export(tmp_path / "library")
    (script,) = re.findall(r"```js\n(.*?)```", (ROOT / "docs/machines.md").read_text(encoding="utf-8"), re.S)
    (folder / "page.mjs").write_text(script, encoding="utf-8")
    printed = [float(word) for word in run([node, "page.mjs"], folder).stdout.split()]
    expected = build_library(structure, request).load().compute("member_tension")
    np.testing.assert_allclose(printed, expected, rtol=1e-12, atol=1e-12)


def test_the_page_states_the_memory_of_the_module() -> None:
    assert f"0 to {WASM_STACK:,}" in (ROOT / "docs/machines.md").read_text(encoding="utf-8")
