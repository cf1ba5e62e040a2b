"""The full model between two commands: integrated in C, cut where inputs or loads change."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.loop.disturbances import NODE_LOAD, GustLoad
from tensegrity_codegen.runtime.integrate.event_run import EventRun
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion as Integrated
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.trajectory.control_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray

RTOL, ATOL = 1e-9, 1e-11
MOST_STEPS = 100_000  # of one interval
ENDINGS = ("non_finite_result", "step_too_small", "too_many_events")


class SampledPlant:
    """A model that is integrated from one time to the next, with inputs constant in between.

    Parameters
    ----------
    model : CompiledModel
        With the integrator CONTROL_METHOD.
    state : ndarray, shape (n_states,)
        State at time 0.
    arguments : mapping
        Run-time parameters and inputs.
    gusts : GustLoad, optional
        Loads that change with time.

    Attributes
    ----------
    word : str
        Status of the last integration: "ok", or why it stopped.
    """

    def __init__(
        self,
        model: CompiledModel,
        state: FloatArray,
        arguments: Mapping[str, Any],
        gusts: GustLoad | None = None,
    ) -> None:
        self._motion = Integrated(model, state, np.array([0.0, 1.0]), arguments)
        self._bound = BoundIntegrator(CONTROL_METHOD, self._motion)
        self._bound.passed = {name: value.copy() for name, value in self._bound.passed.items()}
        self._gusts = gusts
        self.word = "ok"

    @property
    def state(self) -> FloatArray:
        """Coordinates and velocities now, (n_states,)."""
        return self._bound.state.copy()

    def arguments(self) -> dict[str, FloatArray]:
        """Return the run-time arguments now."""
        return {name: value.copy() for name, value in self._bound.passed.items()}

    def advance(self, start: float, end: float, value: FloatArray) -> bool:
        """Integrate from one time [s] to another with inputs (n_inputs,); return whether that succeeded."""
        if INPUT in self._bound.passed:
            self._bound.passed[INPUT].reshape(-1)[:] = value
        cuts = [] if self._gusts is None else self._gusts.changes_between(start, end)
        for first, last in zip([start, *cuts], [*cuts, end], strict=True):
            if self._gusts is not None and NODE_LOAD in self._bound.passed:
                self._bound.passed[NODE_LOAD][:] = self._gusts.at(0.5 * (first + last))
            if not self._integrate(last - first):
                return False
        return True

    def _integrate(self, span: float) -> bool:
        """Integrate over a time span [s], with a fresh start of the step control."""
        bound, events = self._bound, EventRun(self._bound, self._motion)
        time, step = bound.ffi.new("double *", 0.0), bound.ffi.new("double *", 0.0)
        bound.sample_time[:] = 0.0, span
        bound.samples[0] = bound.state
        bound.n_sampled[0] = 1
        status = bound.call(
            *(span, RTOL, ATOL, MOST_STEPS, time, step),
            bound.pointer(bound.state),
            *bound.arguments(),
            2,
            bound.pointer(bound.sample_time),
            bound.pointer(bound.samples),
            bound.n_sampled,
            events.counts,
            bound.pointer(bound.work),
        )
        self.word = bound.check(status, ENDINGS)
        if self.word == "ok" and float(time[0]) < span:
            self.word = "step_too_small"
        return self.word == "ok"
