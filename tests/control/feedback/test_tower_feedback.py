"""Feedback of the paper's two-stage tower: 18 motors, no torques, errors of the acceptance table."""

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import InvalidValueError
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_gains,
    draw_tower_errors,
    find_angles,
    move_tower,
)

pytestmark = pytest.mark.thorough

SAMPLE = 0.01


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return build_tower()


@pytest.fixture(scope="module")
def motion(model: CompiledModel) -> Motion:
    return move_tower(model)


@pytest.fixture(scope="module")
def gains(model: CompiledModel, motion: Motion) -> Gains:
    return design_tower_gains(model, motion)


def run_draw(
    model: CompiledModel, motion: Motion, seed: int, gains: Gains | None, noise: float = 0.0
) -> ControlRun:
    estimator: Estimator | None = None
    if noise:
        lengths = (Sensor("member_length", tuple(range(18)), noise),)
        estimator = design_kalman(model, motion, lengths, sample=SAMPLE)
    errors = draw_tower_errors(model, seed)
    return simulate_control(
        model, motion, gains, estimator=estimator, sample=SAMPLE, t_end=12.0, seed=seed, **errors
    )


def test_the_motion_has_the_tensions_of_the_paper(model: CompiledModel, motion: Motion) -> None:
    for row, printed in ((0, (26.11, 1.85, 18.38)), (-1, (46.97, 12.27, 43.00))):
        groups = motion.member_tension[row].reshape(3, 6)
        assert np.abs(groups - np.array(printed)[:, None]).max() < 0.02
    assert 0.0475 < motion.peak_rate.max() < 0.048


def test_a_motor_of_two_centimetres_a_second_is_too_slow(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    with pytest.raises(InvalidValueError, match="too fast for an actuator") as caught:
        simulate_control(model, motion, gains, rate=0.02)
    assert "needs 0.0475" in str(caught.value)


@pytest.mark.parametrize("seed", range(20))
def test_feedback_holds_the_tower(model: CompiledModel, motion: Motion, gains: Gains, seed: int) -> None:
    angles = find_angles(model)
    open_loop = run_draw(model, motion, seed, None)
    assert np.degrees(open_loop.worst_error(1.0, angles)) > 0.2
    for noise, bound in ((0.0, 0.06), (1e-4, 0.1), (5e-4, 0.25)):
        run = run_draw(model, motion, seed, gains, noise)
        assert run.status == "ok"
        assert np.degrees(run.worst_error(1.0, angles)) < bound
        assert run.least_tension(7.0).min() > 8.0
