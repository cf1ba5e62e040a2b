"""Loops over tables against CasADi's virtual machine on the symbolic model, bit for bit."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tests.cases import draws, thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters, everything
from tests.codegen.table.subjects import assert_equal_to_casadi, build_table, some_of
from tests.codegen.test_generated_c import arguments_near
from tests.random_structures import structures
from tests.test_golden import EXAMPLES

SLOW = draws(3)


@pytest.mark.thorough
@given(structures(most_nodes=8), st.sampled_from(["none", "all", "some"]), st.integers(0, 2**32 - 1))
@SLOW
def test_random_structures_equal_the_virtual_machine(
    structure: Structure, changeable: str, seed: int
) -> None:
    parameters = {} if changeable == "none" else all_parameters(structure)
    if changeable == "some":
        parameters = some_of(structure, parameters, seed)
    model, functions = build_table(structure, parameters)
    assert_equal_to_casadi(model, functions, arguments_near(model, seed))


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_every_compiler_gives_the_same_bits(family: str) -> None:
    require_compiler(family)
    structure, request = everything()
    model, functions = build_table(structure, request.parameters, compiler=family)
    for seed in range(3):
        assert_equal_to_casadi(model, functions, arguments_near(model, seed))


NODES = [path for path in EXAMPLES if isinstance(load_scene(path)[0], Structure)]
LARGE = [path for path in NODES if path.stem in ("icosahedron", "prism", "prism12", "tower")]
SMALL = [path for path in NODES if path not in LARGE]


@pytest.mark.parametrize("scene", [*SMALL, *thorough(*LARGE)], ids=lambda path: path.stem)
def test_the_shipped_structures_equal_the_virtual_machine(scene: Path) -> None:
    structure, request = load_scene(scene)
    assert isinstance(structure, Structure)
    model, functions = build_table(structure, request.parameters)
    assert_equal_to_casadi(model, functions, arguments_near(model, 3))
