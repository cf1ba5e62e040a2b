"""Step halving on made-up runs whose error is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tensegrity_codegen.runtime.step_halving import MOST_STEPS, halve_until_converged
from tensegrity_codegen.runtime.trajectory import RawTrajectory

TRUTH = 1.0


def make_run(
    error: Callable[[float], float], seen: list[float] | None = None
) -> Callable[[float], RawTrajectory]:
    """Return runs of a method that ends at TRUTH + error(step)."""

    def run(step: float) -> RawTrajectory:
        if seen is not None:
            seen.append(step)
        state = np.array([[TRUTH], [TRUTH + error(step)]])
        finite = bool(np.isfinite(state).all())
        return RawTrajectory(
            np.array([0.0, 1.0]), state, "ok" if finite else "unstable", "", "rk4", 1, 1, step
        )

    return run


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_the_error_is_within_the_tolerance_whatever_the_order(order: int, tolerance: float) -> None:
    found = halve_until_converged(make_run(lambda step: step**order), 0.5, 1.0, tolerance, 1e-15)
    assert found.status == "ok"
    assert abs(found.state[-1, 0] - TRUTH) <= 2 * tolerance
    assert found.error_estimate is not None
    assert found.error_estimate <= 1.0


def test_order_four_needs_few_steps() -> None:
    seen: list[float] = []
    halve_until_converged(make_run(lambda step: step**4, seen), 0.5, 1.0, 1e-6, 1e-15)
    assert len(seen) <= 7


def test_a_kink_that_stalls_once_or_twice_is_overcome() -> None:
    sequence = [1e-4, 1e-5, 3e-5, -1e-5, 2e-5, 1.5e-5, 1e-6, 5e-7]
    errors = dict(zip(2.0 ** -np.arange(1.0, 9.0), sequence, strict=True))
    found = halve_until_converged(make_run(errors.__getitem__), 0.5, 1.0, 1e-6, 1e-15)
    assert found.status == "ok"


def test_rounding_ends_it_with_an_estimate() -> None:
    rng = np.random.default_rng(1)
    seen: list[float] = []
    run = make_run(lambda step: step**4 + 1e-12 * rng.standard_normal(), seen)
    found = halve_until_converged(run, 0.5, 1.0, 1e-16, 1e-300)
    assert found.status == "not_converged"
    assert "no longer" in found.message
    assert found.error_estimate is not None
    assert found.error_estimate > 1.0
    assert len(seen) < 25


def test_too_many_steps_end_it() -> None:
    found = halve_until_converged(make_run(lambda step: 1e5 * step), 0.5, 1.0, 1e-9, 1e-15)
    assert found.status == "not_converged"
    assert str(MOST_STEPS) in found.message


def test_a_run_that_blows_up_is_tried_with_smaller_steps() -> None:
    found = halve_until_converged(
        make_run(lambda step: np.inf if step > 0.01 else step**4), 0.5, 1.0, 1e-6, 1e-15
    )
    assert found.status == "ok"
    assert found.step is not None
    assert found.step < 0.01


def test_a_run_that_always_blows_up_is_unstable() -> None:
    found = halve_until_converged(make_run(lambda step: np.inf), 0.5, 1.0, 1e-6, 1e-15)
    assert found.status == "unstable"
    assert found.error_estimate is None
