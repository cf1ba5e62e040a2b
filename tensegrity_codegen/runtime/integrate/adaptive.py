"""Explicit Runge-Kutta methods with error control: the loop runs in the generated C."""

from tensegrity_codegen.runtime.integrate.c_run import CRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory, is_within_reach
from tensegrity_codegen.system.errors import FormulationError

STEPS_BEFORE_FORECAST = 10_000  # steps after which a run that would need ten times that many is given up


def integrate_adaptive(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion by an explicit method of `METHODS` with error control.

    Every step's estimated error is at most atol + rtol |x|, component by component, and where the energy is
    kept it ends at that of the start, see templates/c/energy.h. A run that an event ends has the
    state there as its last sample. Status "unstable" where the state stops being finite, "not_converged"
    where no step meets the tolerance or more than max_steps would be needed, "too_many_events" where events
    follow each other too closely; with the samples reached. Raises as integrate_rk4, what a condition raises,
    and FormulationError for events that the library lacks.
    """
    return AdaptiveRun(motion, options).finish()


class AdaptiveRun(CRun):
    """One integration with error control."""

    def __init__(self, motion: Motion, options: RunOptions) -> None:
        super().__init__(options.method, motion)
        spec, keep = self.bound.spec, options.keep
        if keep and keep not in spec.keeps:
            raise FormulationError(
                f"the library was not built to keep the {keep}",
                where=spec.symbol,
                allowed=", ".join(spec.keeps) or "nothing",
                hint=f'build it with keep = ["{keep}"]',
            )
        self.options, self.step = options, self.bound.ffi.new("double *", 0.0)
        self.events.counts.follows_two_errors = options.is_open
        if options.keep:
            self.events.counts.keeps_energy = 1

    def may_go_on(self) -> bool:
        """Whether the end is not reached, and may be with so many trials."""
        most, is_open = self.options.max_steps, bool(self.time[0] < self.motion.t_end)
        return is_open and is_within_reach(self.events.trials, self.fraction, most, STEPS_BEFORE_FORECAST)

    def advance(self, count: int) -> None:
        """Try so many steps."""
        tolerance = self.options.rtol, self.options.absolute
        head = (self.motion.t_end, *tolerance, count, self.time, self.step)
        self.call(head, (self.bound.n_sampled, self.events.counts))

    def result(self) -> RawTrajectory:
        """Return the samples reached so far, and how the run ended."""
        events, counts = self.events, self.events.counts
        status, message = self.ending()
        return RawTrajectory(
            **self.reached(float(self.time[0])),
            status=status,
            message=message or f"{counts.n_accepted} steps, {counts.n_rejected} rejected{events.told}",
            method=self.options.method,
            n_steps=int(counts.n_accepted),
            n_evaluations=int(counts.n_evaluations),
            log=events.log(),
        )
