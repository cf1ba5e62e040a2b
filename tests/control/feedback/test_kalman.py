"""Estimators: gains, disturbance forces, what cannot be observed; the prism from noisy lengths."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tensegrity_codegen.control.feedback.closed_loop import Filter, simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains, find_sensing
from tensegrity_codegen.control.feedback.kalman import design_kalman, find_shown_forces
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, StructureError
from tests.control.feedback.pinned_prism import draw_errors

Array = NDArray[np.float64]
FEW = (Sensor("member_length", (3, 4, 5), 1e-3),)


@pytest.fixture(scope="module")
def estimator(model: CompiledModel, motion: Motion) -> Estimator:
    return design_kalman(model, motion)


def check_draw(model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator, seed: int) -> None:
    errors = draw_errors(model, seed, seed)
    run = simulate_control(model, motion, gains, estimator=estimator, t_end=3.0, disturbance=errors)
    assert run.status == "ok"
    assert np.degrees(run.worst_error(0.5)) < 0.1
    assert run.least_tension(1.0).min() > 5.0
    plain = design_kalman(model, motion, disturbance=0.0)
    biased = simulate_control(model, motion, gains, estimator=plain, t_end=3.0, disturbance=errors)
    assert np.degrees(biased.worst_error(0.5)) > 0.1


@pytest.mark.thorough
def test_noisy_lengths_serve_where_disturbances_are_estimated(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    check_draw(model, motion, gains, estimator, 0)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(1, 20))
def test_noisy_lengths_serve_in_twenty_draws(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator, seed: int
) -> None:
    check_draw(model, motion, gains, estimator, seed)


def test_gains_solve_the_stationary_equation(estimator: Estimator) -> None:
    assert estimator.L.shape == (25, 18, 9)
    assert estimator.residual < 1e-10
    assert np.abs(estimator.E).max() < 1.0
    assert estimator.state_name[12:14] == ("force on bar1_declination", "force on bar1_azimuth")
    between = estimator.at(0.5 * float(estimator.time[3] + estimator.time[4]))
    assert between == pytest.approx(0.5 * (estimator.L[3] + estimator.L[4]))
    assert np.array_equal(estimator.at(9.0), estimator.L[-1])


@pytest.mark.peers
def test_gains_are_those_of_python_control(model: CompiledModel, motion: Motion) -> None:
    control: Any = pytest.importorskip("control")
    estimator = design_kalman(model, motion, disturbance=0.05)
    point = motion.at(1.0)
    at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
    inner = model.compute("state_jacobian", **at).toarray()
    mass = model.compute("mass_matrix", **at).toarray()
    rate = np.zeros((18, 18))
    rate[:12, :12], rate[6:12, 12:] = inner, np.linalg.inv(mass)
    slope = np.hstack([estimator.sensing.slopes(at), np.zeros((9, 6))])
    # The covariance of the noise of a sample follows from the stationary equation itself.
    from scipy.linalg import expm

    a, p = expm(0.005 * rate), estimator.P[-1]
    w = p - a @ (p - estimator.L[-1] @ slope @ p) @ a.T
    gain, _, _ = control.dlqe(a, np.eye(18), slope, 0.5 * (w + w.T), np.diag(estimator.sensing.noise**2))
    assert np.abs(a @ estimator.L[-1] - gain).max() < 1e-8 * np.abs(gain).max()


def test_the_noise_of_a_sample_is_exact(model: CompiledModel, motion: Motion, estimator: Estimator) -> None:
    """Of the integral over the sample, by a differential equation."""
    point = motion.at(1.0)
    at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
    walk = np.full(6, 0.05)
    found = design_kalman(model, motion, disturbance=walk, acceleration_noise=0.3, knots=2)
    rate = np.zeros((18, 18))
    rate[:12, :12] = model.compute("state_jacobian", **at).toarray()
    rate[6:12, 12:] = np.linalg.inv(model.compute("mass_matrix", **at).toarray())
    spectrum = np.diag(np.concatenate([np.zeros(6), np.full(6, 0.09), walk**2]))

    def grow(_: float, flat: Array) -> Array:
        p = flat.reshape(18, 18)
        return (rate @ p + p @ rate.T + spectrum).ravel()

    slope = np.hstack([found.sensing.slopes(at), np.zeros((9, 6))])
    p = found.P[-1]
    corrected = p - found.L[-1] @ slope @ p
    end = solve_ivp(grow, (0.0, 0.005), corrected.ravel(), rtol=1e-11, atol=1e-16).y[:, -1].reshape(18, 18)
    assert np.abs(end - p).max() < 1e-8 * np.abs(p).max()


def test_slopes_of_sensors_are_derivatives(model: CompiledModel, motion: Motion) -> None:
    sensors = (
        Sensor("member_length", (3, 7), 1e-3),
        Sensor("member_tension", (4,), 0.1),
        Sensor("node_position", (4,), 1e-3),
        Sensor("node_velocity", (4,), 1e-2),
    )
    sensing = find_sensing(model, sensors)
    assert sensing.names[:3] == ("length of top1", "length of vertical2", "tension of top2")
    assert len(sensing.names) == 9
    at: dict[str, Any] = {"coordinate": motion.coordinate[40], "velocity": motion.velocity[40]}
    at["input"] = motion.input[40]
    slope = sensing.slopes(at)
    way = np.random.default_rng(1).normal(size=12)
    ends = [
        sensing.measure(
            {**at, "coordinate": at["coordinate"] + d * way[:6], "velocity": at["velocity"] + d * way[6:]}
        )
        for d in (1e-5, -1e-5)
    ]
    assert slope @ way == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-6)


def test_the_prediction_is_the_motion_of_the_model(
    model: CompiledModel, motion: Motion, estimator: Estimator
) -> None:
    senses = Filter(model, estimator, motion, {})
    run = simulate_control(model, motion, t_end=0.2)
    for k in range(40):
        senses.predict(0.005, run.input[k])
    assert senses.state[:6] == pytest.approx(run.coordinate[-1], abs=1e-7)
    assert senses.state[6:12] == pytest.approx(run.velocity[-1], abs=1e-5)


def test_a_constant_force_is_estimated(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    """A load on a tip is the disturbance force J^T F."""
    exact = tuple(replace(sensor, noise=1e-6) for sensor in model.structure.sensors)  # type: ignore[union-attr]
    estimator = design_kalman(model, motion, exact, disturbance=0.05)
    load = np.zeros_like(model.nominal("node_load"))
    node = model.manifest.node_name.index("bar1_B")
    load[node] = [0.3, -0.2, -0.5]
    run = simulate_control(
        model,
        motion,
        gains,
        estimator=estimator,
        t_end=2.0,
        disturbance=Disturbance(arguments={"node_load": load}),
    )
    assert run.disturbance is not None
    jacobian = model.compute("node_jacobian", coordinate=run.coordinate[-2])
    dense = jacobian.toarray() if hasattr(jacobian, "toarray") else np.asarray(jacobian)
    force = dense[3 * node : 3 * node + 3].T @ load[node]
    assert run.disturbance[-100:].mean(axis=0) == pytest.approx(force, abs=1e-3)


def test_sensors_that_do_not_show_the_state_are_refused(model: CompiledModel, motion: Motion) -> None:
    few = (Sensor("member_length", (3, 4, 5), 1e-3),)
    with pytest.raises(FormulationError, match="cannot be observed from these sensors") as caught:
        design_kalman(model, motion, few)
    text = str(caught.value)
    assert "with 3 numbers: length of top1, length of top2, length of top3" in text
    assert "of 18" in text
    assert "unobservable:" in text
    assert "bar1_" in text or "bar2_" in text or "bar3_" in text
    design_kalman(model, motion, few, disturbance=0.0, knots=2)  # damped motions alone need no sensors


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sensors": (Sensor("member_length", (3, 4, 5)),)}, "noise"),
        ({"sensors": (Sensor("member_length", (99,), 1e-3),)}, "targets"),
        ({"disturbance": -1.0}, "disturbance"),
        ({"disturbance": np.ones(5)}, "disturbance"),
        ({"acceleration_noise": np.nan}, "acceleration_noise"),
        ({"knots": 1}, "knots"),
        ({"sample": 0.0}, "sample"),
    ],
)
def test_bad_input_is_named(
    model: CompiledModel, motion: Motion, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InvalidValueError, match=words):
        design_kalman(model, motion, **options)


def test_a_scene_without_sensors_is_refused(model: CompiledModel, motion: Motion) -> None:
    with pytest.raises(StructureError, match="no sensors"):
        design_kalman(model, motion, ())


def test_runs_with_one_seed_are_equal(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    first, second, other = (
        simulate_control(
            model, motion, gains, estimator=estimator, t_end=0.1, disturbance=Disturbance(seed=seed)
        )
        for seed in (3, 3, 4)
    )
    assert np.array_equal(first.coordinate, second.coordinate)
    assert not np.array_equal(first.coordinate, other.coordinate)


def test_designs_for_other_actuators_are_refused(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    with pytest.raises(InvalidValueError, match="gains: designed for another model or motion"):
        simulate_control(model, motion, replace(gains, actuators=gains.actuators[::-1]))
    with pytest.raises(InvalidValueError, match="estimator: designed for another"):
        simulate_control(model, motion, gains, estimator=replace(estimator, state_name=("x",)))


def test_a_loop_that_goes_wrong_ends_with_a_status(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    """An estimator with gains a thousand times too large, and measurements far from its start."""
    wild = replace(estimator, L=1000.0 * estimator.L)
    run = simulate_control(
        model,
        motion,
        gains,
        estimator=wild,
        t_end=3.0,
        disturbance=Disturbance(coordinate_error=np.full(6, 0.1)),
    )
    assert run.status == "unstable"
    assert run.message
    assert np.isfinite(run.coordinate).all()
    assert len(run.time) == len(run.coordinate) == len(run.step_status) + 1


# Which disturbance forces measurements tell apart.


def chain(stiffness: float) -> np.ndarray:
    """Return the rates of two masses, each on a spring, coupled by another; forces on both."""
    rate = np.zeros((6, 6))
    rate[:2, 2:4] = np.eye(2)
    rate[2:4, :2] = -np.array([[1 + stiffness, -stiffness], [-stiffness, 1 + stiffness]])
    rate[2:4, 2:4], rate[2:4, 4:] = -0.5 * np.eye(2), np.eye(2)
    return rate


@pytest.mark.parametrize(
    ("stiffness", "rows", "shown"),
    [
        (1.0, [0, 1], [0, 1]),  # both positions measured
        (1.0, [0], [0]),  # one measurement: the force that it shows best
        (1.0, [1], [1]),
        (1e5, [0, 1], 1),  # as rigid as one body: one force
    ],
)
def test_as_many_forces_as_measurements_tell_apart(
    stiffness: float, rows: list[int], shown: list[int] | int
) -> None:
    slope = np.eye(6)[rows]
    found = find_shown_forces(
        expm(0.01 * chain(stiffness)), slope, np.full(len(rows), 1e-3), np.ones(2), 0.01
    ).tolist()
    assert len(found) == shown if isinstance(shown, int) else found == shown


def test_larger_forces_are_preferred() -> None:
    at = expm(0.01 * chain(1.0))
    assert find_shown_forces(at, np.eye(6)[:1], np.ones(1), np.array([0.1, 10.0]), 0.01).tolist() == [1]


def test_a_filter_of_few_sensors_estimates_few_forces(model: CompiledModel, motion: Motion) -> None:
    found = design_kalman(model, motion, FEW, only_observable=True, knots=2)
    assert len(found.disturbed) == 3
    assert np.abs(found.E).max() < 1.0


def test_nothing_is_left_out_where_all_forces_are_shown(model: CompiledModel, motion: Motion) -> None:
    whole: Estimator = design_kalman(model, motion, knots=2)
    again = design_kalman(model, motion, only_observable=True, knots=2)
    assert again.disturbed.tolist() == whole.disturbed.tolist()
    np.testing.assert_array_equal(again.L, whole.L)
    none = design_kalman(model, motion, FEW, disturbance=0.0, only_observable=True, knots=2)
    assert len(none.disturbed) == 0
