"""Simulated loops in C have the numbers of simulate_control: noise, gusts, delays, sensors of all kinds."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError
from tests.codegen.quickly import without_optimisation
from tests.control.feedback.pinned_prism import draw_errors
from tests.control.feedback.tower_motion import (
    build_tower,
    design_tower_estimator,
    design_tower_gains,
    draw_tower_errors,
    move_tower,
)

DELAY = [0.0, 0.002, 0.005, 0.008, 0.0, 0.002, 0.005, 0.0, 0.0]
FIELDS = ("coordinate", "velocity", "command", "input", "member_tension", "estimate", "disturbance")


@pytest.fixture(scope="module", autouse=True)
def quickly() -> Iterator[None]:
    with without_optimisation():
        yield


def check_same(found: ControlRun, expected: ControlRun, tolerance: float = 1e-9) -> None:
    """Check that two runs are equal, in multiples of the largest number of each array."""
    assert (found.status, found.step_status) == (expected.status, expected.step_status)
    assert found.message == expected.message
    np.testing.assert_allclose(found.time, expected.time, rtol=1e-14)
    for name in FIELDS:
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            scale = max(float(np.abs(theirs).max(initial=0.0)), 1e-3)
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * scale, err_msg=name)


def test_a_noisy_loop_with_delays_gusts_and_errors(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    """The second draw has two gusts that begin and end within samples, the third no error at all."""
    gusts = [Gust("bar1_B", (0.0, 2.0, -4.0), 0.1013, 0.0504), Gust("bar2_B", (1.0, 0.0, 0.0), 0.12, 0.2)]
    draws = [
        draw_errors(model, 1, 1),
        Disturbance(gust=gusts, velocity_error=np.full(6, 0.05), seed=2),
        Disturbance(),
    ]
    options: dict[str, Any] = {"estimator": estimator, "t_end": 0.6, "limits": ActuatorLimits(delay=DELAY)}
    found = simulate_control_batch(model, motion, gains, draws=draws, threads=2, **options)
    for run, draw in zip(found, draws, strict=True):
        check_same(run, simulate_control(model, motion, gains.at_knots(), **options, disturbance=draw))
    assert {"ok", "rate_limited"} <= set(found[0].step_status)
    alone = simulate_control_batch(model, motion, gains, draws=draws[1:2], threads=1, **options)
    np.testing.assert_array_equal(alone[0].coordinate, found[1].coordinate)


@pytest.mark.parametrize("is_open", [True, False])
def test_open_loops_and_true_states(
    model: CompiledModel, motion: Motion, gains: Gains, is_open: bool
) -> None:
    chosen, draw = None if is_open else gains, draw_errors(model, 2)
    load = np.zeros_like(model.nominal("node_load"))
    load[model.manifest.node_name.index("bar3_B"), 2] = -0.4
    draws = [draw, Disturbance(arguments={"node_load": load})]
    found = simulate_control_batch(
        model,
        motion,
        chosen,
        draws=draws,
        code=ControllerCode(knots=None),
        t_end=0.7,
        limits=ActuatorLimits(rate=0.05),
    )
    for run, item in zip(found, draws, strict=True):
        check_same(
            run,
            simulate_control(
                model, motion, chosen, t_end=0.7, limits=ActuatorLimits(rate=0.05), disturbance=item
            ),
        )
        assert run.estimate is None


def test_sensors_of_all_kinds(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    first, second, third = (model.manifest.node_name.index(f"bar{k}_B") for k in (1, 2, 3))
    sensors = (
        Sensor("member_tension", (3, 8), 0.05),
        Sensor("node_position", (first, second), 5e-4),
        Sensor("member_length", (5,), 5e-4),
        Sensor("node_position", (third,), 5e-4),
        Sensor("node_velocity", (third,), 1e-2),
    )
    estimator = design_kalman(model, motion, sensors, knots=3)
    draw = draw_errors(model, 4, 3)
    (found,) = simulate_control_batch(model, motion, gains, draws=[draw], estimator=estimator, t_end=0.4)
    check_same(
        found,
        simulate_control(model, motion, gains.at_knots(), estimator=estimator, t_end=0.4, disturbance=draw),
    )


def test_a_loop_that_goes_wrong_ends_with_a_status(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    """Without stiffness and with a heavy load the bars fall through singular angles: the other runs go on."""
    load = np.zeros_like(model.nominal("node_load"))
    load[model.manifest.node_name.index("bar1_B")] = [np.inf, 0.0, 0.0]
    with pytest.raises(NonFiniteError):
        simulate_control_batch(
            model, motion, gains, draws=[Disturbance(arguments={"node_load": load})], t_end=0.1
        )
    load[model.manifest.node_name.index("bar1_B")] = [1e300, 0.0, 0.0]
    draws = [Disturbance(arguments={"node_load": load}), Disturbance()]
    wrong, fine = simulate_control_batch(model, motion, gains, draws=draws, t_end=0.1)
    assert wrong.status == "unstable"
    assert len(wrong.time) == len(wrong.coordinate) == len(wrong.step_status) + 1
    assert np.isfinite(wrong.coordinate).all()
    assert fine.status == "ok"


def test_a_loop_that_is_worse_than_the_open_one_has_the_same_status(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    """Gains that know nothing of a delay of 30 ms."""
    options: dict[str, Any] = {"t_end": 0.8, "limits": ActuatorLimits(delay=0.03)}
    draw = draw_errors(model, 1)
    (found,) = simulate_control_batch(model, motion, gains, draws=[draw], **options)
    expected = simulate_control(model, motion, gains.at_knots(), **options, disturbance=draw)
    assert found.status == expected.status == "does_not_hold"
    assert found.warnings == expected.warnings
    assert "without feedback" in found.message


def test_lost_estimates_end_the_run(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    wild = replace(estimator, L=1e200 * estimator.L)
    draw = Disturbance(coordinate_error=np.full(6, 0.1), seed=1)
    (run,) = simulate_control_batch(model, motion, gains, draws=[draw], estimator=wild, t_end=1.0)
    assert run.status == "unstable"
    assert "the estimate is not finite" in run.message


@pytest.mark.parametrize(
    ("draw", "options", "error", "words"),
    [
        ({"seed": -1}, {}, InvalidValueError, r"draws\[0\].seed"),
        ({"coordinate_error": [0.0]}, {}, InvalidValueError, "coordinate_error"),
        ({"arguments": {"mass": 1.0}}, {}, UnknownNameError, "mass"),
        ({"gust": Gust("nowhere", (0, 0, 1))}, {}, UnknownNameError, "nowhere"),
        ({}, {"threads": 0}, InvalidValueError, "threads"),
        ({}, {"t_end": -1.0}, InvalidValueError, "t_end"),
        ({}, {"limits": ActuatorLimits(rate=1e-4)}, InvalidValueError, "too fast"),
        ({}, {"sample": 0.1}, InvalidValueError, "sample"),
    ],
)
def test_bad_input_is_named(
    model: CompiledModel,
    motion: Motion,
    gains: Gains,
    draw: dict[str, Any],
    options: dict[str, Any],
    error: type[Exception],
    words: str,
) -> None:
    with pytest.raises(error, match=words):
        simulate_control_batch(model, motion, gains, draws=[Disturbance(**draw)], **options)


def test_no_draws_are_no_runs(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    assert simulate_control_batch(model, motion, gains, draws=[]) == ()


@pytest.mark.thorough
def test_a_noisy_loop_of_the_tower() -> None:
    model = build_tower()
    motion = move_tower(model)
    gains = design_tower_gains(model, motion)
    estimator = design_tower_estimator(model, motion)
    draws = [draw_tower_errors(model, seed, seed) for seed in range(3)]
    options: dict[str, Any] = {"estimator": estimator, "t_end": 7.0}
    found = simulate_control_batch(model, motion, gains, draws=draws, **options)
    for run, draw in zip(found, draws, strict=True):
        check_same(run, simulate_control(model, motion, gains.at_knots(), **options, disturbance=draw))
