"""Explicit Runge-Kutta methods with error control, rk54 and rk853: the loop runs in the generated C."""

from __future__ import annotations

import time as clock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.event_log import EMPTY_LOG, MOST_LOGGED, EventLog, choose_watch
from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator
from tensegrity_codegen.runtime.keep import require_keep
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.runtime.run_end import is_within_reach, judge_end

__all__ = ["integrate_adaptive"]

FloatArray = NDArray[np.float64]

EVENT_ROW = np.dtype(
    {"names": ["time", "kind", "which", "direction"], "formats": ["f8", "i4", "i4", "i4"], "itemsize": 24}
)
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
    run, chunk, word = _EventRun(bound, motion), FIRST_CHUNK, "ok"
    counts = run.counts
    if options.keep:
        counts.keeps_energy = 1
    while (
        time[0] < end and word == "ok" and not run.is_over and run.is_within_reach(time[0] / end, max_steps)
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
    reached, log = bound.n_reached, run.log()
    times, states = motion.sample_time[:reached], bound.samples[:reached]
    if run.is_over and times[-1] < time[0]:
        times, states = np.append(times, time[0]), np.vstack([states, bound.state])
    events = f", {log.count} events" if log.count else ""
    if bound.spec.unwatched:
        events += f", no events of {bound.spec.unwatched} cables (model.events)"
    return RawTrajectory(
        time=times,
        state=states,
        status=status_word,
        message=message or f"{counts.n_accepted} steps, {counts.n_rejected} rejected{events}",
        method=options.method,
        n_steps=int(counts.n_accepted),
        n_evaluations=int(counts.n_evaluations),
        log=log,
    )


class _EventRun:
    """The counters of a run in C, with the events that it watches."""

    def __init__(self, bound: BoundIntegrator, motion: Motion) -> None:
        ffi, self.manifest = bound.ffi, motion.model.manifest
        self.watch = choose_watch(bound.spec, self.manifest, motion.watch)
        self.counts = ffi.new("integrator_run *")
        self.raised: list[BaseException] = []
        self.has_events = bool(bound.spec.events)
        if not self.has_events:
            return
        self.rows = np.empty(MOST_LOGGED if self.watch.kinds else 0, dtype=EVENT_ROW)
        self.counts.watch, self.counts.stop = self.watch.bits, self.watch.stop_bits
        self.counts.event = ffi.cast("integrator_event *", ffi.from_buffer(self.rows))
        self.counts.most_events = len(self.rows)
        if self.watch.condition is not None:
            n = len(self.manifest.coordinate_name)
            self.handle = ffi.callback(
                "double(double, const double *, const double *, void *)", self._condition(ffi, n)
            )
            self.counts.condition = self.handle

    def _condition(self, ffi: Any, n: int) -> Any:
        """Return the condition as C calls it; what it raises is kept, and ends the run as NAN."""
        condition = self.watch.condition
        assert condition is not None

        def call(time: float, coordinate: Any, velocity: Any, _: Any) -> float:
            try:
                q, v = (np.frombuffer(ffi.buffer(x, 8 * n), dtype=np.float64) for x in (coordinate, velocity))
                return float(condition(time, q.copy(), v.copy()))
            except BaseException as error:
                self.raised.append(error)
                return float("nan")

        return call

    def raise_own(self) -> None:
        """Raise what the condition has raised."""
        if self.raised:
            raise self.raised[0]

    def is_within_reach(self, fraction: float, max_steps: int) -> bool:
        """Whether the end may be reached with so many trials; fraction: part of the time span done."""
        trials = int(self.counts.n_accepted + self.counts.n_rejected)
        return is_within_reach(trials, fraction, max_steps, FORESIGHT)

    @property
    def is_over(self) -> bool:
        """Whether an event has ended the run."""
        return self.has_events and bool(self.counts.is_stopped)

    def log(self) -> EventLog:
        """Return the events so far."""
        if not self.has_events:
            return EMPTY_LOG
        count = int(self.counts.n_events)
        return EventLog.from_rows(self.rows[:count], count, self.manifest)
