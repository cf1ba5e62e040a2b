"""The problem of an integration: a model from a state on, over sample times."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.pieces import Schedule as Schedule
from tensegrity_codegen.system.arrays import FloatArray

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion x' = (q', H^-1 f) of a model from x(0) = state.

    state (n_states,), for a batch (n_batch, n_states): coordinates, then velocities; sample_time (n_t,) [s]:
    from 0 up; arguments: run-time parameters and inputs by name, the scene's where they are missing;
    progress: called with the fraction done; watch: events at which steps are cut, None: cables that go slack
    or taut; schedule: arguments that change with time, whose values at 0 are in `arguments` where it is bound
    to knots (DrivenArguments). The argument `internal` is where internal states start; if missing, viscous
    members start relaxed where the motion starts, others from zero.
    """

    model: CompiledModel
    state: FloatArray
    sample_time: FloatArray
    arguments: Mapping[str, Any] = field(default_factory=dict)
    progress: Progress | None = None
    watch: Watch | None = None
    schedule: Schedule | None = None

    @property
    def t_end(self) -> float:
        """The time of the last sample [s]."""
        return float(self.sample_time[-1])

    def report(self, fraction: float) -> None:
        """Tell whoever wants to know which part is done."""
        if self.progress is not None:
            self.progress(fraction)
