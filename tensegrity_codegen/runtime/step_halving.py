"""Fixed steps with an error estimate: halve the step until two runs agree within the tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.interface import Model
from tensegrity_codegen.runtime.trajectory import RawTrajectory

__all__ = ["MOST_STEPS", "estimate_frequency", "halve_until_converged"]

FloatArray = NDArray[np.float64]

MOST_STEPS = 20_000_000
MOST_STALLS = 3  # halvings in a row that bring nothing
ROUNDING = 1e-8  # differences this small against the state, if they stop shrinking, are rounding
ORDER_GAIN = 15.0  # 2^4 - 1: Richardson's factor of a method of order 4


def estimate_frequency(model: Model, coordinate: FloatArray, arguments: Mapping[str, Any]) -> float:
    """Return about the largest angular frequency [rad/s] at `coordinate`, by power iteration on d(q'')/dq."""
    rest = model.compute("acceleration", coordinate=coordinate, velocity=0 * coordinate, **arguments)
    size = 1e-6 * (float(np.ptp(coordinate)) + 1e-3)
    direction = np.cos(np.arange(1, coordinate.size + 1) ** 2.0)
    rate = 0.0
    for _ in range(30):
        direction = direction / np.linalg.norm(direction)
        moved = model.compute(
            "acceleration", coordinate=coordinate + size * direction, velocity=0 * coordinate, **arguments
        )
        direction = (moved - rest) / size
        rate = float(np.linalg.norm(direction))
        if not rate > 0.0:
            return 0.0
    return float(np.sqrt(rate))


def halve_until_converged(
    run: Callable[[float], RawTrajectory], first_step: float, span: float, rtol: float, atol: float
) -> RawTrajectory:
    """Return the first run whose estimated error is within atol + rtol |x|, component by component.

    run: step [s] -> trajectory. The estimate is the difference of two runs over the gain that their
    successive differences show, at most 15 (order 4), so that kinks, which lower the order, are not
    taken for convergence. Status "not_converged" with the last estimate if the steps grow too many or
    the differences have stopped shrinking, which rounding does for good and a kink for one or two halvings.
    """
    step, previous, last_difference = first_step, run(first_step), np.inf
    total_steps, least, stalls = previous.n_steps, np.inf, 0
    while True:
        step /= 2.0
        if span / step > MOST_STEPS:
            return _give_up(previous, last_difference, f"more than {MOST_STEPS} steps would be needed")
        finer = run(step)
        total_steps += finer.n_steps
        difference = _difference(previous, finer, rtol, atol)
        gain = np.clip(last_difference / difference - 1.0, 1.0, ORDER_GAIN) if difference > 0 else ORDER_GAIN
        if finer.status == "ok" and difference / gain <= 1.0:
            message = f"step halved to {step:.6g} s; estimated error {difference / gain:.2g} of the tolerance"
            return replace(
                finer,
                method="auto (rk4, step halving)",
                message=message,
                error_estimate=float(difference / gain),
                n_steps=finer.n_steps,
                n_evaluations=4 * total_steps,
            )
        close = last_difference < 1e3 or _is_rounding(previous, finer)
        stalls = stalls + 1 if finer.status == "ok" and close and difference >= least else 0
        if stalls == MOST_STALLS:
            return _give_up(finer, difference, "a smaller step no longer brings the runs together")
        previous, last_difference, least = finer, difference, min(least, difference)


def _difference(coarse: RawTrajectory, fine: RawTrajectory, rtol: float, atol: float) -> float:
    """Return the largest difference over atol + rtol |x|; infinite if a run did not reach the end."""
    if coarse.status != "ok" or fine.status != "ok":
        return np.inf
    scale = atol + rtol * np.abs(fine.state)
    return float(np.max(np.abs(fine.state - coarse.state) / scale))


def _is_rounding(coarse: RawTrajectory, fine: RawTrajectory) -> bool:
    """Return whether two runs differ by no more than rounding might explain."""
    if coarse.status != "ok" or fine.status != "ok":
        return False
    return bool(np.max(np.abs(fine.state - coarse.state)) <= ROUNDING * np.max(np.abs(fine.state)))


def _give_up(last: RawTrajectory, difference: float, why: str) -> RawTrajectory:
    estimate = difference if np.isfinite(difference) else None
    told = "unknown" if estimate is None else f"{estimate:.3g} times the tolerance"
    return replace(
        last,
        status="unstable" if last.status != "ok" else "not_converged",
        message=f"{why}; estimated error {told}: loosen --rtol and --atol, or soften the stiffest members",
        method="auto (rk4, step halving)",
        error_estimate=estimate,
    )
