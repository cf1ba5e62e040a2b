"""Values by the names of nodes and members: the same numbers as by index, and near names for unknown ones."""

import numpy as np
import pytest

from tensegrity_codegen import PlanResult, find_equilibrium, simulate, simulate_batch
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import UnknownNameError
from tensegrity_codegen.system.summaries import ByName, find_row
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import make_structure, spring


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    members = [spring(0, 1, 0.9), spring(1, 2, 0.8)]
    held = {0: "xyz", 2: "xyz"}
    structure = make_structure([[0, 5, 0], [1, 5, 0], [2, 5, 0.5]], members, anchored=held)
    wanted = want_analyses(structure, ModelRequest(()), ("simulate", "simulate_batch", "equilibrium"))
    return build_library(structure, wanted).load()


def test_values_by_name_are_those_by_index(model: CompiledModel) -> None:
    run = simulate(model, t_end=0.1, samples=4)
    starts = [model.nominal("coordinate").ravel()] * 3
    batch = simulate_batch(model, t_end=0.1, samples=4, coordinate=starts)
    for motion, leading in ((run, (4,)), (batch, (3, 4)), (batch[1], (4,))):
        for k, node in enumerate(motion.node_name):
            assert motion.position(node).shape == (*leading, 3)
            np.testing.assert_array_equal(motion.position(node), motion.node_position[..., k, :])
            np.testing.assert_array_equal(motion.velocity_of(node), motion.node_velocity[..., k, :])
        for k, member in enumerate(motion.member_name):
            assert motion.tension(member).shape == leading
            np.testing.assert_array_equal(motion.tension(member), motion.member_tension[..., k])
    found = find_equilibrium(model)
    for k, node in enumerate(found.node_name):
        np.testing.assert_array_equal(found.position(node), found.node_position[k])
    for k, member in enumerate(found.member_name):
        assert found.tension(member) == found.member_tension[k]


def test_results_know_their_structure(model: CompiledModel) -> None:
    run = simulate(model, t_end=0.1, samples=4)
    assert run.structure is model.structure
    assert find_equilibrium(model).structure is model.structure
    assert issubclass(PlanResult, ByName)
    alone = CompiledModel(model.path, model.manifest)
    assert simulate(alone, t_end=0.1, samples=4).structure is None


@pytest.mark.parametrize("wrong", ["verticall1", "", "bar1 ", "Bar1", "x" * 10_000, "ä"])
def test_an_unknown_name_is_an_error_with_near_names(wrong: str) -> None:
    names = ("bar1", "bar2", "vertical1")
    with pytest.raises(UnknownNameError) as caught:
        find_row(wrong, names, "member")
    assert caught.value.allowed == "the names of the 3 members"
    assert len(str(caught.value)) < 600
    if wrong == "verticall1":
        assert "'vertical1'" in caught.value.hint
    with pytest.raises(UnknownNameError, match="no node"):
        find_row(wrong, (), "node")
