"""A fixed step is held to runs with twice and with half the step."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tests.common_prism import POSITION, common_prism
from tests.models import simulator
from tests.runtime.build import bar, make_structure


@pytest.fixture(scope="module")
def prism() -> CompiledModel:
    return simulator(common_prism(), "rk4", formulation="rigid_bar")


def test_where_twice_the_step_is_of_no_use_half_of_it_decides(prism: CompiledModel) -> None:
    """At 20 ms the common prism is lost through its kinks; at 10 ms it is 4e-5 m off."""
    run = simulate(prism, 5.0, samples=6, method="rk4", stepping=Stepping(step=0.01))
    error = np.abs(run.node_position[1:].reshape(5, -1) - POSITION).max()
    assert 1e-6 < error < 1e-4
    assert run.status == "ok"
    assert run.error_estimate is not None
    assert run.error_estimate < 1.0


def test_a_step_that_loses_the_motion_is_inaccurate(prism: CompiledModel) -> None:
    run = simulate(prism, 5.0, samples=6, method="rk4", stepping=Stepping(step=0.1))
    assert np.abs(run.node_position[1:].reshape(5, -1) - POSITION).max() > 0.01
    assert run.status == "inaccurate"
    assert "smaller step" in run.message


def test_a_vibration_that_steps_lose_is_not_taken_for_followed() -> None:
    """A stiff bar that is stretched at the start: with w h = 0.8 its vibration fades, with 1.6 at once."""
    structure = make_structure([[0, 0, 0], [0, 0, 1.0]], [bar(0, 1, 0.9, mu=1e6)], anchored={0: "xyz"})
    model = simulator(structure, "rk4")
    for reach, status in ((0.8, "inaccurate"), (0.05, "ok")):
        found = simulate(model, 1.0, samples=3, method="rk4", stepping=Stepping(step=reach / 1000.0))
        error = np.abs(found.node_velocity[1:, 1, 2] + 100.0 * np.sin(1000.0 * found.time[1:])).max()
        assert found.status == status
        assert (error > 1.0) == (status == "inaccurate")
