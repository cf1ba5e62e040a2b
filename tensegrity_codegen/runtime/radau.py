"""Radau IIA-5 for the mixed form, tensions of two-sided members being unknowns: the loop runs in C."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator, Progress
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.run_end import is_within_reach, judge_end
from tensegrity_codegen.runtime.trajectory import RawTrajectory

__all__ = ["RADAU_COUNTS", "integrate_radau"]

FloatArray = NDArray[np.float64]

# What the C function counts, in its order.
RADAU_COUNTS = ("accepted", "rejected", "newton_failures", "factorisations", "iterations", "evaluations")
MOST_TRIALS = 20_000_000  # steps tried in one run
FIRST_CHUNK = 64  # steps of the first call into C
FORESIGHT = 5_000  # steps after which a run that would need ten times that many is given up


def integrate_radau(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    rtol: float,
    atol: float,
    arguments: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> RawTrajectory:
    """Integrate the mixed form from x(0) = state (n_states,) over sample_time (n_t,) [s] from 0 up.

    Every step's estimated error is at most atol + rtol |x|, component by component; where stiff members
    vibrate less than that about their smooth motion this is damped out, and `evidence` says how much they did
    at the start: vibration [m], vibration_speed [m/s], vibration_tension [N]. Status "unstable" where the
    state stops being finite, "not_converged" where no step meets the tolerance or too many would be needed;
    with the samples reached. Raises as integrate_rk4.
    """
    bound = BoundIntegrator("radau", model, state, sample_time, arguments or {})
    ffi, end = bound.ffi, float(sample_time[-1])
    time, step = ffi.new("double *", 0.0), ffi.new("double *", 0.0)
    count, vibration = ffi.new("long long[]", len(RADAU_COUNTS)), ffi.new("double[]", 3)
    chunk, word = FIRST_CHUNK, "ok"
    while time[0] < end and word == "ok" and _is_within_reach(sum(count[0:3]), time[0] / end):
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
            bound.pointer(bound.tensions),
            bound.n_sampled,
            count,
            vibration,
            bound.pointer(bound.work),
        )
        word = bound.check(status, ("non_finite_result", "step_too_small"))
        if progress is not None:
            progress(float(time[0]) / end)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    status_word, message = judge_end(word, float(time[0]), end)
    reached, evidence = bound.n_reached, dict(zip(RADAU_COUNTS, (int(n) for n in count), strict=True))
    told = f"{evidence['accepted']} steps, {evidence['rejected'] + evidence['newton_failures']} rejected"
    return RawTrajectory(
        time=sample_time[:reached],
        state=bound.samples[:reached],
        status=status_word,
        message=message or told,
        method="radau",
        n_steps=evidence["accepted"],
        n_evaluations=evidence["evaluations"],
        tension=bound.tensions[:reached],
        tension_member=bound.tension_member,
        evidence=evidence
        | {
            "vibration": float(vibration[0]),
            "vibration_speed": float(vibration[1]),
            "vibration_tension": float(vibration[2]),
        },
    )


def _is_within_reach(trials: int, fraction: float) -> bool:
    return is_within_reach(trials, fraction, MOST_TRIALS, FORESIGHT)
