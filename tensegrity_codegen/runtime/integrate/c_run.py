"""Integration in the generated C by short calls, between which Ctrl-C and progress come."""

import time as clock
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from tensegrity_codegen.runtime.integrate.event_run import EventRun
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.raw_results import STOPPED_AT, RawTrajectory, judge_end

FIRST_CHUNK = 64  # steps of the first call into C
CHUNK_SECONDS = 0.1  # a call lasts about this long
ENDINGS = ("non_finite_result", "step_too_small", "too_many_events")  # that a result tells of


def count_steps() -> Iterator[int]:
    """Yield how many steps the next call into C shall do; twice as many where the last one was short."""
    chunk = FIRST_CHUNK
    while True:
        started = clock.perf_counter()
        yield chunk
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2


class CRun(ABC):
    """One integration in C, from its start to its end, or to an event that ends it."""

    def __init__(self, name: str, motion: Motion) -> None:
        self.motion, self.bound = motion, BoundIntegrator(name, motion)
        self.events = EventRun(self.bound, motion)
        self.time = self.bound.ffi.new("double *", 0.0)
        self.word = "ok"  # status of the last call

    @property
    def fraction(self) -> float:
        """Part of the time span that is done."""
        return float(self.time[0]) / self.motion.t_end

    @abstractmethod
    def may_go_on(self) -> bool:
        """Whether there are steps left to try."""

    @abstractmethod
    def advance(self, count: int) -> None:
        """Try so many steps."""

    @abstractmethod
    def result(self) -> RawTrajectory:
        """Return the samples reached so far, and how the run ended."""

    def ending(self) -> tuple[str, str]:
        """Return the status of a run that stopped here and, if it is not good, what stopped it."""
        if self.events.is_over:
            return "ok", ""
        return judge_end(self.word, float(self.time[0]), self.motion.t_end)

    def reached(self, time: float) -> dict[str, Any]:
        """Return times, states and internal states of the samples reached; `time` [s]: where the run is."""
        times, states = self.events.samples(self.motion.sample_time, time)
        n, manifest = self.bound.n_moved, self.motion.model.manifest
        last, count = n + len(manifest.internal_name), len(manifest.column_name)
        internal = states[:, n:last] if last > n else None
        columns = states[:, last:].reshape(len(times), last, count) / manifest.column_scale if count else None
        return {"time": times, "state": states[:, :n], "internal": internal, "columns": columns}

    def finish(self) -> RawTrajectory:
        """Go on to the end; return the result. Raises what a condition raises."""
        for count in count_steps():
            if self.word != "ok" or self.events.is_over or not self.may_go_on():
                break
            self.advance(count)
            self.motion.report(self.fraction)
        found = self.result()
        if found.status == "ok":
            return found
        return replace(found, evidence={**found.evidence, STOPPED_AT: float(self.time[0])})

    def call(self, head: Sequence[Any], tail: Sequence[Any]) -> None:
        """Call the loop in C; head: what it takes before the state, tail: between samples and work memory."""
        bound = self.bound
        status = bound.call(
            *head,
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            *tail,
            bound.pointer(bound.work),
        )
        self.events.raise_own()
        self.word = bound.check(status, ENDINGS)
