"""Linear loops: eigenvalues of gains and estimator, margins, covariance, beside simulations."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import design_kalman, simulate_control
from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.study.linear_loop import LinearLoop, build_linear_loop, find_margins
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


def test_simulated_loops_fail_beyond_the_margin(model: CompiledModel, motion: Motion, gains: Gains) -> None:
    """Delays that gains do not know: a fifth below the margin the loop settles, a fifth above it swings."""
    margins = find_margins(build(model, motion, gains, None))
    ends = [
        simulate_control(
            model, motion, gains, t_end=1.5, delay=part * margins.delay, coordinate_error=np.full(6, 1e-4),
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
