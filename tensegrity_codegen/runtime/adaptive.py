"""Explicit Runge-Kutta methods with error control, rk54 and rk853: the loop runs in the generated C."""

from __future__ import annotations

import time as clock

from tensegrity_codegen.runtime.event_run import EventRun
from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator
from tensegrity_codegen.runtime.keep import require_keep
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.runtime.run_end import is_within_reach, judge_end

__all__ = ["integrate_adaptive"]

FIRST_CHUNK = 64  # steps of the first call into C
FORESIGHT = 10_000  # steps after which a run that would need ten times that many is given up


def integrate_adaptive(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by the method "rk54" or "rk853".

    Every step's estimated error is at most atol + rtol |x|, component by component, and where the energy is
    kept it ends at that of the start, see templates/integrate_energy.c.j2. A run that an event ends has the
    state there as its last sample. Status "unstable" where the state stops being finite, "not_converged"
    where no step meets the tolerance or more than max_steps would be needed, "too_many_events" where events
    follow each other too closely; with the samples reached. Raises as integrate_rk4, what a condition raises,
    and FormulationError for events that the library lacks.
    """
    bound = BoundIntegrator(options.method, motion)
    require_keep(bound.spec, options.keep)
    ffi, end, max_steps = bound.ffi, motion.t_end, options.max_steps
    time, step = ffi.new("double *", 0.0), ffi.new("double *", 0.0)
    run, chunk, word = EventRun(bound, motion), FIRST_CHUNK, "ok"
    counts = run.counts
    if options.keep:
        counts.keeps_energy = 1
    while (
        time[0] < end
        and word == "ok"
        and not run.is_over
        and is_within_reach(run.trials, time[0] / end, max_steps, FORESIGHT)
    ):
        started = clock.perf_counter()
        status = bound.call(
            end,
            options.rtol,
            options.atol,
            chunk,
            time,
            step,
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.n_sampled,
            counts,
            bound.pointer(bound.work),
        )
        run.raise_own()
        word = bound.check(status, ("non_finite_result", "step_too_small", "too_many_events"))
        motion.report(float(time[0]) / end)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    status_word, message = ("ok", "") if run.is_over else judge_end(word, float(time[0]), end)
    times, states = run.samples(motion.sample_time, float(time[0]))
    return RawTrajectory(
        time=times,
        state=states,
        status=status_word,
        message=message or f"{counts.n_accepted} steps, {counts.n_rejected} rejected{run.told}",
        method=options.method,
        n_steps=int(counts.n_accepted),
        n_evaluations=int(counts.n_evaluations),
        log=run.log(),
    )
