"""The implicit method for the mixed form, tensions of two-sided members being unknowns: its loop is in C."""

from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.integrate.c_run import CRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory, is_within_reach
from tensegrity_codegen.tables.integrators import INTEGRATORS, STIFF_INTEGRATOR

COUNTS = INTEGRATORS[STIFF_INTEGRATOR].counts
STEPS_BEFORE_FORECAST = 5_000  # steps after which a run that would need ten times that many is given up


def integrate_implicit(motion: Motion, options: RunOptions, *, quiet: float = 0.0) -> RawTrajectory:
    """Integrate a motion in the mixed form.

    Every step's estimated error is at most atol + rtol |x|, component by component; where stiff members
    vibrate less than that, or than `quiet` [m], about their smooth motion this is damped out, and `evidence`
    says how much they did at the start: vibration [m], vibration_speed [m/s], vibration_tension [N]. Status
    "unstable" where the state stops being finite, "not_converged" where no step meets the tolerance or more
    than max_steps would be needed, "too_many_events" where events follow each other too closely; with the
    samples reached. A run that an event ends has the state there as its last sample. Raises as integrate_rk4.
    """
    return _Run(motion, options, quiet).finish()


def listen_to_members(motion: Motion) -> dict[str, float]:
    """Return the amplitudes with which stiff members vibrate at the start, see integrate_implicit."""
    run = _Run(
        replace(motion, sample_time=np.array([0.0, motion.t_end])),
        RunOptions(STIFF_INTEGRATOR, 1e-3, 1e-3),
        0.0,
    )
    run.advance(0)
    return run.vibrations()


class _Run(CRun):
    """One integration in the mixed form: its counters, and what it says of vibrations."""

    def __init__(self, motion: Motion, options: RunOptions, quiet: float) -> None:
        super().__init__(STIFF_INTEGRATOR, motion)
        self.options, self.quiet = options, quiet
        ffi = self.bound.ffi
        self.step, self.count = ffi.new("double *", 0.0), ffi.new("long long[]", len(COUNTS))
        self.vibration = ffi.new("double[]", 3)

    def may_go_on(self) -> bool:
        """Whether the end is not reached, and may be with so many trials."""
        most, is_open = self.options.max_steps, bool(self.time[0] < self.motion.t_end)
        return is_open and is_within_reach(sum(self.count[0:3]), self.fraction, most, STEPS_BEFORE_FORECAST)

    def advance(self, count: int) -> None:
        """Try so many steps."""
        bound, options = self.bound, self.options
        watched = (self.events.counts,) if self.events.is_counted else ()
        told = (bound.pointer(bound.tensions), bound.n_sampled, self.quiet, self.count, self.vibration)
        head = (self.motion.t_end, options.rtol, options.absolute, count, self.time, self.step)
        self.call(head, (*told, *watched))

    def vibrations(self) -> dict[str, float]:
        """Return the largest amplitudes with which members vibrate."""
        names = ("vibration", "vibration_speed", "vibration_tension")
        return dict(zip(names, (float(value) for value in self.vibration), strict=True))

    def result(self) -> RawTrajectory:
        """Return the samples reached so far, and how the run ended."""
        status, message = self.ending()
        times, states = self.events.samples(self.motion.sample_time, float(self.time[0]))
        evidence = dict(zip(COUNTS, (int(n) for n in self.count), strict=True))
        told = f"{evidence['accepted']} steps, {evidence['rejected'] + evidence['newton_failures']} rejected"
        return RawTrajectory(
            time=times,
            state=states,
            status=status,
            message=message or told + self.events.told,
            method=STIFF_INTEGRATOR,
            n_steps=evidence["accepted"],
            n_evaluations=evidence["evaluations"],
            tension=self.bound.tensions[: len(times)],
            tension_member=self.bound.tension_member,
            evidence=evidence | self.vibrations(),
            log=self.events.log(),
        )
