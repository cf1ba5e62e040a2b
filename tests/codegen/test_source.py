"""Files of a library with many constants: tables in a file of their own, and no second copy for CasADi."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen import source
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.system.errors import NonFiniteError
from tests.codegen.build_c import STRICT, run, write_files
from tests.codegen.compilers import EACH_FAMILY, chosen_compiler, require_compiler
from tests.codegen.subjects import bare, everything

pytestmark = pytest.mark.optimised

STANDARD = ("-std=c99", "-O2", "-ffp-contract=off")


@pytest.fixture(scope="module")
def apart() -> GeneratedSource:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "MAX_CONSTANTS", 0)
        return emit(*everything())


def test_few_constants_stay_in_the_source() -> None:
    files = emit(*bare()).files
    assert [name for name in files if name.endswith(".c")] == [f"{bare()[0].name}.c", "example.c"]


@pytest.mark.thorough
def test_many_constants_have_a_file_of_their_own(apart: GeneratedSource) -> None:
    name = apart.manifest.name
    code, tables = apart.files[f"{name}.c"], apart.files[f"{name}_tables.c"]
    for array in ("_nominal_coordinate[", "_coordinate_axis[", "_tangent_stiffness_row["):
        assert f"{name}{array}" not in code
        assert f"{name}{array}" in tables
    assert "_kernel(" not in tables
    whole = emit(*everything()).files
    assert f"{name}_tables.c" not in whole
    parts = (code + tables[tables.index('.h"') + 3 :]).replace(f"#define {name.upper()}_WITHOUT_NAMES\n", "")
    assert sorted(whole[f"{name}.c"].split()) == sorted(parts.split())  # nothing is lost or there twice
    assert whole["manifest.json"] == apart.files["manifest.json"]


@pytest.mark.thorough
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_both_files_are_c99_without_a_warning(apart: GeneratedSource, family: str, tmp_path: Path) -> None:
    compiler = require_compiler(family)
    folder = write_files(tmp_path / "out", apart.files)
    for file in (f"{apart.manifest.name}.c", f"{apart.manifest.name}_tables.c"):
        run([*compiler.command, *STANDARD, *STRICT, "-c", file, "-o", "a.o"], folder, compiler)


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_makefile_knows_both_files(apart: GeneratedSource, tmp_path: Path) -> None:
    one = write_files(tmp_path / "one", emit(*everything()).files)
    two = write_files(tmp_path / "two", apart.files)
    printed = []
    for folder in (one, two):
        run(["make", chosen_compiler(), "example", f"lib{apart.manifest.name}.so"], folder)
        printed.append(run([str(folder / "example")], folder).stdout)
    assert printed[0] == printed[1]


@pytest.mark.thorough
def test_a_library_of_two_files_computes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    one = build_library(*everything()).load()
    monkeypatch.setattr(source, "MAX_CONSTANTS", 0)
    structure, request = everything()
    other = build_library(structure.with_changes(name="other"), request)
    assert any(name.endswith("_tables.c") for name in other.entry.files)
    model = other.load()
    for quantity in one.quantities:
        found, expected = model.compute(quantity), one.compute(quantity)
        if hasattr(found, "data") and hasattr(found, "indices"):
            found, expected = found.toarray(), expected.toarray()
        np.testing.assert_array_equal(found, expected)


@pytest.mark.thorough
def test_casadi_is_told_of_no_pattern_that_is_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    structure, request = everything()
    request = replace(request, interfaces=("casadi",))
    told = emit(structure, request).files[f"{structure.name}.c"]
    monkeypatch.setattr(source, "MAX_ENTRIES", 5)
    files = emit(structure, request).files
    short = files[f"{structure.name}.c"]
    for quantity, is_short in (("tangent_stiffness", False), ("acceleration", True)):
        symbol = f"int {structure.name}_{quantity}(const double **arg"
        assert symbol in told
        assert (symbol in short) is is_short
    assert f"{structure.name}_compute_tangent_stiffness(" in short


def test_zeros_at_the_end_of_constants_are_left_to_the_compiler() -> None:
    structure, request = bare()
    velocity = structure.node_velocity.copy()
    assert not velocity.any()
    library = build_library(structure, request.wanting("kinetic_energy"))
    text = (library.entry.folder / f"{structure.name}.c").read_text(encoding="utf-8")
    assert re.search(r"_nominal_velocity\[\d+\] = \{\s*0\.0\};", text)
    free = tuple(structure.coordinate_node_axis[1])
    velocity[free] = -0.5
    model = build_library(
        structure.with_changes(node_velocity=velocity), request.wanting("kinetic_energy")
    ).load()
    name = f"{structure.name}_nominal_velocity"
    model.library.ffi.cdef(f"extern const double {name}[{structure.n_coordinates}];")
    stored = list(model.library.symbol(name))
    assert stored == model.nominal("velocity").tolist()
    assert stored[1] == -0.5
    assert not any(stored[:1] + stored[2:])


def test_a_caller_who_vouches_for_his_numbers_gets_functions_without_checks() -> None:
    structure, request = bare()
    plain, bold = (replace(request, checks=checks, integrators=()) for checks in ("finite", "none"))
    text = emit(structure, bold).files[f"{structure.name}.c"]
    assert "all_finite" not in text
    assert "all_finite" in emit(structure, plain).files[f"{structure.name}.c"]
    model, checked = (build_library(structure, each).load() for each in (bold, plain))
    for spec in model.manifest.functions:
        np.testing.assert_array_equal(model.compute(spec.quantity), checked.compute(spec.quantity))
    name = "acceleration"
    lost = np.full_like(model.nominal("coordinate"), np.nan)
    assert np.isnan(model.compute(name, coordinate=lost)).all()
    with pytest.raises(NonFiniteError):
        checked.compute(name, coordinate=lost)
