"""Feedback of rigid bodies: gains over the motions that they have, pushes, feet that roll, estimates."""

from pathlib import Path

import numpy as np
import pytest
import scipy

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Gains, find_sensing
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest, find_following, hold_feet
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.loop.tension_distribution import design_distribution
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import design_mpc
from tensegrity_codegen.control.feedback.study.stated_errors import StatedErrors
from tensegrity_codegen.control.feedback.study.study import study_control
from tensegrity_codegen.control.feedback.study.tuning import choose_weights
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.codegen.quickly import without_optimisation
from tests.models import load
from tests.standing_robot import describe_robot

Q = np.concatenate([np.full(36, 1e4), np.full(36, 4.0)])
SAMPLE = 0.005


@pytest.fixture(scope="module")
def robot() -> CompiledModel:
    with without_optimisation():
        return compile_scene(describe_robot(), for_=("equilibrium", "control"))


@pytest.fixture(scope="module")
def stands(robot: CompiledModel) -> Equilibrium:
    return find_equilibrium(robot)


@pytest.fixture(scope="module")
def gains(robot: CompiledModel, stands: Equilibrium) -> Gains:
    return design_lqr(robot, stands, Q, np.full(3, 1e5))


def test_gains_are_those_over_the_18_motions_of_three_bodies(
    robot: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    """Against SciPy's Riccati solver in the coordinates of possible variations, where feet stick."""
    found = linearize(robot, stands)
    along = found.variation.toarray()[:72, :36]
    whole, following = found.A.toarray(), find_following(robot, stands.coordinate)
    whole[:, :36] += whole[:, 72:] @ following
    rate, push = along.T @ whole[:72, :72] @ along, along.T @ found.B.toarray()[:72]
    block = np.zeros((39, 39))
    block[:36, :36], block[:36, 36:] = rate, push
    moved = scipy.linalg.expm(SAMPLE * block)
    a, b, r = moved[:36, :36], moved[:36, 36:], 1e5 * np.eye(3)
    p = scipy.linalg.solve_discrete_are(a, b, along.T @ (Q[:, None] * along), r)
    wanted = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    np.testing.assert_allclose(gains.K[-1] @ along, wanted, rtol=1e-7, atol=1e-7 * np.abs(wanted).max())
    np.testing.assert_allclose(gains.K[-1] @ along @ along.T, gains.K[-1], atol=1e-8 * np.abs(wanted).max())
    assert np.abs(gains.E).max() < 1.0


def test_a_push_of_three_newtons_is_held(robot: CompiledModel, stands: Equilibrium, gains: Gains) -> None:
    push = Disturbance(gust=Gust("rod0_hi", (3.0, 0.0, 0.0), 0.1, 0.02))
    without, held = (
        simulate_control(robot, stands, item, t_end=1.2, disturbance=push, compare=False)
        for item in (None, gains)
    )
    assert held.status == "ok"
    moving = [np.abs(run.velocity[run.time > 1.0]).max() for run in (without, held)]
    assert moving[1] < 0.5 * moving[0]
    assert held.worst_error(0.2) < 0.7 * without.worst_error(0.2)  # feet have slipped a little in both


def test_weights_of_an_equilibrium_are_those_of_two_seconds_at_rest(
    robot: CompiledModel, stands: Equilibrium
) -> None:
    rest = build_rest(robot, stands, 2.0)
    np.testing.assert_array_equal(choose_weights(robot, stands).Q, choose_weights(robot, rest).Q)


def test_errors_of_the_start_with_which_bodies_collapse_are_named(
    robot: CompiledModel, stands: Equilibrium
) -> None:
    """The rods are 28 mm across, between the corners that their inertia has beside their axes."""
    weights = choose_weights(robot, stands)
    with pytest.raises(InvalidValueError, match="bodies collapse") as caught:
        study_control(robot, stands, tuning=weights, errors=StatedErrors(start_error=1.0), draws=1)
    assert caught.value.where == "start_error"
    assert caught.value.given == "1 m"
    corners = stands.coordinate.reshape(3, 4, 3)
    least = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3)[:, *np.triu_indices(4, 1)].min()
    assert f"{least:.3g} m" in caught.value.allowed


def test_balls_that_roll_do_not_slip(robot: CompiledModel, stands: Equilibrium) -> None:
    push = Disturbance(gust=Gust("rod0_hi", (0.3, 0.0, 0.0), 0.05, 0.1))
    run = simulate_control(robot, stands, t_end=0.4, disturbance=push)
    assert np.abs(run.error).max() > 1e-3
    assert run.slip is not None
    assert run.slip.max() < 1e-6
    assert run.warnings == ()


def test_held_feet_have_the_accelerations_of_bristles(robot: CompiledModel, stands: Equilibrium) -> None:
    """Where balls stick by their lowest points, to first order in a motion of rigid bodies."""
    rest = build_rest(robot, stands)
    assert robot.structure is not None
    held = load(
        hold_feet(robot.structure, robot, rest), "acceleration", "state_jacobian", formulation="rigid_bar"
    )
    start, along = rest.at(0.0), linearize(robot, stands).variation.toarray()[:36, :18]
    following = find_following(robot, start.coordinate)
    at = {"coordinate": start.coordinate, "velocity": np.zeros(36), "input": np.zeros(3)}
    np.testing.assert_allclose(held.compute("acceleration", **at), 0.0, atol=1e-8)
    whole = robot.compute("state_jacobian", **at, internal=start.internal).toarray()[:72]
    whole[:, :36] += whole[:, 72:] @ following
    mine = held.compute("state_jacobian", **at).toarray()
    scale = np.abs(whole).max()
    for columns in (slice(0, 36), slice(36, 72)):
        np.testing.assert_allclose(mine[:, columns] @ along, whole[:, columns] @ along, atol=1e-10 * scale)


def test_what_does_not_know_bodies_is_refused_by_name(
    robot: CompiledModel, stands: Equilibrium, tmp_path: Path
) -> None:
    cables = Sensor("member_length", tuple(range(9)), 1e-4)
    estimator = design_kalman(
        robot, stands, [cables, Sensor("node_position", (0, 8, 16), 1e-4)], disturbance=0.0
    )
    with pytest.raises(FormulationError, match="an estimator in C"):
        build_controller(robot, stands, estimator=estimator, out=tmp_path / "c")
    with pytest.raises(FormulationError, match="a distribution of tensions"):
        design_distribution(robot, stands)


def test_estimates_keep_the_shapes_of_bodies(robot: CompiledModel, stands: Equilibrium) -> None:
    cables = Sensor("member_length", tuple(range(9)), 1e-5)
    places = Sensor("node_position", tuple(range(24)), 1e-5)
    estimator = design_kalman(robot, stands, [cables, places], disturbance=0.0)
    away = Disturbance(coordinate_error=1e-5 * np.random.default_rng(0).normal(size=36))
    run = simulate_control(robot, stands, estimator=estimator, t_end=0.3, disturbance=away)
    assert run.estimate is not None
    error = np.abs(run.estimate[:, :36] - run.coordinate[:-1]).max(axis=1)
    assert error[-10:].max() < 5e-5
    edges = robot.structure.is_edge  # type: ignore[union-attr]
    length = robot.compute("member_length", coordinate=run.estimate[-1, :36])
    np.testing.assert_allclose(length[edges], robot.structure.rest_length[edges], rtol=1e-12)  # type: ignore[union-attr]


def test_the_controller_in_c_is_that_of_python(
    robot: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    push = Disturbance(gust=Gust("rod0_hi", (3.0, 0.0, 0.0), 0.1, 0.02))
    mine = simulate_control(robot, stands, gains, t_end=0.3, disturbance=push, compare=False)
    (other,) = simulate_control_batch(robot, stands, gains, draws=[push], t_end=0.3)
    np.testing.assert_allclose(other.coordinate, mine.coordinate, atol=1e-12)
    np.testing.assert_allclose(other.command, mine.command, atol=1e-12)


@pytest.mark.thorough
def test_prediction_with_one_command_a_block_is_feedback_in_small_motions(
    robot: CompiledModel, stands: Equilibrium, gains: Gains
) -> None:
    push = Disturbance(gust=Gust("rod0_hi", (0.03, 0.0, 0.0), 0.1, 0.02))
    predicted = design_mpc(robot, stands, Q, np.full(3, 1e5), horizon=10, blocks=[1] * 10)
    (run,) = simulate_control_batch(robot, stands, predicted, draws=[push], t_end=0.3)
    (held,) = simulate_control_batch(robot, stands, gains, draws=[push], t_end=0.3)
    size = np.abs(held.command - held.command[0]).max()
    assert np.abs(run.command - held.command).max() < 0.01 * size


def test_gyros_measure_the_spin_of_bodies(robot: CompiledModel, stands: Equilibrium) -> None:
    """With cables alone the estimator knows less of how fast bodies turn."""
    cables, gyros = (
        Sensor("member_length", tuple(range(9)), 1e-4),
        Sensor("angular_velocity", (0, 1, 2), 1e-3),
    )
    sensing = find_sensing(robot, [cables, gyros])
    assert sensing.names[9:12] == ("rod0.x spin", "rod0.y spin", "rod0.z spin")
    rate = np.linalg.lstsq(linearize(robot, stands).variation.toarray()[:36, :18].T, np.ones(18), rcond=None)[
        0
    ]
    at = {"coordinate": stands.coordinate, "velocity": rate, "input": np.zeros(3)}
    measured = sensing.measure({**at, "internal": np.zeros(12)})[9:]
    slopes = sensing.slopes({**at, "velocity": np.zeros(36), "internal": np.zeros(12)})[9:]
    np.testing.assert_allclose(slopes[:, 36:] @ rate, measured, rtol=1e-7)
    variances = [
        np.trace(design_kalman(robot, stands, chosen, disturbance=0.0).P[-1][36:72, 36:72])
        for chosen in ([cables], [cables, gyros])
    ]
    assert variances[1] < 0.5 * variances[0]
