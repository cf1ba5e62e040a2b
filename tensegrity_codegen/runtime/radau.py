"""Radau IIA-5 for the mixed form, tensions of two-sided members being unknowns: the loop runs in C."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.event_run import EventRun
from tensegrity_codegen.runtime.integration import CHUNK_SECONDS, BoundIntegrator
from tensegrity_codegen.runtime.motion import Motion
from tensegrity_codegen.runtime.options import RunOptions
from tensegrity_codegen.runtime.raw_trajectory import RawTrajectory
from tensegrity_codegen.runtime.run_end import is_within_reach, judge_end

__all__ = ["RADAU_COUNTS", "integrate_radau", "listen_to_members"]

# What the C function counts, in its order.
RADAU_COUNTS = ("accepted", "rejected", "newton_failures", "factorisations", "iterations", "evaluations")
FIRST_CHUNK = 64  # steps of the first call into C
FORESIGHT = 5_000  # steps after which a run that would need ten times that many is given up


def integrate_radau(motion: Motion, options: RunOptions, *, quiet: float = 0.0) -> RawTrajectory:
    """Integrate a motion in the mixed form.

    Every step's estimated error is at most atol + rtol |x|, component by component; where stiff members
    vibrate less than that, or than `quiet` [m], about their smooth motion this is damped out, and `evidence`
    says how much they did at the start: vibration [m], vibration_speed [m/s], vibration_tension [N]. Status
    "unstable" where the state stops being finite, "not_converged" where no step meets the tolerance or more
    than max_steps would be needed, "too_many_events" where events follow each other too closely; with the
    samples reached. A run that an event ends has the state there as its last sample. Raises as integrate_rk4.
    """
    run = _Run(motion, options, quiet)
    chunk, word = FIRST_CHUNK, "ok"
    while (
        not run.is_done and not run.events.is_over and word == "ok" and run.is_within_reach(options.max_steps)
    ):
        started = clock.perf_counter()
        word = run.advance(chunk)
        motion.report(run.fraction)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    return run.result(word)


def listen_to_members(motion: Motion) -> dict[str, float]:
    """Return the amplitudes with which stiff members vibrate at the start, see integrate_radau."""
    run = _Run(replace(motion, sample_time=np.array([0.0, 1.0])), RunOptions("radau", 1e-3, 1e-3), 0.0)
    run.advance(0)
    return run.vibrations()


class _Run:
    """One integration in C: its counters, and what it says of vibrations."""

    def __init__(self, motion: Motion, options: RunOptions, quiet: float) -> None:
        self.bound = BoundIntegrator("radau", motion)
        ffi, self.end = self.bound.ffi, motion.t_end
        self.tolerance, self.quiet = (options.rtol, options.atol), quiet
        self.asked_time, self.events = motion.sample_time, EventRun(self.bound, motion)
        self.time, self.step = ffi.new("double *", 0.0), ffi.new("double *", 0.0)
        self.count, self.vibration = ffi.new("long long[]", len(RADAU_COUNTS)), ffi.new("double[]", 3)

    @property
    def fraction(self) -> float:
        """Part of the time span that is done."""
        return float(self.time[0]) / self.end

    @property
    def is_done(self) -> bool:
        """Whether the end is reached."""
        return bool(self.time[0] >= self.end)

    def is_within_reach(self, max_steps: int) -> bool:
        """Whether the end may be reached with so many trials."""
        return is_within_reach(sum(self.count[0:3]), self.fraction, max_steps, FORESIGHT)

    def advance(self, chunk: int) -> str:
        """Try so many steps; return the status as a word."""
        bound = self.bound
        status = bound.call(
            self.end,
            *self.tolerance,
            chunk,
            self.time,
            self.step,
            bound.pointer(bound.state),
            *bound.arguments(),
            len(bound.sample_time),
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.pointer(bound.tensions),
            bound.n_sampled,
            self.quiet,
            self.count,
            self.vibration,
            *((self.events.counts,) if bound.spec.events else ()),
            bound.pointer(bound.work),
        )
        self.events.raise_own()
        return bound.check(status, ("non_finite_result", "step_too_small", "too_many_events"))

    def vibrations(self) -> dict[str, float]:
        """Return the largest amplitudes with which members vibrate."""
        names = ("vibration", "vibration_speed", "vibration_tension")
        return dict(zip(names, (float(value) for value in self.vibration), strict=True))

    def result(self, word: str) -> RawTrajectory:
        """Return the samples reached; word: the last status."""
        status, message = judge_end(word, float(self.time[0]), self.end)
        if self.events.is_over:
            status, message = "ok", ""
        bound = self.bound
        times, states = self.events.samples(self.asked_time, float(self.time[0]))
        evidence = dict(zip(RADAU_COUNTS, (int(n) for n in self.count), strict=True))
        told = f"{evidence['accepted']} steps, {evidence['rejected'] + evidence['newton_failures']} rejected"
        return RawTrajectory(
            time=times,
            state=states,
            status=status,
            message=message or told + self.events.told,
            method="radau",
            n_steps=evidence["accepted"],
            n_evaluations=evidence["evaluations"],
            tension=bound.tensions[: len(times)],
            tension_member=bound.tension_member,
            evidence=evidence | self.vibrations(),
            log=self.events.log(),
        )
