"""Classical Runge-Kutta 4 with a fixed step: the loop runs in the generated C, in interruptible chunks."""

import math

from tensegrity_codegen.runtime.integrate.c_run import CRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory, judge_end


def integrate_rk4(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a fixed step, the largest up to that of the options that divides the span.

    Steps are cut at events and go on to their ends after them; a run that an event ends has the state
    there as its last sample. Status "unstable" and the samples reached if the state stops being finite,
    "too_many_events" where events follow each other too closely. Raises FormulationError if the model has no
    such integrator or lacks the events, InvalidValueError for a state or an argument of another size,
    NonFiniteError for one that is not finite, and what a condition raises.
    """
    n_steps = max(1, math.ceil(motion.t_end / float(options.step or 0.0) * (1.0 - 1e-12)))
    return _Run(options.method, motion, n_steps).finish()


class _Run(CRun):
    """One integration with a fixed step."""

    def __init__(self, method: str, motion: Motion, n_steps: int) -> None:
        super().__init__(method, motion)
        self.n_steps, self.step, self.done = n_steps, motion.t_end / n_steps, 0
        # The last sample is the end of the last step, whatever the rounding of n times the step.
        times = self.bound.sample_time
        times[-1] = min(times[-1], round(motion.t_end / self.step) * self.step)
        self.n_done = self.bound.ffi.new("long long *", 0)
        self.is_watching = bool(self.events.watch.kinds) or self.bound.knots is not None
        if self.is_watching:
            self.bound.call = motion.model.library.symbol(f"{self.bound.spec.symbol}_run")

    @property
    def fraction(self) -> float:
        """Part of the steps that is done."""
        return self.done / self.n_steps

    def may_go_on(self) -> bool:
        """Whether there are steps left to do."""
        return self.done < self.n_steps

    def advance(self, count: int) -> None:
        """Do `count` steps, or those that are left."""
        head = (0.0, self.step, self.done, min(count, self.n_steps - self.done))
        tail = (self.bound.n_sampled, self.n_done)
        if self.is_watching:
            self.call((*head, self.time), (*tail, self.events.counts))
        else:
            self.call(head, tail)
        self.done += int(self.n_done[0])

    def result(self) -> RawTrajectory:
        """Return the samples reached so far, and how the run ended."""
        reached = float(self.time[0]) if self.is_watching else self.done * self.step
        status, trouble = judge_end(self.word, reached, reached)
        counts = self.events.counts
        return RawTrajectory(
            **self.reached(reached),
            status=status,
            message=f"{trouble}: take a smaller step"
            if trouble
            else f"fixed step {self.step:.6g} s{self.events.told}",
            method=self.bound.spec.name,
            n_steps=self.done,
            n_evaluations=int(counts.n_evaluations) if self.is_watching else 4 * self.done + 1,
            step=self.step,
            log=self.events.log(),
        )
