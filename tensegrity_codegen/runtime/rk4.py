"""Classical Runge-Kutta 4 with a fixed step: the loop runs in the generated C, in interruptible chunks."""

from __future__ import annotations

import math
import time as clock

from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory

__all__ = ["integrate_rk4"]


def integrate_rk4(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a fixed step, the largest up to that of the options that divides the span.

    Status "unstable" and the samples reached if the state stops being finite. Raises
    FormulationError if the model has no such integrator, InvalidValueError for a state or an argument of
    another size, NonFiniteError for one that is not finite.
    """
    n_steps = max(1, math.ceil(motion.t_end / float(options.step or 0.0) * (1.0 - 1e-12)))
    run = _Run(motion, motion.t_end / n_steps)
    chunk, done = 64, 0
    while done < n_steps:
        count, started = min(chunk, n_steps - done), clock.perf_counter()
        is_finite = run.advance(done, count)
        done += int(run.n_done[0])
        if not is_finite:
            return run.result(done, f"the state is not finite after t = {done * run.step:.6g} s")
        motion.report(done / n_steps)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    return run.result(done, "")


class _Run:
    """One integration with a fixed step."""

    def __init__(self, motion: Motion, step: float) -> None:
        self.bound = BoundIntegrator("rk4", motion)
        self.step, self.asked_time = step, motion.sample_time
        # The last sample is the end of the last step, whatever the rounding of n times the step.
        times = self.bound.sample_time
        times[-1] = min(times[-1], round(motion.t_end / step) * step)
        self.n_done = self.bound.ffi.new("long long *", 0)

    def advance(self, first_step: int, count: int) -> bool:
        """Do `count` steps from `first_step`; return whether the state stayed finite."""
        bound = self.bound
        status = bound.call(
            0.0,
            self.step,
            first_step,
            count,
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.n_sampled,
            self.n_done,
            bound.pointer(bound.work),
        )
        return bound.check(status, ("non_finite_result",)) == "ok"

    def result(self, n_steps: int, trouble: str) -> RawTrajectory:
        """Return the samples reached so far."""
        reached = self.bound.n_reached
        return RawTrajectory(
            time=self.asked_time[:reached],
            state=self.bound.samples[:reached],
            status="unstable" if trouble else "ok",
            message=f"{trouble}: take a smaller step" if trouble else f"fixed step {self.step:.6g} s",
            method="rk4",
            n_steps=n_steps,
            n_evaluations=4 * n_steps + 1,
            step=self.step,
        )
