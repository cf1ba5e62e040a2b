"""Classical Runge-Kutta 4 with a fixed step: the loop runs in the generated C, in interruptible chunks."""

from __future__ import annotations

import math
import time as clock

from tensegrity_codegen.runtime.event_run import EventRun
from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.runtime.run_end import judge_end

__all__ = ["integrate_rk4"]

FIRST_CHUNK = 64  # steps of the first call into C


def integrate_rk4(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a fixed step, the largest up to that of the options that divides the span.

    Steps are cut at events and go on to their ends after them; a run that an event ends has the state
    there as its last sample. Status "unstable" and the samples reached if the state stops being finite,
    "too_many_events" where events follow each other too closely. Raises FormulationError if the model has no
    such integrator or lacks the events, InvalidValueError for a state or an argument of another size,
    NonFiniteError for one that is not finite, and what a condition raises.
    """
    n_steps = max(1, math.ceil(motion.t_end / float(options.step or 0.0) * (1.0 - 1e-12)))
    run = _Run(motion, motion.t_end / n_steps)
    chunk, done, word = FIRST_CHUNK, 0, "ok"
    while done < n_steps and word == "ok" and not run.events.is_over:
        count, started = min(chunk, n_steps - done), clock.perf_counter()
        word = run.advance(done, count)
        done += int(run.n_done[0])
        motion.report(done / n_steps)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    return run.result(done, word)


class _Run:
    """One integration with a fixed step."""

    def __init__(self, motion: Motion, step: float) -> None:
        self.bound = BoundIntegrator("rk4", motion)
        self.step, self.asked_time = step, motion.sample_time
        self.events = EventRun(self.bound, motion)
        self.is_watching = bool(self.events.watch.kinds)
        # The last sample is the end of the last step, whatever the rounding of n times the step.
        times = self.bound.sample_time
        times[-1] = min(times[-1], round(motion.t_end / step) * step)
        self.n_done, self.time = self.bound.ffi.new("long long *", 0), self.bound.ffi.new("double *", 0.0)
        symbol = self.bound.spec.symbol
        self.call = motion.model.library.symbol(f"{symbol}_run" if self.is_watching else symbol)

    def advance(self, first_step: int, count: int) -> str:
        """Do `count` steps from `first_step`; return the status as a word."""
        bound = self.bound
        status = self.call(
            0.0,
            self.step,
            first_step,
            count,
            *((self.time,) if self.is_watching else ()),
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.n_sampled,
            self.n_done,
            *((self.events.counts,) if self.is_watching else ()),
            bound.pointer(bound.work),
        )
        self.events.raise_own()
        return bound.check(status, ("non_finite_result", "too_many_events"))

    def result(self, n_steps: int, word: str) -> RawTrajectory:
        """Return the samples reached so far; n_steps: steps done, word: the last status."""
        reached = float(self.time[0]) if self.is_watching else n_steps * self.step
        status, trouble = judge_end(word, reached, reached)
        times, states = self.events.samples(self.asked_time, reached)
        counts = self.events.counts
        return RawTrajectory(
            time=times,
            state=states,
            status=status,
            message=f"{trouble}: take a smaller step"
            if trouble
            else f"fixed step {self.step:.6g} s{self.events.told}",
            method="rk4",
            n_steps=n_steps,
            n_evaluations=int(counts.n_evaluations) if self.is_watching else 4 * n_steps + 1,
            step=self.step,
            log=self.events.log(),
        )
