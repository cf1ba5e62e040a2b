"""Closed loops with the true state: the prism under errors, sampled inputs, delays, rates."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import (
    Gust,
    Profile,
    design_kalman,
    design_lqr,
    plan,
    simulate,
    simulate_control,
    time_motion,
)
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import (
    ActuatorLimits,
    DelayedInputs,
    find_bounds,
)
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.control.feedback.pinned_prism import design_gains, draw_errors
from tests.control.feedback.structures import build_prism

Array = NDArray[np.float64]


def check_draw(model: CompiledModel, motion: Motion, gains: Gains, seed: int) -> None:
    errors = draw_errors(model, seed)
    open_loop = simulate_control(model, motion, t_end=3.0, disturbance=errors)
    assert open_loop.status == "ok"
    assert np.degrees(open_loop.worst_error(0.5)) > 1.0
    held = simulate_control(model, motion, gains, t_end=3.0, disturbance=errors)
    assert held.status == "ok"
    assert np.degrees(held.worst_error(0.5)) < 0.05
    assert held.least_tension(1.0).min() > 5.0
    step = np.abs(np.diff(held.command, axis=0)).max()
    assert step <= 0.1 * 0.005 + 1e-12


@pytest.mark.parametrize("seed", [0, *thorough(1)])
def test_feedback_holds_the_prism_where_open_loop_does_not(
    model: CompiledModel, motion: Motion, gains: Gains, seed: int
) -> None:
    check_draw(model, motion, gains, seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(2, 20))
def test_feedback_holds_the_prism_in_twenty_draws(
    model: CompiledModel, motion: Motion, gains: Gains, seed: int
) -> None:
    check_draw(model, motion, gains, seed)


def test_the_sampled_motion_is_that_of_simulate(model: CompiledModel, motion: Motion) -> None:
    """The same held inputs as a profile with jumps."""
    run = simulate_control(model, motion, sample=0.05, t_end=0.5)
    times = np.repeat(run.time, 2)[1:-1]
    values = {name: np.repeat(run.input[:, k], 2) for k, name in enumerate(motion.input_name)}
    start = motion.at(0.0)
    whole = simulate(
        model,
        0.5,
        samples=11,
        method="rk853",
        rtol=1e-9,
        coordinate=start.coordinate,
        velocity=start.velocity,
        schedule=Profile(times, values),
    )
    assert whole.status == run.status == "ok"
    assert run.coordinate == pytest.approx(whole.coordinate, abs=1e-7)
    assert run.member_tension[-1] == pytest.approx(whole.member_tension[-1], abs=1e-4)


def test_a_gust_pushes_the_model_for_its_time_only(model: CompiledModel, motion: Motion) -> None:
    gust = Gust("bar1_B", (0.0, 0.0, -2.0), start=0.0125, duration=0.011)
    run = simulate_control(model, motion, t_end=0.1, disturbance=Disturbance(gust=gust))
    calm = simulate_control(model, motion, t_end=0.1)
    apart = np.abs(run.coordinate - calm.coordinate).max(axis=1)
    assert (apart[:3] == 0.0).all()
    assert (apart[3:] > 1e-7).all()
    # The gust begins and ends within samples: two halves are the whole.
    half = [Gust("bar1_B", (0.0, 0.0, -2.0), 0.0125, 0.004), Gust("bar1_B", (0.0, 0.0, -2.0), 0.0165, 0.007)]
    again = simulate_control(model, motion, t_end=0.1, disturbance=Disturbance(gust=half))
    assert again.coordinate == pytest.approx(run.coordinate, abs=1e-8)


def test_delayed_commands_arrive_when_they_should(model: CompiledModel, motion: Motion) -> None:
    delay = np.array([0.0, 0.005, 0.012, 0.0025, 0.01, 0.0, 0.0, 0.0, 0.03])
    bounds = find_bounds(model, motion, limits=ActuatorLimits(delay=delay))
    inputs = DelayedInputs(bounds, np.full(9, -1.0), 0.005)
    for k in range(10):
        for since, values in inputs.push(np.full(9, float(k))):
            now = k * 0.005 + since + 1e-12
            expected = [max(-1.0, np.floor((now - late) / 0.005 + 1e-9)) for late in delay]
            assert values.tolist() == expected


def test_delays_act_in_the_loop(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    late = simulate_control(model, motion, gains, t_end=0.3, limits=ActuatorLimits(delay=0.0075))
    assert late.status == "ok"
    start = motion.input[0]
    assert late.input[0] == pytest.approx(start)
    assert late.input[4] == pytest.approx(late.command[3])  # 7.5 ms: in the middle of the sample after next


def check_delay(
    model: CompiledModel, motion: Motion, gains: Gains, delay: float | Array, t_end: float = 3.0
) -> None:
    """Check that a loop with delays ends within twice the error of the same loop without."""
    errors = draw_errors(model, 1)
    late = design_gains(model, motion, delay=delay)
    ends = [
        simulate_control(
            model, motion, item, t_end=t_end, limits=ActuatorLimits(delay=item.delay), disturbance=errors
        )
        for item in (gains, late)
    ]
    assert [run.status for run in ends] == ["ok", "ok"]
    assert ends[1].warnings == ()
    assert ends[1].worst_error(0.5) < 2.0 * ends[0].worst_error(0.5)


def test_loops_with_delays_end_as_those_without(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    """Delays from a part of a sample to four samples, another one for each actuator."""
    delay = np.array([0.0, 0.005, 0.01, 0.02, 0.004, 0.0125, 0.02, 0.001, 0.0])
    check_delay(model, motion, gains, delay, t_end=1.25)


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.004, 0.005, 0.01, 0.02, 0.0375])
def test_loops_with_equal_delays_end_as_those_without(
    model: CompiledModel, motion: Motion, gains: Gains, delay: float
) -> None:
    check_delay(model, motion, gains, delay)


def test_a_loop_worse_than_the_open_one_is_not_ok(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    """Gains that know nothing of 30 ms; without the comparison only the warning is left."""
    options: dict[str, Any] = {"t_end": 1.0, "disturbance": draw_errors(model, 1)}
    options["limits"] = ActuatorLimits(delay=0.03)
    run = simulate_control(model, motion, gains, **options)
    assert run.status == "does_not_hold"
    assert "mm without feedback" in run.message
    assert "designed for delays of up to 0 ms" in run.warnings[0]
    alone = simulate_control(model, motion, gains, compare=False, **options)
    assert (alone.status, alone.warnings) == ("ok", run.warnings)
    assert alone.coordinate == pytest.approx(run.coordinate)
    assert simulate_control(model, motion, **options).status == "ok"


def test_commands_that_are_often_cut_are_warned_of(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    away = Disturbance(coordinate_error=np.radians(5.0) * np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0]))
    run = simulate_control(model, motion, gains, t_end=0.2, disturbance=away, compare=False)
    cut = run.step_status.count("rate_limited") + run.step_status.count("range_limited")
    assert cut > 4
    assert run.warnings[0].startswith(f"{100 * cut / 40:.0f} % of the commands were cut to the rate or range")


def test_slow_motors_and_long_delays_are_refused(model: CompiledModel, motion: Motion) -> None:
    with pytest.raises(InvalidValueError, match="too fast for an actuator") as caught:
        simulate_control(model, motion, limits=ActuatorLimits(rate=0.02))
    assert "m_opposite" in str(caught.value)
    with pytest.raises(InvalidValueError, match="delay is longer than the motion"):
        simulate_control(model, motion, limits=ActuatorLimits(delay=1.5))
    limited = simulate_control(
        model,
        motion,
        t_end=0.2,
        limits=ActuatorLimits(rate=0.06),
        disturbance=Disturbance(coordinate_error=np.zeros(6)),
    )
    assert np.abs(np.diff(limited.command, axis=0)).max() <= 0.06 * 0.005 + 1e-12


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"disturbance": Disturbance(coordinate_error=np.ones(5))}, InvalidValueError, "coordinate_error"),
        ({"disturbance": Disturbance(velocity_error=np.full(6, np.nan))}, NonFiniteError, "velocity_error"),
        ({"t_end": np.nan}, InvalidValueError, "t_end"),
        ({"limits": ActuatorLimits(rate=-1.0)}, InvalidValueError, "rate"),
        ({"limits": ActuatorLimits(rate=np.ones(3))}, InvalidValueError, "rate"),
        ({"limits": ActuatorLimits(range=(0.4, 0.2))}, InvalidValueError, "range"),
        ({"disturbance": Disturbance(gust=Gust("bar9_B", (0.0, 0.0, 1.0)))}, UnknownNameError, "bar1_B"),
        (
            {"disturbance": Disturbance(gust=Gust("bar1_B", (0.0, np.inf, 1.0)))},
            InvalidValueError,
            "gust.force",
        ),
        (
            {"disturbance": Disturbance(gust=Gust("bar1_B", (0.0, 0.0, 1.0), start=-1.0))},
            InvalidValueError,
            "gust.start",
        ),
        ({"disturbance": Disturbance(axial_stiffness=np.ones(3))}, InvalidValueError, "axial_stiffness"),
        ({"disturbance": Disturbance(arguments={"wind": 1.0})}, UnknownNameError, "wind"),
    ],
)
def test_bad_input_is_named(
    model: CompiledModel, motion: Motion, options: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        simulate_control(model, motion, **options)


def test_gains_of_another_sample_time_are_refused(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    with pytest.raises(InvalidValueError, match="another sample time"):
        simulate_control(model, motion, gains, sample=0.01)


def test_a_run_that_fails_in_its_first_sample_has_its_start_alone(
    model: CompiledModel, motion: Motion
) -> None:
    load = np.zeros_like(model.nominal("node_load"))
    load[model.manifest.node_name.index("bar1_B"), 0] = 1e300
    run = simulate_control(model, motion, t_end=0.1, disturbance=Disturbance(arguments={"node_load": load}))
    assert run.status == "unstable"
    assert run.coordinate.shape == (1, 6)
    assert run.command.shape == (0, 9)
    assert run.step_status == ()


# From a plan to a closed loop in node positions: a prism with stiff bars on held feet.


@pytest.mark.thorough
def test_a_planned_motion_of_nodes_is_held() -> None:
    structure = build_prism(free=False)
    wanted = want_analyses(structure, ModelRequest(()), ("plan", "time_motion", "control"))
    model = build_library(structure, wanted).load()
    names = [item.name for item in structure.actuators if "bottom" not in item.name]
    motion = time_motion(model, plan(model, "twist=158", actuators=names), duration=1.0)
    n = structure.n_coordinates
    weight = np.concatenate([np.full(n, 1e4), np.ones(n)])
    gains = design_lqr(model, motion, weight, np.full(len(names), 1e4))
    tips = tuple(k for k, name in enumerate(structure.node_name) if name.startswith("t"))
    estimator = design_kalman(model, motion, [Sensor("node_position", tips, 1e-4)])
    assert estimator.substeps > 1  # bars vibrate fast
    off = 1e-4 * np.random.default_rng(0).normal(size=n)
    gust = Gust("t1", (0.0, 0.0, -3.0), 0.5, 0.1)
    for senses, bound in ((None, 1e-6), (estimator, 5e-4)):
        run = simulate_control(
            model,
            motion,
            gains,
            estimator=senses,
            t_end=2.0,
            disturbance=Disturbance(coordinate_error=off, gust=gust),
        )
        assert run.status == "ok"
        assert 1e-3 < run.worst_error() < 0.01
        assert run.worst_error(0.5) < bound
