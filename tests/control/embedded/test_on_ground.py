"""Controllers in C for a structure that stands on the ground: as in Python, and as the reference in NumPy."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest, hold_feet
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.actuator_bounds import find_bounds
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import Mpc, design_mpc
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tests.codegen.quickly import without_optimisation
from tests.control.embedded.mpc_reference import ReferenceMpc
from tests.control.feedback.standing_prism import CABLES, Q, R, build_standing
from tests.models import load

PUSH = Disturbance(gust=Gust("t1", (0.2, 0.0, 0.0), 0.1, 0.1), seed=3)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    return build_standing(tmp_path_factory.mktemp("standing"))


@pytest.fixture(scope="module")
def stands(standing: CompiledModel) -> Equilibrium:
    return find_equilibrium(standing)


@pytest.fixture(scope="module")
def ahead(standing: CompiledModel, stands: Equilibrium) -> Mpc:
    return design_mpc(standing, stands, Q, R, horizon=8)


def test_loops_in_c_are_those_in_python(standing: CompiledModel, stands: Equilibrium) -> None:
    """From noisy lengths, with a gust under which feet stick, and one under which they slip."""
    sensors = [Sensor("member_length", CABLES, 1e-4)]
    estimator = design_kalman(standing, stands, sensors, disturbance=0.02, only_observable=True)
    gains = design_lqr(standing, stands, Q, 100.0 * R)
    strong = Disturbance(gust=Gust("t1", (1.0, 0.0, 0.0), 0.1, 0.1), seed=3)
    with without_optimisation():
        runs = simulate_control_batch(
            standing, stands, gains, draws=[PUSH, strong], estimator=estimator, t_end=0.5
        )
    for run, draw in zip(runs, (PUSH, strong), strict=True):
        expected = simulate_control(standing, stands, gains, estimator=estimator, disturbance=draw, t_end=0.5)
        np.testing.assert_allclose(run.coordinate, expected.coordinate, atol=1e-9)
        np.testing.assert_allclose(run.slip, expected.slip, atol=1e-9)
        assert run.warnings == expected.warnings
    assert [len(run.warnings) for run in runs] == [0, 1]


def test_predictions_in_c_are_those_of_the_reference(
    standing: CompiledModel, stands: Equilibrium, ahead: Mpc, tmp_path: Path
) -> None:
    """Commands over three samples from states near the equilibrium, where feet stick, slip and lift."""
    rest = build_rest(standing, stands)
    assert standing.structure is not None
    held = load(
        hold_feet(standing.structure, standing, rest),
        *("acceleration", "state_jacobian", "input_jacobian", "member_length", "equilibrium_matrix"),
    )
    with without_optimisation():
        controller = build_controller(standing, rest, ahead, out=tmp_path / "ahead").load()
    controller.init()
    reference = ReferenceMpc(held, rest, ahead, find_bounds(standing, rest))
    rng = np.random.default_rng(0)
    for k, size in enumerate((1e-6, 1e-4, 1e-3)):
        state = np.concatenate([stands.coordinate + size * rng.normal(size=18), size * rng.normal(size=18)])
        controller.step_state(0.005 * k, state)
        command, _ = reference.step(0.005 * k, state)
        np.testing.assert_allclose(list(controller._memory.command), command, atol=1e-10)


@pytest.mark.thorough
def test_prediction_brings_back_feet_that_gains_let_slip(
    standing: CompiledModel, stands: Equilibrium
) -> None:
    strong = Disturbance(gust=Gust("t1", (2.0, 0.0, 0.0), 0.1, 0.1))
    draws = [PUSH, strong]
    runs = simulate_control_batch(
        standing, stands, design_mpc(standing, stands, Q, R), draws=draws, t_end=1.0
    )
    assert [run.status for run in runs] == ["ok", "ok"]
    without, held = (
        [simulate_control(standing, stands, item, disturbance=draw, t_end=1.0) for draw in draws]
        for item in (None, design_lqr(standing, stands, Q, R))
    )
    assert runs[0].worst_error(0.2) < 0.2 * without[0].worst_error(0.2)
    assert runs[0].warnings == ()
    assert runs[1].worst_error(0.2) < 0.4 * without[1].worst_error(0.2)
    assert held[1].worst_error(0.2) > without[1].worst_error(0.2)
    assert "b2 lifts" in runs[1].warnings[0]
