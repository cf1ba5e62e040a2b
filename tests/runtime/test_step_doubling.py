"""A fixed step is held to runs with twice and with half the step."""

from __future__ import annotations

import numpy as np
import pytest

from tensegrity_codegen.pipeline import SIMULATION_QUANTITIES, build_library
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.simulate import simulate
from tests.common_prism import POSITION, common_prism


@pytest.fixture(scope="module")
def prism() -> CompiledModel:
    request = ModelRequest(SIMULATION_QUANTITIES, formulation="rigid_bar", integrators=("rk4",))
    return build_library(common_prism(), request).load()


def test_where_twice_the_step_is_of_no_use_half_of_it_decides(prism: CompiledModel) -> None:
    """At 20 ms the common prism is lost through its kinks; at 10 ms it is 4e-5 m off."""
    run = simulate(prism, 5.0, samples=6, method="rk4", step=0.01)
    error = np.abs(run.node_position[1:].reshape(5, -1) - POSITION).max()
    assert 1e-6 < error < 1e-4
    assert run.status == "ok"
    assert run.error_estimate is not None
    assert run.error_estimate < 1.0


def test_a_step_that_loses_the_motion_is_inaccurate(prism: CompiledModel) -> None:
    run = simulate(prism, 5.0, samples=6, method="rk4", step=0.1)
    assert np.abs(run.node_position[1:].reshape(5, -1) - POSITION).max() > 0.01
    assert run.status == "inaccurate"
    assert "smaller step" in run.message
