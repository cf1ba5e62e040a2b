"""The counters of one run in C, with the events that it watches and the log that it fills."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.event_log import EMPTY_LOG, MAX_LOGGED, EventLog, choose_watch
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.raw_results import say_unmonitored
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.integrators import find_row

EVENT_ROW = np.dtype(
    {"names": ["time", "kind", "which", "direction"], "formats": ["f8", "i4", "i4", "i4"], "itemsize": 24}
)


class EventRun:
    """The counters of a run in C, with the events that it watches."""

    def __init__(self, bound: BoundIntegrator, motion: Motion) -> None:
        ffi, self.bound, self.manifest = bound.ffi, bound, motion.model.manifest
        self.watch = choose_watch(bound.spec, self.manifest, motion.watch)
        self.raised: list[BaseException] = []
        self.has_events = bool(bound.spec.events)
        # Others without events or profiles are called without counters, which their header may lack.
        row = find_row(bound.spec.name, self.manifest.needs_state_jacobian)
        is_adaptive = row.kind == "adaptive"
        self.is_counted = self.has_events or is_adaptive or bool(self.manifest.driven)
        counts: Any = ffi.new("integrator_run *") if self.is_counted else None
        self.counts = counts
        if bound.knots is not None:
            self.counts.profile = bound.knots.struct
        if not self.has_events:
            return
        self.rows = np.empty(MAX_LOGGED if self.watch.kinds else 0, dtype=EVENT_ROW)
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
                value = condition(time, q.copy(), v.copy())
                return _check_finite(to_sized(value, (), "condition").item(), time, q, v)
            except BaseException as error:
                self.raised.append(error)
                return float("nan")

        return call

    def raise_own(self) -> None:
        """Raise what the condition has raised."""
        if self.raised:
            raise self.raised[0]

    @property
    def trials(self) -> int:
        """Steps tried so far."""
        return int(self.counts.n_accepted + self.counts.n_rejected)

    @property
    def is_over(self) -> bool:
        """Whether an event has ended the run."""
        return self.has_events and bool(self.counts.is_stopped)

    @property
    def told(self) -> str:
        """How many events there were, and which are not watched, to be added to a message."""
        count = self.counts.n_events if self.has_events else 0
        note = f", {describe_count(count, 'event')}" if count else ""
        spec, contacts = self.bound.spec, self.manifest.contact_name
        unseen = say_unmonitored(spec.unwatched, 0 if "ground" in spec.events else len(contacts))
        return f"{note}{unseen} (model.events)" if unseen else note

    def samples(self, sample_time: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """Return times and states reached; where an event has ended the run, that `time` [s] too."""
        reached = self.bound.n_reached
        times, states = sample_time[:reached], self.bound.samples[:reached]
        if self.is_over and times[-1] < time:
            return np.append(times, time), np.vstack([states, self.bound.state])
        return times, states

    def log(self) -> EventLog:
        """Return the events so far."""
        count = int(self.counts.n_events) if self.has_events else 0
        if not count:
            return EMPTY_LOG
        return EventLog.from_rows(self.rows[:count], count, self.manifest)


def _check_finite(value: float, time: float, coordinate: FloatArray, velocity: FloatArray) -> float:
    """Return the value of a condition; NonFiniteError if it is not finite and the motion is."""
    if not np.isfinite(value) and np.isfinite(coordinate).all() and np.isfinite(velocity).all():
        raise NonFiniteError(
            f"the condition is not a finite number at t = {time:.6g} s",
            where="condition",
            given=value,
            allowed="a function whose value is a finite number along the whole motion",
        )
    return value
