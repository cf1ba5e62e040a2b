"""The pinned prism with motion, gains, estimator and controller in C, made once."""

import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.codegen.quickly import without_optimisation
from tests.control.feedback.pinned_prism import build_prism, design_gains, move_prism


@pytest.fixture(scope="session")
def model() -> CompiledModel:
    return build_prism()


@pytest.fixture(scope="session")
def motion(model: CompiledModel) -> Motion:
    return move_prism(model)


@pytest.fixture(scope="session")
def gains(model: CompiledModel, motion: Motion) -> Gains:
    return design_gains(model, motion)


@pytest.fixture(scope="session")
def estimator(model: CompiledModel, motion: Motion) -> Estimator:
    return design_kalman(model, motion, sample=0.005)


@pytest.fixture(scope="session")
def bundle(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    estimator: Estimator,
    tmp_path_factory: pytest.TempPathFactory,
) -> ControllerBundle:
    folder = tmp_path_factory.mktemp("controller") / "ctl"
    with without_optimisation():
        return build_controller(model, motion, gains, estimator=estimator, out=folder)
