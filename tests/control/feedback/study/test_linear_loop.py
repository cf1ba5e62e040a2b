"""Linear loops: eigenvalues of gains and estimator, margins, covariance, beside simulations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import (
    ControlStudy,
    Tuning,
    choose_weights,
    design_kalman,
    design_lqr,
    simulate_control,
    study_control,
)
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import DISTURBED_PART, find_usual_forces
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.study.linear_loop import (
    LinearLoop,
    build_linear_loop,
    design_slow_estimator,
    find_margins,
    predict_displacement,
)
from tensegrity_codegen.control.feedback.study.tuning import find_scales
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.control.feedback.pinned_prism import design_gains

Array = NDArray[np.float64]
DELAY = np.array([0.0, 0.002, 0.005, 0.008, 0.0, 0.002, 0.005, 0.0, 0.012])


@pytest.fixture(scope="module")
def estimator(model: CompiledModel, motion: Motion) -> Estimator:
    return design_kalman(model, motion, knots=2)


def build(model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator | None) -> LinearLoop:
    return build_linear_loop(model, motion, gains, gains.delay, estimator, {})


def sort_moduli(values: NDArray[np.complex128]) -> Array:
    found = np.sort(np.abs(values))
    return found[found > 1e-3]  # those of delays are 0, but for rounding


@pytest.mark.parametrize("delay", [0.0, DELAY], ids=["at once", "late"])
def test_eigenvalues_are_those_of_gains_and_estimator(
    model: CompiledModel, motion: Motion, estimator: Estimator, delay: Array | float
) -> None:
    """The separation principle, with commands on their way too."""
    gains = design_gains(model, motion, delay=delay)
    for senses in (None, estimator):
        transition, _ = build(model, motion, gains, senses).step()
        parts = [gains.E] if senses is None else [gains.E, senses.E]
        expected = sort_moduli(np.concatenate(parts))
        np.testing.assert_allclose(sort_moduli(np.linalg.eigvals(transition)), expected, atol=1e-6)


def test_loops_are_stable_up_to_their_margins(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    loop = build(model, motion, gains, estimator)
    margins = find_margins(loop)
    assert margins.is_stable
    assert loop.radius(more_delay=0.99 * margins.delay) < 1.0 < loop.radius(more_delay=1.03 * margins.delay)
    assert np.isinf(margins.gain) or loop.radius(factor=1.03 * margins.gain) > 1.0


def test_a_sample_near_the_period_of_a_mode_leaves_little_to_errors_of_stiffness(
    model: CompiledModel, motion: Motion
) -> None:
    """Half of 50 Hz lies below the prism's 28.4 Hz: a per cent decides; half of 100 Hz does not."""
    margins = {}
    for sample in (0.01, 0.02):
        weights = choose_weights(model, motion, sample=sample)
        gains = design_lqr(
            model, motion, weights.Q, weights.R, sample=sample, integral_action=weights.integral_action
        )
        loop = build(model, motion, gains, None)
        margins[sample] = find_margins(loop).stiffness
    frequency = np.abs(np.linalg.eigvals(loop.state_matrix).imag).max() / (2 * np.pi)
    assert 25.0 < frequency < 50.0
    assert margins[0.01] == np.inf
    assert 0.0 < margins[0.02] < 0.02

    def worst(part: float) -> float:
        return max(loop.with_stiffness(1.0 + sign * part).radius() for sign in (-1.0, 1.0))

    assert worst(0.95 * margins[0.02]) < 1.0 < worst(1.1 * margins[0.02])


def test_simulated_loops_fail_beyond_the_margin(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    """Delays that gains do not know: a fifth below the margin the loop settles, a fifth above it swings."""
    margins = find_margins(build(model, motion, gains, None))
    ends = [
        simulate_control(
            model, motion, gains, t_end=1.5, limits=ActuatorLimits(delay=part * margins.delay),
            disturbance=Disturbance(coordinate_error=np.full(6, 1e-4)),
            compare=False,
        ).worst_error(last=0.25)
        for part in (0.8, 1.2)
    ]  # fmt: skip
    assert ends[0] < 1e-4
    assert ends[1] > 1e-3


def test_the_covariance_is_the_sum_of_all_noise_before(
    model: CompiledModel, motion: Motion, gains: Gains, estimator: Estimator
) -> None:
    loop = build(model, motion, gains, estimator)
    transition, effect = loop.step()
    covariance, added = np.zeros_like(transition), (effect * loop.noise**2) @ effect.T
    for _ in range(12):  # twice as many samples each time: 4096
        covariance = covariance + added if not covariance.any() else covariance
        covariance = covariance + transition @ covariance @ transition.T
        transition = transition @ transition
    np.testing.assert_allclose(loop.deviation(), np.sqrt(np.diag(covariance)[:6]), rtol=1e-6)


def test_an_unstable_loop_has_no_margins(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    loop = build_linear_loop(model, motion, gains, np.full(9, 0.03), None, {})
    margins = find_margins(loop)
    assert (margins.is_stable, margins.delay, margins.gain) == (False, 0.0, 1.0)
    assert np.isinf(loop.deviation()).all()


# Disturbance forces of an estimator that are as large as noise of the sensors permits.


def test_the_pinned_prism_keeps_the_default(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    found, warning = design_slow_estimator(model, motion, gains, scales)
    assert warning is None
    np.testing.assert_array_equal(found.L, usual.L)
    assert 0 < predict_displacement(found, scales) < 0.005 * scales.size


@pytest.mark.parametrize("part", [0.95, 1e-4])
def test_forces_are_divided_until_noise_moves_nodes_little(
    model: CompiledModel, motion: Motion, gains: Gains, part: float
) -> None:
    """With a size that is smaller than the true one, the same noise is too much; three divisions at most."""
    scales = find_scales(model, motion, {})
    usual = design_kalman(model, motion, sample=0.005)
    small = replace(scales, size=part * predict_displacement(usual, scales) / 0.005)
    found, warning = design_slow_estimator(model, motion, gains, small)
    assert warning is not None
    divisor = int(warning.split("Divided by ")[1].split(", to")[0].replace(",", ""))
    assert divisor in (10, 100, 1000)
    forces = DISTURBED_PART * find_usual_forces(model, motion, {}) / divisor
    expected = design_kalman(model, motion, sample=0.005, disturbance=forces)
    np.testing.assert_allclose(found.L, expected.L, rtol=1e-9, atol=1e-12)
    assert predict_displacement(found, scales) < predict_displacement(usual, scales)
    left = predict_displacement(found, scales) / (0.005 * small.size)
    assert left <= 0.25 or divisor == 1000
    assert f"{1000 * predict_displacement(found, scales):.3g} mm" in warning
    assert "`disturbance`" in warning


def make_strong(model: CompiledModel, motion: Motion) -> tuple[Tuning, Gains]:
    """Return weights that accept five times the effort of the default."""
    usual = choose_weights(model, motion)
    tuning = choose_weights(model, motion, effort=5.0 * float(usual.effort[0]))
    names = model.manifest.coordinate_name
    return tuning, design_lqr(model, motion, tuning.Q, tuning.R, integral_action=names)


def test_strong_gains_take_smaller_forces_by_the_covariance_of_the_loop(
    model: CompiledModel, motion: Motion
) -> None:
    tuning, gains = make_strong(model, motion)
    usual = design_kalman(model, motion, sample=0.005)
    found, warning = design_slow_estimator(model, motion, gains, tuning.scales)
    assert warning is not None
    assert "Divided by 10," in warning

    def shake(estimator: Estimator) -> float:
        return float(build_linear_loop(model, motion, gains, gains.delay, estimator, {}).deviation().max())

    assert shake(found) < 0.65 * shake(usual)
    slowest = -0.005 / np.log(np.abs(found.E).max())
    assert slowest < 0.5  # [s], a fifth of the time until errors are compared


@pytest.mark.thorough
def test_smaller_forces_hold_the_prism_better_with_strong_gains(model: CompiledModel, motion: Motion) -> None:
    tuning, gains = make_strong(model, motion)

    def study(**options: Any) -> ControlStudy:
        return study_control(model, motion, tuning=tuning, gains=gains, draws=3, t_end=3.0, **options)

    chosen, loud = study(), study(estimator=design_kalman(model, motion, sample=0.005))
    assert chosen.notes[0].startswith("estimator: with disturbance forces of the default size")
    ends = [found.loops["estimator"].end_error.max() for found in (chosen, loud)]
    assert ends[0] < 0.8 * ends[1]
