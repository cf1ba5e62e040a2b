"""Presets: settings for a purpose, in scenes and on the command line."""

import json
from pathlib import Path

import pytest

from tensegrity_codegen import load_scene
from tensegrity_codegen.codegen.compilation.compile import read_stack_use
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.measure import measure_memory
from tensegrity_codegen.system.errors import SceneError, UnknownNameError
from tensegrity_codegen.tables.presets import PRESETS, find_preset
from tests.cases import thorough
from tests.codegen.build_c import run, write_files
from tests.codegen.compilers import require_compiler
from tests.doc_tables import check_table

ROOT = Path(__file__).resolve().parents[2]
PRISM = (ROOT / "tensegrity_codegen/scene/examples/prism.toml").read_text(encoding="utf-8")
MOST_CODE, MOST_STACK = 16 * 1024, 4 * 1024


def with_preset(folder: Path, name: str, more: str = "") -> Path:
    path = folder / "prism.toml"
    path.write_text(PRISM.replace("quantities = [", f'preset = "{name}"\n{more}quantities = [', 1), "utf-8")
    return path


@pytest.mark.parametrize("name", PRESETS)
def test_a_scene_gets_the_settings_of_its_preset(name: str, tmp_path: Path) -> None:
    _, request = load_scene(with_preset(tmp_path, name))
    for key, value in PRESETS[name].settings.items():
        assert getattr(request, key) == value


def test_keys_of_the_scene_come_first(tmp_path: Path) -> None:
    _, request = load_scene(with_preset(tmp_path, "mcu", 'flags = "reference"\n'))
    assert (request.precision, request.flags) == ("single", "reference")


def test_an_unknown_preset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="unknown preset") as caught:
        load_scene(with_preset(tmp_path, "mcv"))
    assert "model.preset" in caught.value.where
    assert "mcu" in caught.value.hint
    with pytest.raises(UnknownNameError, match="unknown preset"):
        find_preset("arduino")


def test_functions_in_single_precision_have_no_double(tmp_path: Path) -> None:
    compiler = require_compiler("gcc")
    structure, request = load_scene(with_preset(tmp_path, "f32"))
    files = emit(structure, request.wanting(*request.quantities)).files
    folder = write_files(tmp_path / "source", files)
    strict = ("-Wall", "-Wextra", "-Wdouble-promotion", "-Wunsuffixed-float-constants", "-Werror")
    run([*compiler.command, "-std=c99", "-O1", *strict, "-c", "prism.c", "-o", "prism.o"], folder, compiler)


@pytest.mark.parametrize("target", [None, *thorough("thumbv7em")])
def test_force_and_step_of_the_prism_fit_a_microcontroller(target: str | None, tmp_path: Path) -> None:
    if target is not None:
        pytest.importorskip("ziglang", reason="the package ziglang is not installed")
    structure, request = load_scene(with_preset(tmp_path, "mcu"))
    source = emit(structure, request.wanting("node_residual", "acceleration", integrators=("rk4",)))
    folder = write_files(tmp_path / "source", source.files)
    used = measure_memory(folder, source.manifest, target=target)
    assert used.code_bytes is not None
    assert 1000 < used.code_bytes <= MOST_CODE
    if used.stack_bytes:
        assert {"prism_compute_node_residual", "prism_integrate_rk4"} <= set(used.stack_bytes)
        assert 0 < max(used.stack_bytes.values()) <= MOST_STACK
    else:
        assert target is None, "zig states the stack of functions"


def test_stack_use_is_read_from_what_compilers_write() -> None:
    text = "a.c:3:5:f\t48\tstatic\na.c:9:12:g.constprop.0\t16\tdynamic,bounded\n\nbad line\n"
    assert read_stack_use(text) == {"f": 48, "g.constprop.0": 16}


def test_the_table_of_presets_is_written_from_the_records(update_golden: bool) -> None:
    rows = [
        (f"`{name}`", ", ".join(map(write_setting, preset.settings.items())), preset.title)
        for name, preset in PRESETS.items()
    ]
    check_table("machines.md", "presets", ("preset", "settings", "for"), rows, update_golden)


def write_setting(item: tuple[str, object]) -> str:
    key, value = item
    return f"`{key} = {json.dumps(list(value) if isinstance(value, tuple) else value)}`"
