"""Margins of linear loops beside frequency responses, and predicted errors beside long simulations."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from tensegrity_codegen import (
    Draws,
    StatedErrors,
    compile_scene,
    design_kalman,
    design_lqr,
    find_equilibrium,
    simulate_control_batch,
    study_control,
)
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.study.linear_loop import (
    LinearLoop,
    build_linear_loop,
    find_disks,
    find_gain_range,
    find_margins,
    find_phase,
    predict_errors,
)
from tensegrity_codegen.control.pages.control_studies import describe_study
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.control.feedback.pinned_prism import ROOT

Array = NDArray[np.float64]
SAMPLE = 0.02
LIFT = """
[[actuators]]
name = "winch"
members = "cord"
[[sensors]]
kind = "member_length"
members = "cord"
noise = 1e-3
"""


@pytest.fixture(scope="module")
def lift(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    """Return a mass on a cord with a winch: one coordinate, one actuator."""
    text = (ROOT / "tensegrity_codegen" / "scene" / "examples" / "two_nodes.toml").read_text()
    path = Path(tmp_path_factory.mktemp("lift")) / "lift.toml"
    path.write_text('axes = "z"\n' + text + LIFT)
    return compile_scene(path, for_=("equilibrium", "control"))


@pytest.fixture(scope="module")
def estimator(model: CompiledModel, motion: Motion) -> Estimator:
    return design_kalman(model, motion, knots=2)


def build(model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator | None) -> LinearLoop:
    return build_linear_loop(model, motion, gains, gains.delay, estimator, {})


def design_lift(lift: CompiledModel, delay: float) -> tuple[Motion, Gains]:
    rest = build_rest(lift, find_equilibrium(lift), 2.0)
    return rest, design_lqr(lift, rest, [100.0, 1.0], [1.0], sample=SAMPLE, delay=delay)


@pytest.mark.parametrize("delay", [0.0, 1.5 * SAMPLE], ids=["at once", "late"])
def test_the_disk_of_one_actuator_is_that_of_its_frequency_response(
    lift: CompiledModel, delay: float
) -> None:
    """The disk touches the curve -1 / L(z) of the open loop, here from the matrices of the scene alone.

    The curve f = -1 / L holds the factors of the actuator's effect with an eigenvalue on the unit circle, and
    f = (2 + e) / (2 - e) gives each one its e: the least modulus is the margin.
    """
    rest, gains = design_lift(lift, delay)
    at = {"coordinate": rest.coordinate[0], "velocity": np.zeros(1), "input": rest.input[0]}
    rate = lift.compute("state_jacobian", **at).toarray()
    push = lift.compute("input_jacobian", **at).toarray()

    def hold(span: float) -> tuple[Array, Array]:
        whole = expm(span * np.block([[rate, push], [np.zeros((1, 3))]]))
        return whole[:2, :2], whole[:2, 2:]

    a, b = hold(SAMPLE)
    early = hold(0.5 * SAMPLE)[1]  # of a command that arrives in the middle of the sample
    least = np.inf
    for z in np.exp(1j * np.geomspace(1e-5, 1.0, 20_001) * np.pi):
        effect, known = b, gains.K[-1, 0, :2]
        ahead = 0.0
        if delay:
            effect = early / z + (b - early) / z**2
            ahead = gains.K[-1, 0, 2:] @ np.array([1.0 / z, 1.0 / z**2])  # commands on their way
        loop = (known @ np.linalg.solve(z * np.eye(2) - a, effect))[0] / (1.0 + ahead)
        factor = -1.0 / loop
        least = min(least, abs(2.0 * (factor - 1.0) / (factor + 1.0)))
    found = find_margins(build(lift, rest, gains, None))
    assert found.is_stable
    assert found.disk == pytest.approx(least, rel=1e-5)
    np.testing.assert_allclose(found.actuator_disk, found.disk, rtol=1e-12)


def test_an_input_beside_the_commands_is_what_more_effect_adds(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    loop = build(model, motion, gains, estimator)
    transition, push, command = loop.open_at_inputs()
    assert len(push) == 1  # no delays
    expected, _ = loop.step(factor=1.3)
    np.testing.assert_allclose(transition + 0.3 * push[0] @ command, expected, atol=1e-12)


def test_factors_inside_the_disks_keep_loops_stable(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    """Of one actuator alone the disk is exact: beyond it, by one part in a hundred, are unstable factors."""
    loop = build(model, motion, gains, estimator)
    transition, push, command = loop.open_at_inputs()
    every, each = find_disks(loop)

    def radius(factors: NDArray[np.complex128]) -> float:
        changed = transition + push[0] @ ((factors - 1.0)[:, None] * command)
        return float(np.abs(np.linalg.eigvals(changed)).max())

    rng, around = np.random.default_rng(4), np.exp(1j * np.linspace(0.0, np.pi, 721))
    for _ in range(200):
        e = 0.999 * every * np.exp(2j * np.pi * rng.random(9))
        assert radius((2.0 + e) / (2.0 - e)) < 1.0
    worst = int(np.argmin(each))
    for part, is_inside in ((0.99, True), (1.01, False)):
        factors = np.ones((len(around), 9), dtype=complex)
        e = part * each[worst] * around
        factors[:, worst] = (2.0 + e) / (2.0 - e)
        assert (max(radius(row) for row in factors) < 1.0) == is_inside
    # Gains and phases are points of the circle.
    least, most = find_gain_range(every)
    assert least * most == pytest.approx(1.0)
    turned = np.exp(1j * find_phase(every))
    assert abs(2.0 * (turned - 1.0) / (turned + 1.0)) == pytest.approx(every)
    assert find_gain_range(2.5) == (0.0, np.inf)


def test_noise_moves_nodes_as_predicted(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    """One Lyapunov equation beside half a minute in the full model, with noise of the sensors alone."""
    predicted = predict_errors(build(model, motion, gains, estimator), model, motion.coordinate[-1])
    study = study_control(
        model, motion, gains=gains, estimator=estimator, t_end=30.0,
        errors=StatedErrors(start_error=0.0, stiffness_error=0.0),
        draws=Draws(2, last=27.0, batch=simulate_control_batch),
    )  # fmt: skip
    simulated = study.loops["estimator"].end_rms
    assert study.predicted["estimator"] == predicted
    assert max(study.predicted["true_state"].values()) == 0.0
    moved = [name for name, size in predicted.items() if size > 0.0]
    assert moved == ["bar1_B", "bar2_B", "bar3_B"]
    for name in moved:
        assert simulated[name] == pytest.approx(predicted[name], rel=0.1)
    noise = describe_study(study)["noise"]
    assert noise["predicted_rms"] == max(predicted.values())
    assert noise["simulated_rms"] == simulated[noise["node"]]


def test_an_unstable_loop_has_no_margins_and_no_bound(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    loop = build_linear_loop(model, motion, gains, np.full(9, 0.03), None, {})
    margins = find_margins(loop)
    assert (margins.is_stable, margins.disk, margins.actuator_disk.max()) == (False, 0.0, 0.0)
    assert margins.radius > 1.0
    assert set(predict_errors(loop, model, motion.coordinate[-1]).values()) == {np.inf}
