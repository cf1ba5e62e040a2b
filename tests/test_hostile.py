"""Files and conditions made to break readers end in an error that says what is wrong, or in a result.

benchmarks/hostile.py runs hundreds of them under limits of time and memory.
"""

import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition import build_condition
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.system.errors import TensegrityError
from tests.cases import draws
from tests.hostile import Case, conditions, scenes, structures, tables
from tests.models import load
from tests.runtime.build import make_structure, spring

FEW = draws(5)


def read(case: Case) -> None:
    """Read a case as the command line does; errors made for users are fine."""
    files, words = case
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name, _ in files]
        for path, (_, content) in zip(paths, files, strict=True):
            path.write_bytes(content)
        with suppress(TensegrityError):
            if words[0] == "check":
                load_scene(paths[0])
            else:
                read_files([Path(folder) / word for word in words[1 : words.index("-o")]])


@FEW
@given(case=scenes())
def test_hostile_scenes(case: Case) -> None:
    read(case)


@pytest.mark.thorough
@FEW
@given(case=tables())
def test_hostile_tables(case: Case) -> None:
    read(case)


@FEW
@given(case=structures())
def test_hostile_structures(case: Case) -> None:
    read(case)


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = make_structure(
        [[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz"}, mass=0.1, axes="x"
    )
    return load(structure, *SIMULATION_QUANTITIES, "member_length")


@draws(50)
@given(text=conditions())
def test_hostile_conditions(model: CompiledModel, text: str) -> None:
    with suppress(TensegrityError):
        value = build_condition(text, model)(0.0, model.nominal("coordinate"), model.nominal("velocity"))
        assert abs(value) < float("inf")
