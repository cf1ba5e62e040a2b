"""The full model between two commands: integrated in C, cut where inputs or forces on nodes change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.integrate.event_run import EventRun
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion as Integrated
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT
from tensegrity_codegen.runtime.trajectory.control_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, is_number
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest

NODE_LOAD = "node_load"
RTOL, ATOL = 1e-9, 1e-11
MOST_STEPS = 100_000  # of one interval
ENDINGS = ("non_finite_result", "step_too_small", "too_many_events")


@dataclass(frozen=True)
class Gust:
    """A force on one node for a limited time.

    Attributes
    ----------
    node : str
        Name of the node.
    force : tuple of float, shape (3,) [N]
        Force, constant in direction.
    start, duration : float [s]
        When it begins, and how long it lasts.
    """

    node: str
    force: tuple[float, float, float]
    start: float = 0.0
    duration: float = 0.2

    @property
    def end(self) -> float:
        """Time at which it ends [s]."""
        return self.start + self.duration


@dataclass(frozen=True, eq=False)
class Disturbance:
    """What a simulated closed loop has and its controller does not know.

    Attributes
    ----------
    coordinate_error, velocity_error : array_like, shape (n_coordinates,), optional
        Added to the state of the motion at its start.
    axial_stiffness : array_like, shape (k,), optional [N]
        Of the simulated model, in the order of its run-time parameter.
    arguments : mapping, optional
        Run-time parameters of the simulated model where they differ from the scene.
    gust : Gust or sequence of Gust, optional
        Forces on nodes for a limited time.
    seed : int
        Of the noise of the measurements.
    """

    coordinate_error: ArrayLike | None = None
    velocity_error: ArrayLike | None = None
    axial_stiffness: ArrayLike | None = None
    arguments: Mapping[str, Any] | None = None
    gust: Gust | Sequence[Gust] | None = None
    seed: int = 0


@dataclass(frozen=True)
class GustLoad:
    """Gusts on a model whose loads can change at run time.

    row: row of each one's node among the changeable loads.
    axes: modelled axes.
    base (k, n_axes) [N]: loads without gusts.
    """

    gusts: tuple[Gust, ...]
    row: tuple[int, ...]
    axes: tuple[int, ...]
    base: FloatArray

    def at(self, time: float) -> FloatArray:
        """Return the loads at a time [s], (k, n_axes) [N]; at a change those after it."""
        load = self.base.copy()
        for gust, row in zip(self.gusts, self.row, strict=True):
            if gust.start <= time < gust.end:
                load[row] += np.array(gust.force)[list(self.axes)]
        return load

    def changes_between(self, start: float, end: float) -> list[float]:
        """Return the times at which loads change, after `start` and before `end` [s]."""
        times = {time for gust in self.gusts for time in (gust.start, gust.end)}
        return sorted(time for time in times if start < time < end)


def bind_gust(
    model: CompiledModel, gust: Gust | Sequence[Gust] | None, base: FloatArray | None
) -> GustLoad | None:
    """Return the loads of gusts, None without one.

    model: with the run-time parameter `node_load`.
    base [N]: loads of the nodes in the order of the parameter; by default those of the scene.
    Raises UnknownNameError: the loads of the node cannot change.
    Raises InvalidValueError: a force that is no vector of numbers, or a time out of range.
    """
    stated = () if gust is None else (gust,) if isinstance(gust, Gust) else gust
    check_instance(stated, (list, tuple), "gust", "a Gust, or a list of them")
    gusts = tuple(stated)
    if not gusts:
        return None
    spec = next((item for item in model.manifest.arguments if item.name == NODE_LOAD), None)
    known = () if spec is None else spec.over
    for item in gusts:
        _check(item)
        if item.node not in known:
            raise UnknownNameError(
                "the load of this node cannot change at run time",
                where="gust.node",
                given=item.node,
                allowed=", ".join(known) or "none: the library has no run-time parameter node_load",
                hint=suggest(item.node, known) or 'compile the scene for "control"',
            )
    nominal = model.nominal(NODE_LOAD)
    loads = nominal if base is None else np.asarray(base, dtype=float).reshape(nominal.shape)
    rows = tuple(known.index(item.node) for item in gusts)
    return GustLoad(gusts, rows, tuple(model.manifest.axes), loads)


def _check(gust: Gust) -> None:
    check_instance(gust, Gust, "gust", "a Gust, or a list of them")
    check_instance(gust.node, str, "gust.node", "the name of a node")
    force = to_doubles(gust.force, "gust.force", "three finite numbers [N]")
    if force.shape != (3,) or not np.isfinite(force).all():
        raise InvalidValueError(
            "not a force", where="gust.force", given=gust.force, allowed="three finite numbers [N]"
        )
    check_span(gust.start, gust.duration)


def check_span(start: float, duration: float) -> None:
    """Raise InvalidValueError for a time [s] of a gust that is no finite number from 0 on."""
    for name, value in (("start", start), ("duration", duration)):
        if not is_number(value) or value < 0.0:
            raise InvalidValueError(
                "out of range", where=f"gust.{name}", given=value, allowed="a finite number >= 0 [s]"
            )


# The full model between two commands: integrated in C, cut where inputs or loads change.


class SampledPlant:
    """A model that is integrated from one time to the next, with inputs constant in between.

    model: with the integrator CONTROL_METHOD.
    state (n_states,): state at time 0.
    arguments: run-time parameters and inputs.
    gusts: loads that change with time.
    word: status of the last integration: "ok", or why it stopped.
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
        """Coordinates, velocities and internal states now, (n_states + n_internal,)."""
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
