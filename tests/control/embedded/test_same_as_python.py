"""Controllers in C compute what simulated loops compute, to rounding."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.cases import thorough
from tests.codegen.quickly import without_optimisation
from tests.control.embedded.replay import check_same, replay, replay_states
from tests.control.feedback.pinned_prism import design_gains, draw_errors
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_estimator,
    design_tower_gains,
    draw_tower_errors,
    move_tower,
)


def test_a_noisy_loop_of_the_prism(
    bundle: ControllerBundle, model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    run = simulate_control(
        model,
        motion,
        gains.at_knots(),
        estimator=estimator,
        t_end=1.5,
        disturbance=draw_errors(model, 1, 1),
    )
    done = replay(bundle.load(), run, motion, estimator, 1)
    check_same(done, run, motion)
    assert {"ok", "rate_limited"} <= set(done.statuses)
    structure = model.structure
    assert structure is not None
    first = [item.members[0] for item in structure.actuators]
    np.testing.assert_allclose(done.rest_length, structure.rest_length[first] + done.command, rtol=1e-14)


@pytest.mark.parametrize("known", [True, *thorough(False)])
def test_delays_within_and_beyond_a_sample(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator, known: bool, tmp_path: Path
) -> None:
    delay = [0.0, 0.002, 0.005, 0.008, 0.0, 0.002, 0.005, 0.0, 0.0]
    if known:
        gains = design_gains(model, motion, delay=delay)
    with without_optimisation():
        bundle = build_controller(
            model,
            motion,
            gains,
            estimator=estimator,
            limits=ActuatorLimits(delay=delay),
            out=tmp_path / "ctl",
        )
    run = simulate_control(
        model,
        motion,
        gains.at_knots(),
        estimator=estimator,
        t_end=0.5,
        disturbance=Disturbance(seed=2),
        limits=ActuatorLimits(delay=delay),
    )
    check_same(replay(bundle.load(), run, motion, estimator, 2), run, motion)


def test_the_true_state_without_estimator_and_all_gains(
    model: CompiledModel, motion: Motion, gains: Gains, tmp_path: Path
) -> None:
    """The last actuator's range ends half-way on its path."""
    limits = np.tile([0.1, 0.5], (9, 1))
    start, end = motion.rest_length[0, 8], motion.rest_length[-1, 8]
    limits[8, int(end > start)] = 0.5 * (start + end)
    wide = {"limits": ActuatorLimits(range=limits)}
    with without_optimisation():
        bundle = build_controller(
            model, motion, gains, code=ControllerCode(knots=None), out=tmp_path / "ctl", **wide
        )
    run = simulate_control(model, motion, gains, t_end=1.5, disturbance=draw_errors(model, 3), **wide)
    done = replay_states(bundle.load(), run)
    check_same(done, run, motion)
    assert {"range_limited", "rate_limited"} <= set(done.statuses)
    assert not any(name.endswith("_model.c") for name in bundle.files)


@pytest.mark.thorough
def test_25_stored_gains_end_as_all_of_them(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    errors = draw_errors(model, 0)
    ends = [
        simulate_control(model, motion, item, t_end=3.0, disturbance=errors).worst_error(0.5)
        for item in (gains, gains.at_knots(25))
    ]
    assert len(gains.at_knots(25).time) == 25
    assert gains.at_knots(25).at(37) != pytest.approx(gains.at(37), rel=1e-12)
    assert ends[1] == pytest.approx(ends[0], rel=1e-2)
    assert gains.at_knots(1000) is gains


@pytest.mark.thorough
def test_a_noisy_loop_of_the_tower(tmp_path: Path) -> None:
    model = build_tower()
    motion = move_tower(model)
    gains = design_tower_gains(model, motion)
    estimator = design_tower_estimator(model, motion)
    bundle = build_controller(model, motion, gains, estimator=estimator, out=tmp_path / "ctl")
    run = simulate_control(
        model,
        motion,
        gains.at_knots(),
        estimator=estimator,
        t_end=7.0,
        disturbance=draw_tower_errors(model, 1, 1),
    )
    check_same(replay(bundle.load(), run, motion, estimator, 1), run, motion)
