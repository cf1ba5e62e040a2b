"""The pinned prism of 12 cables, its motion and its gains, made once for the tests of each file."""

import pytest

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.control.feedback.pinned_prism import build_prism, design_gains, move_prism


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build_prism()


@pytest.fixture(scope="module")
def motion(model: CompiledModel) -> Motion:
    return move_prism(model)


@pytest.fixture(scope="module")
def gains(model: CompiledModel, motion: Motion) -> Gains:
    return design_gains(model, motion)
