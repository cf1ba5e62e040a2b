"""Dormand and Prince's Runge-Kutta 5(4) with error control: the loop runs in the generated C."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator, Progress
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.trajectory import RawTrajectory

__all__ = ["MOST_TRIALS", "integrate_rk54"]

FloatArray = NDArray[np.float64]

MOST_TRIALS = 50_000_000  # steps tried in one run
FORESIGHT = 10_000  # steps after which a run that would need ten times that many is given up


def integrate_rk54(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    rtol: float,
    atol: float,
    arguments: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> RawTrajectory:
    """Integrate x' = (q', H^-1 f) from x(0) = state (n_states,) over sample_time (n_t,) [s] from 0 up.

    Every step's estimated error is at most atol + rtol |x|, component by component. Status "unstable" where
    the state stops being finite, "not_converged" where no step meets the tolerance or too many would be
    needed; with the samples reached. Raises as integrate_rk4.
    """
    bound = BoundIntegrator("rk54", model, state, sample_time, arguments or {})
    ffi, end = bound.ffi, float(sample_time[-1])
    time, step = ffi.new("double *", 0.0), ffi.new("double *", 0.0)
    accepted, rejected = ffi.new("long long *"), ffi.new("long long *")
    n_accepted, n_rejected, chunk, word = 0, 0, 64, "ok"
    while time[0] < end and word == "ok" and _is_within_reach(n_accepted + n_rejected, time[0] / end):
        started = clock.perf_counter()
        status = bound.call(
            end,
            rtol,
            atol,
            chunk,
            time,
            step,
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.n_sampled,
            accepted,
            rejected,
            bound.pointer(bound.work),
        )
        word = bound.check(status, ("non_finite_result", "step_too_small"))
        n_accepted, n_rejected = n_accepted + int(accepted[0]), n_rejected + int(rejected[0])
        if progress is not None:
            progress(float(time[0]) / end)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    status_word, message = _judge(word, float(time[0]), end)
    reached = bound.n_reached
    return RawTrajectory(
        time=sample_time[:reached],
        state=bound.samples[:reached],
        status=status_word,
        message=message or f"{n_accepted} steps, {n_rejected} rejected",
        method="rk54",
        n_steps=n_accepted,
        n_evaluations=6 * (n_accepted + n_rejected) + 1,
    )


def _is_within_reach(trials: int, fraction: float) -> bool:
    """Return whether the run may go on: not too many steps yet, and not ten times too many in sight."""
    return trials < MOST_TRIALS and (trials < FORESIGHT or trials < 10 * MOST_TRIALS * fraction)


def _judge(word: str, time: float, end: float) -> tuple[str, str]:
    """Return the status of a run and, if it is not good, what stopped it."""
    if word == "non_finite_result":
        return "unstable", f"the state is not finite after t = {time:.6g} s"
    if word == "step_too_small":
        return "not_converged", f"no step meets the tolerance after t = {time:.6g} s: loosen it"
    if time < end:
        return (
            "not_converged",
            f"too many steps: stopped at t = {time:.6g} s; simulate a shorter time, or loosen the tolerance",
        )
    return "ok", ""
