"""Code of loops over tables: as long for a thousand members as for a hundred; bad values are a status."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import run, write_files
from tests.codegen.table.subjects import served
from tests.codegen.test_generated_c import raw_call
from tests.runtime.build import bar, cable, make_structure

REFERENCE = FLAG_SETS["reference"].options
REQUEST = ModelRequest((), parameters={"rest_length": (3, 4, 5)}, emitter="table")


def tower(levels: int) -> Structure:
    """A tower of triangles on three anchors, nine members a level, no two levels alike."""
    rng = np.random.default_rng(levels)
    angle = 2 * np.pi * np.arange(3) / 3
    position, members = [], []
    for level in range(levels + 1):
        turned = angle + 0.5 * level
        position += np.column_stack([np.cos(turned), np.sin(turned), np.full(3, 0.9 * level)]).tolist()
    for level in range(levels):
        own, above = 3 * level, 3 * level + 3
        for k in range(3):
            members.append(bar(own + k, above + (k + 1) % 3, 1.9, rng.uniform(900, 1100)))
            members.append(cable(own + k, above + k, 0.9, rng.uniform(90, 110)))
            members.append(cable(above + k, above + (k + 1) % 3, 1.6, 0.0, axial=rng.uniform(90, 110)))
    mass = rng.uniform(1, 2, len(position))
    return make_structure(position, members, anchored=dict.fromkeys(range(3), "xyz"), mass=mass)


def code_bytes(levels: int, folder: Path) -> int:
    """Return the bytes of machine code, constants aside, of everything that is served."""
    structure, compiler = tower(levels), find_compiler()
    source = emit(structure, REQUEST.wanting(*served(structure, REQUEST)))
    write_files(folder, source.files)
    run([*compiler.command, *REFERENCE, "-O1", "-c", "small.c", "-o", "small.o"], folder, compiler)
    sections = run(["size", "-A", "small.o"], folder).stdout.splitlines()
    return sum(int(line.split()[1]) for line in sections if line.startswith(".text"))


@pytest.mark.thorough
@pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("size") is None, reason="reads the sections of ELF objects"
)
def test_code_does_not_grow_with_the_structure(tmp_path: Path) -> None:
    few, many = code_bytes(31, tmp_path / "few"), code_bytes(111, tmp_path / "many")
    assert 0.9 * few < many < 1.1 * few


def test_values_that_are_not_finite_are_a_status_everywhere() -> None:
    structure = tower(1)
    model = build_library(structure, REQUEST.wanting(*served(structure, REQUEST))).load()
    seen = 0
    for spec in model.manifest.functions:
        for name in spec.arguments:
            for value in (np.nan, np.inf):
                changed = model.nominal(name).copy()
                changed.flat[-1] = value
                status, result = raw_call(model, spec.quantity, **{name: changed})
                assert status == "non_finite_input"
                assert np.isnan(result).all()
                seen += 1
    assert seen > 20


def test_nodes_that_coincide_are_a_status() -> None:
    structure = tower(2)
    model = build_library(structure, REQUEST.wanting("acceleration", "tangent_stiffness")).load()
    for quantity in ("acceleration", "tangent_stiffness"):
        status, result = raw_call(model, quantity, coordinate=np.zeros(structure.n_coordinates))
        assert status == "non_finite_result"
        assert np.isnan(result).all()
