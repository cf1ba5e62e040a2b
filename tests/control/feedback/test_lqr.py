"""Linear-quadratic feedback: exact sampling, the recursion, the names of python-control, refusals."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from tensegrity_codegen import compile_scene, find_equilibrium
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.control.feedback.design.linear_samples import sample_linear_models
from tensegrity_codegen.control.feedback.design.riccati import describe_direction, find_uncontrolled
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
)
from tests.control.feedback.pinned_prism import build_prism, design_gains, move_prism

Array = NDArray[np.float64]

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"
Q = np.concatenate([np.full(6, 100.0), np.full(6, 0.1), np.full(6, 1.0)])
R = np.full(9, 1e4)


def test_linear_models_are_held_exactly_along_the_motion(model: CompiledModel, motion: Motion) -> None:
    samples = sample_linear_models(model, motion, 0.05, motion.actuators)
    assert samples.time == pytest.approx(0.05 * np.arange(21))
    for k in (0, 7, 20):
        point = motion.at(float(samples.time[k]))
        at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
        rate = model.compute("state_jacobian", **at).toarray()
        gain = model.compute("input_jacobian", **at).toarray()
        a, b, *_ = cont2discrete((rate, gain, np.eye(12), np.zeros((12, 9))), 0.05, "zoh")
        assert samples.A[k] == pytest.approx(a, rel=1e-9, abs=1e-11)
        assert samples.B[k] == pytest.approx(b, rel=1e-9, abs=1e-11)


def test_the_first_gain_minimises_the_stated_cost(model: CompiledModel, motion: Motion) -> None:
    """Stack all inputs of the horizon into one least-squares problem."""
    gains = design_lqr(model, motion, Q[:12], R, sample=0.1)
    samples = sample_linear_models(model, motion, 0.1, motion.actuators)
    rng = np.random.default_rng(4)
    start = rng.normal(size=12) * np.repeat([0.02, 0.1], 6)
    horizon = len(samples.time) - 1
    free, forced = start, np.zeros((12, 9 * horizon))
    rows, right = [], []
    for k in range(horizon):
        rows += [np.sqrt(Q[:12])[:, None] * forced, np.sqrt(R)[:, None] * np.eye(9, 9 * horizon, 9 * k)]
        right += [np.sqrt(Q[:12]) * free, np.zeros(9)]
        free = samples.A[k] @ free
        forced = samples.A[k] @ forced
        forced[:, 9 * k : 9 * k + 9] += samples.B[k]
    factor = np.linalg.cholesky(gains.S[-1])
    rows.append(factor.T @ forced)
    right.append(factor.T @ free)
    best = np.linalg.lstsq(np.vstack(rows), -np.concatenate(right), rcond=None)[0][:9]
    assert best == pytest.approx(-gains.K[0] @ start, rel=1e-7, abs=1e-12)
    cost = sum(float(r @ r) for r in [np.vstack(rows) @ np.zeros(9 * horizon) + np.concatenate(right)])
    assert cost > float(start @ gains.S[0] @ start) > 0.0


def test_the_end_point_has_the_stationary_solution(model: CompiledModel, motion: Motion) -> None:
    gains = design_lqr(model, motion, Q, R, integral_action=model.manifest.coordinate_name)
    assert gains.K.shape == (201, 9, 18)
    assert gains.S.shape == (201, 18, 18)
    a = np.block([[gains.A, np.zeros((12, 6))], [gains.integral_action, np.eye(6)]])
    b = np.vstack([gains.B, np.zeros((6, 9))])
    p = gains.S[-1]
    gain = np.linalg.solve(np.diag(R) + b.T @ p @ b, b.T @ p @ a)
    left = a.T @ p @ a - a.T @ p @ b @ gain + np.diag(Q)
    assert np.abs(left - p).max() < 1e-10 * np.abs(p).max()
    assert gains.residual < 1e-10
    assert gains.K[-1] == pytest.approx(gain, rel=1e-9)
    assert np.abs(gains.E).max() < 1.0
    assert gains.at(500) is not gains.K
    assert np.array_equal(gains.at(500), gains.K[-1])


@pytest.mark.peers
def test_gains_are_those_of_python_control(model: CompiledModel, motion: Motion) -> None:
    control: Any = pytest.importorskip("control")
    gains = design_lqr(model, motion, Q, R, integral_action=model.manifest.coordinate_name)
    plant = gains.state_space()
    assert plant.dt == 0.005
    assert list(plant.input_labels) == list(motion.actuators)
    k, s, _ = control.dlqr(plant, np.diag(Q), np.diag(R), integral_action=gains.integral_action)
    assert np.abs(gains.K[-1] - k).max() < 1e-8 * np.abs(k).max()
    assert np.abs(gains.S[-1] - s).max() < 1e-8 * np.abs(s).max()


def test_an_equilibrium_is_held_as_a_motion_is(model: CompiledModel, motion: Motion) -> None:
    found = find_equilibrium(build_prism("equilibrium"), arguments={"input": motion.input[-1]})
    gains = design_lqr(model, found, Q[:12], R, arguments={"input": motion.input[-1]})
    assert gains.K.shape == (2, 9, 12)
    along = design_lqr(model, motion, Q[:12], R)
    # Coordinates differ by full turns of the azimuths only.
    assert gains.K[-1] == pytest.approx(along.K[-1], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("q", "r", "words"),
    [
        (np.ones(11), R, "Q: the weight has another size"),
        (np.eye(12)[:5], R, r"\(5, 12\)"),
        (np.ones(12), np.ones(8), "R: the weight has another size"),
        (-np.ones(12), R, "Q: the weight is not positive semidefinite"),
        (np.ones(12), np.diag([1.0] * 8 + [0.0]), "R: the weight is not positive definite"),
        (np.eye(12) + np.eye(12, k=1), R, "Q: the weight is not symmetric"),
        ("heavy", R, "Q: not an array of numbers"),
    ],
)
def test_wrong_weights_are_refused(model: CompiledModel, motion: Motion, q: Any, r: Any, words: str) -> None:
    with pytest.raises(InvalidValueError, match=words):
        design_lqr(model, motion, q, r)


def test_weights_and_samples_must_be_finite(model: CompiledModel, motion: Motion) -> None:
    with pytest.raises(NonFiniteError, match="Q"):
        design_lqr(model, motion, np.full(12, np.nan), R)
    for sample in (0.0, -1.0, np.nan, 5.0, 1e-9):
        with pytest.raises(InvalidValueError, match="sample"):
            design_lqr(model, motion, Q[:12], R, sample=sample)


def test_unknown_outputs_and_other_models_are_refused(model: CompiledModel, motion: Motion) -> None:
    with pytest.raises(UnknownNameError, match="bar1_azimuth"):
        design_lqr(model, motion, Q, R, integral_action=["bar1_azimut"])
    with pytest.raises(InvalidValueError, match="integral_action"):
        design_lqr(model, motion, Q, R, integral_action=np.eye(3))
    other = replace(motion, input_name=tuple(f"x{k}" for k in range(9)))
    with pytest.raises(InvalidValueError, match="another model"):
        design_lqr(model, other, Q[:12], R)


def test_an_output_that_nothing_changes_is_named(model: CompiledModel, motion: Motion) -> None:
    twice = np.vstack([np.eye(12)[0], np.eye(12)[0]])  # two sums of one coordinate: their difference stays
    with pytest.raises(FormulationError, match="sum 1") as caught:
        design_lqr(model, motion, np.ones(14), R, integral_action=twice)
    assert "rank 13 of 14 at eigenvalue 1" in str(caught.value)


def test_a_cable_between_two_fixed_points_is_said_to_have_no_effect() -> None:
    model = build_prism(with_bottom=True)
    motion = move_prism(model)
    with pytest.raises(InvalidValueError, match="an actuator has no effect") as caught:
        design_lqr(model, motion, Q[:12], np.ones(12))
    assert "m_bottom1, m_bottom2, m_bottom3" in str(caught.value)
    assert "bottom1 connects points that cannot move" in str(caught.value)


@pytest.mark.thorough
def test_rigid_motions_of_a_free_structure_are_named() -> None:
    model = compile_scene(EXAMPLES / "prism12.toml", for_=("control", "equilibrium"))
    found = find_equilibrium(model)
    with pytest.raises(FormulationError, match="the actuators cannot stabilise the motion") as caught:
        design_lqr(model, found, np.ones(36), np.ones(6))
    assert (
        "rigid motions of the whole structure: slide along x, slide along y, slide along z, turn about"
        in str(caught.value)
    )


def test_a_held_structure_that_no_actuator_stabilises_is_said_so(tmp_path: Path) -> None:
    """A weight between two upright cords: nothing pulls it sideways, and nothing rigid is free."""
    (tmp_path / "cords.toml").write_text(
        'name = "cords"\naxes = "xz"\n[classes.cord]\nkind = "cable"\nspring_constant = 100\n[nodes]\n'
        "top = { position = [0, 1], anchored = true }\nlow = { position = [0, -1], anchored = true }\n"
        "weight = { position = [0, 0], mass = 1.0 }\n[members]\n"
        'upper = { class = "cord", nodes = ["top", "weight"], rest_length = 0.5 }\n'
        'lower = { class = "cord", nodes = ["weight", "low"], rest_length = 0.5 }\n'
        '[[actuators]]\nname = "winch"\nmembers = "upper"\n',
        encoding="utf-8",
    )
    model = compile_scene(tmp_path / "cords.toml", for_=("control", "equilibrium"))
    with pytest.raises(FormulationError, match="the actuators cannot stabilise the motion") as caught:
        design_lqr(model, find_equilibrium(model), np.ones(4), np.ones(1))
    assert "weight.x" in str(caught.value)
    assert "rigid motions" not in str(caught.value)


def test_an_unstable_mode_that_inputs_miss_is_found() -> None:
    a = np.diag([0.5, 1.1, 0.9])
    b = np.array([[1.0], [0.0], [1.0]])
    (mode,) = find_uncontrolled(a, b)
    assert mode.eigenvalue == pytest.approx(1.1)
    assert np.abs(mode.direction) == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    assert describe_direction(mode.direction, ["a", "b", "c"]) == "1 b"
    assert find_uncontrolled(a, np.ones((3, 1))) == []


def test_delays_add_the_commands_on_their_way_to_the_states(model: CompiledModel, motion: Motion) -> None:
    """With whole samples the gains are those without delay, of the state predicted to the arrival."""
    plain, late = (design_gains(model, motion, delay=delay) for delay in (0.0, 0.01))
    assert late.K.shape == (201, 9, 18 + 18)
    assert late.delay.tolist() == [0.01] * 9
    assert late.S.shape == plain.S.shape
    a = np.block([[plain.A, np.zeros((12, 6))], [plain.integral_action, np.eye(6)]])
    b = np.vstack([plain.B, np.zeros((6, 9))])
    latest, oldest = late.K[-1][:, 18::2], late.K[-1][:, 19::2]
    np.testing.assert_allclose(late.K[-1][:, :18], plain.K[-1] @ a @ a, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(latest, plain.K[-1] @ b, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(oldest, plain.K[-1] @ a @ b, rtol=1e-6, atol=1e-8)


def test_gains_for_too_many_commands_on_their_way_are_refused(model: CompiledModel, motion: Motion) -> None:
    with pytest.raises(InvalidValueError, match="commands are on their way") as caught:
        design_gains(model, motion, delay=0.9)
    assert caught.value.where == "delay"


def test_an_equilibrium_has_gains_for_delays_of_several_samples(tmp_path: Path) -> None:
    path = tmp_path / "lift.toml"
    winch = '[[actuators]]\nname = "winch"\nmembers = "cord"\nrate = 1.0\ndelay = 0.05\n'
    path.write_text('axes = "z"\n' + list_examples()["two_nodes"] + winch, encoding="utf-8")
    model = compile_scene(path, for_=("equilibrium", "control"))
    gains = design_lqr(model, find_equilibrium(model), [100.0, 1.0], [1.0], sample=0.02)
    assert gains.K.shape == (2, 1, 2 + 3)
    assert np.abs(gains.E).max() < 1.0
