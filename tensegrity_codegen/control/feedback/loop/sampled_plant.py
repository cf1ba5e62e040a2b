"""The full model between two commands: integrated in C, cut where inputs or forces on nodes change.

And the start of a loop: whether its parts fit each other and the motion, state, arguments, gusts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.runtime.integrate.event_run import EventRun
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.motion import Motion as Integrated
from tensegrity_codegen.runtime.model.arguments import INPUT, check_arguments, merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles, to_sized
from tensegrity_codegen.runtime.model.interface import name_moving_states
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_positive, check_whole, is_number
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest
from tensegrity_codegen.tables.manifest import Manifest

NODE_LOAD = "node_load"
RTOL, ATOL = 1e-9, 1e-11
MAX_STEPS = 100_000  # of one interval
MAX_CORRECTIONS = 4  # of lengths of rigid bars, each of which squares their error
ENDINGS = ("non_finite_result", "step_too_small", "too_many_events")

SAMPLE = 0.005  # [s], if no gains state another
MAX_SAMPLES = 1_000_000


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
    """Disturbances of a simulated closed loop that its controller does not know.

    Attributes
    ----------
    coordinate_error, velocity_error : array_like, shape (n_coordinates,), optional
        Added to the state of the motion at its start.
    axial_stiffness : array_like, shape (k,), optional [N]
        Of the simulated model, in the order of its run-time parameter.
    arguments : mapping, optional
        Run-time parameters of the simulated model if they differ from the scene.
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
    """Gusts on a model whose loads can change at run time."""

    gusts: tuple[Gust, ...]
    row: tuple[int, ...]  # row of each one's node among the changeable loads
    axes: tuple[int, ...]  # modelled axes
    base: FloatArray  # (k, n_axes) [N]: loads without gusts

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
    """Return the loads of gusts, None without one."""
    stated = () if gust is None else (gust,) if isinstance(gust, Gust) else gust
    check_instance(stated, (list, tuple), "gust", "a Gust, or a list of them")
    gusts = tuple(stated)
    if not gusts:
        return None
    spec = model.manifest.find_argument(NODE_LOAD)
    nodes = () if spec is None else spec.over
    for one_gust in gusts:
        _check(one_gust)
        if one_gust.node not in nodes:
            raise UnknownNameError(
                "the load of this node cannot change at run time",
                where="gust.node",
                given=one_gust.node,
                allowed=", ".join(nodes) or "none: the library has no run-time parameter node_load",
                hint=suggest(one_gust.node, nodes) or 'compile the scene for "control"',
            )
    nominal = model.nominal(NODE_LOAD)
    loads = nominal if base is None else np.asarray(base, dtype=float).reshape(nominal.shape)
    rows = tuple(nodes.index(one_gust.node) for one_gust in gusts)
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
        for begin, stop in zip([start, *cuts], [*cuts, end], strict=True):
            if self._gusts is not None and NODE_LOAD in self._bound.passed:
                self._bound.passed[NODE_LOAD][:] = self._gusts.at(0.5 * (begin + stop))
            if not self._integrate(stop - begin):
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
            *(span, RTOL, ATOL, MAX_STEPS, time, step),
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


# Parts of one loop: whether they fit each other and the motion.


def check_parts(
    manifest: Manifest,
    motion: Motion,
    gains: Gains | None,
    estimator: Estimator | None,
    distribution: TensionDistribution | None,
) -> None:
    """Raise InvalidValueError for gains, an estimator or a distribution of another model or motion."""
    check_instance(gains, (Gains, type(None)), "gains", "Gains of design_lqr, or None")
    check_instance(estimator, (Estimator, type(None)), "estimator", "an Estimator of design_kalman, or None")
    if distribution is not None:
        made = getattr(distribution, "bounds", None)
        check_instance(made, ActuatorBounds, "distribution", "a TensionDistribution of design_distribution")
    states, members = name_moving_states(manifest), manifest.member_name
    fitting = {
        "gains": gains is None or (gains.actuators == motion.actuators and gains.state_name == states),
        "estimator": estimator is None or estimator.state_name[: len(states)] == states,
        "distribution": distribution is None
        or (
            distribution.bounds.names == motion.actuators
            and distribution.model.manifest.member_name == members
        ),
    }
    for name, fits in fitting.items():
        if not fits:
            raise InvalidValueError(
                "designed for another model or motion",
                where=name,
                given=f"a design for other actuators, states or members than those of {manifest.name}",
                allowed=f"a design for the actuators {', '.join(motion.actuators)}",
            )


def describe_unknown_delays(gains: Gains | None, bounds: ActuatorBounds) -> str:
    """Return a sentence if gains are designed for other delays than those of the actuators, else ""."""
    if gains is None or np.allclose(gains.delay, bounds.delay, rtol=1e-9, atol=1e-12):
        return ""
    designed, late = 1000 * float(gains.delay.max(initial=0.0)), 1000 * float(bounds.delay.max(initial=0.0))
    return (
        f"the gains are designed for delays of up to {designed:.3g} ms, and the actuators answer up to "
        f"{late:.3g} ms late: design_lqr(..., delay=...) takes the delays of the actuators"
    )


def find_sample(gains: Gains | None, estimator: Estimator | None, sample: float | None) -> float:
    """Return the time between two commands [s], which gains and estimator must share."""
    stated = [design.sample for design in (gains, estimator) if design is not None]
    stated += [] if sample is None else [check_positive(sample, "sample", "[s]")]
    chosen = stated[0] if stated else SAMPLE
    if any(value != chosen for value in stated):
        raise InvalidValueError(
            "gains and estimator are for another sample time",
            where="sample",
            given=", ".join(f"{value!r} s" for value in stated),
            allowed="one sample time of gains, estimator and simulation",
        )
    return check_positive(chosen, "sample", "[s]")


# The start of a simulated loop: number of samples, state, arguments of the simulated model.


def count_samples(t_end: float, sample: float) -> int:
    """Return the whole samples until an end [s]; raises InvalidValueError for none or too many."""
    count = t_end / sample if is_number(t_end) else np.nan
    if not np.isfinite(count) or not 1.0 - 1e-9 <= count <= MAX_SAMPLES:
        raise InvalidValueError(
            "out of range",
            where="t_end",
            given=t_end,
            allowed=f"{sample:g} to {MAX_SAMPLES * sample:g} s, 1 to {MAX_SAMPLES} samples",
        )
    return int(np.floor(count + 1e-9))


@dataclass(frozen=True, eq=False)
class LoopStart:
    """Start (n_states,) of a simulated loop, arguments of its model, loads that change, seed of the noise."""

    state: FloatArray
    given: Mapping[str, Any]
    gusts: GustLoad | None
    seed: int


def read_disturbance(
    model: CompiledModel, motion: Motion, disturbance: Disturbance | None, where: str = "disturbance"
) -> LoopStart:
    """Return the start of a loop."""
    check_instance(disturbance, (Disturbance, type(None)), where, "a Disturbance")
    stated = disturbance or Disturbance()
    seed = check_whole(stated.seed, "seed" if where == "disturbance" else f"{where}.seed", 0)
    arguments = merge_inputs(model.manifest, stated.arguments)
    if stated.axial_stiffness is not None:
        allowed = "one stiffness for each member of the run-time parameter [N]"
        arguments["axial_stiffness"] = to_doubles(stated.axial_stiffness, "axial_stiffness", allowed)
    check_arguments(model.manifest, arguments)
    if model.manifest.internal_name:
        arguments["internal"] = motion.at(0.0).internal
    start = _build_state(model, motion, stated)
    return LoopStart(start, arguments, bind_gust(model, stated.gust, arguments.get(NODE_LOAD)), seed)


def _build_state(model: CompiledModel, motion: Motion, stated: Disturbance) -> FloatArray:
    """Return the state of the motion at its start, with errors that rigid bars allow."""
    point = motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    n = len(point.coordinate)
    for start, name in ((0, "coordinate_error"), (n, "velocity_error")):
        value = getattr(stated, name)
        if value is not None:
            error = to_sized(value, (n,), name).ravel()
            check_finite(error, name)
            state[start : start + n] += error
    return keep_bars(model, state)


def keep_bars(model: CompiledModel, state: FloatArray) -> FloatArray:
    """Move a state (q, q') to the nearest one in which rigid bars have their lengths, and return it."""
    n = len(state) // 2
    for name, part in (("coordinate", slice(0, n)), ("velocity", slice(n, 2 * n))):
        for _ in range(MAX_CORRECTIONS if model.manifest.rigid_bar else 0):
            at = {"coordinate": state[:n], "velocity": state[n:]}
            state[part] = model.compute(f"consistent_{name}", **at)
    return state
