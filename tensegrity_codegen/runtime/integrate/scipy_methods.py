"""SciPy's methods over the generated functions: a check, and for arguments that change with time."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.integrate.event_log import EventLog
from tensegrity_codegen.runtime.integrate.methods import find_method
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory, judge_end
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.runtime.profiles.pieces import SCHEDULE_SAMPLES, locate_jumps
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError, NonFiniteError

# Of the time, where a function of time may change anything, or bars may touch: steps must not pass over it.
MAX_STEP = 0.01
SAME_DISTANCE = 1e-9  # of the largest coordinate: pairs of bars this near touch with the first one


def build_derivative(
    model: CompiledModel, arguments: Mapping[str, Any], schedule: Schedule | None = None
) -> Callable[[float, FloatArray], FloatArray]:
    """Return (t [s], x) -> x' = (q', H^-1 f), with arguments that a schedule may change with time."""
    n = len(model.manifest.coordinate_name)

    def derivative(t: float, x: FloatArray) -> FloatArray:
        given = arguments if schedule is None else {**arguments, **schedule(t)}
        a = model.compute("acceleration", coordinate=x[:n], velocity=x[n:], **given)
        return np.concatenate([x[n:], a])

    return derivative


class _Steps:
    """The steps of a run, which SciPy shows to what it takes for an event: counted, told and limited."""

    def __init__(self, motion: Motion, most: int) -> None:
        self.motion, self.most, self.count = motion, most, 0

    def __call__(self, time: float, state: FloatArray) -> float:
        self.count += time > 0.0
        if self.count > self.most and time < self.motion.t_end:
            raise ConvergenceError("too many steps", evidence={"time": time})
        self.motion.report(time / self.motion.t_end)
        return 1.0


class _Contact:
    """The least distance between bars [m], which ends a run of SciPy where it falls through zero."""

    terminal, direction = True, -1

    def __init__(self, motion: Motion) -> None:
        self.motion = motion

    def __call__(self, time: float, state: FloatArray) -> float:
        return float(self._measure(time, state).min())

    def _measure(self, time: float, state: FloatArray) -> FloatArray:
        schedule = self.motion.schedule
        return find_distances(self.motion, state, schedule(time) if schedule else {})

    def log(self, time: float, state: FloatArray) -> EventLog:
        """Return the pairs of bars that touch at a time [s]."""
        distance, size = self._measure(time, state), float(np.abs(state[: len(state) // 2]).max())
        names = self.motion.model.manifest.bar_pair_name
        touching = tuple(names[k] for k in np.flatnonzero(distance <= distance.min() + SAME_DISTANCE * size))
        count = len(touching)
        return EventLog(np.full(count, time), ("contact",) * count, touching, np.full(count, -1), count)


def find_distances(
    motion: Motion, state: FloatArray, changed: Mapping[str, Any] = MappingProxyType({})
) -> FloatArray:
    """Return the distances between bars [m] at a state (n_states,), pair by pair.

    changed: arguments by name that differ from those of the motion.
    """
    given = {**motion.arguments, **changed, "coordinate": state[: len(state) // 2]}
    return np.asarray(motion.model.compute("bar_distance", **given))


def integrate_scipy(motion: Motion, options: RunOptions, longest: float = np.inf) -> RawTrajectory:
    """Integrate a motion by a method of SciPy, begun anew at every kink of a profile.

    longest: step [s]. A contact of bars that is watched ends it; steps are at most a hundredth of the time
    then. Status "unstable" where SciPy does not come to the end, "not_converged" after max_steps steps.
    """
    manifest = motion.model.manifest
    if manifest.contact_name:
        raise refuse_ground(manifest.name, f"method {options.method!r}")
    if manifest.internal_name:
        raise FormulationError(
            "methods of SciPy know no internal states: members with memory, and motors with a time constant",
            where=manifest.name,
            given=options.method,
            allowed="methods in C",
            hint='method="rk853"',
        )
    method, times = find_method(options.method).scipy, motion.sample_time
    state, count, steps = motion.state, 0, _Steps(motion, options.max_steps)
    contact = _Contact(motion) if motion.watch and "contact" in motion.watch.stop else None
    states: list[FloatArray] = []

    def finish(status: str, message: str) -> RawTrajectory:
        kept = np.array(states) if states else motion.state[None, :]  # the first one is there in any case
        name = f"scipy {method}"
        return RawTrajectory(times[: len(kept)], kept, status, message + seen, name, steps.count, count)

    kinks: list[float] = []
    seen = ""
    if isinstance(motion.schedule, DrivenArguments):
        pieces = motion.schedule.pieces
        kinks = [time for time in pieces.time[pieces.is_kink].tolist() if time < motion.t_end]
    elif motion.schedule is not None:
        kinks = locate_jumps(motion.schedule, motion.t_end)
        seen = f"; pulses of the schedule shorter than {motion.t_end / SCHEDULE_SAMPLES:.3g} s are not seen"
    for start, end in pairwise((0.0, *kinks, motion.t_end)):
        is_last = end == motion.t_end
        inside = times[(times >= start) & ((times < end) | is_last)]
        try:
            found = _run(motion, options, longest, (start, end), state, inside, (steps, contact))
        except NonFiniteError as error:
            return finish("unstable", error.problem)
        except ConvergenceError as error:
            return finish(*judge_end("ok", error.evidence["time"], motion.t_end))
        count += int(found.nfev)
        reached = found.y.T[: len(inside)]
        if found.status == 1 and contact is not None:
            touch, state = float(found.t_events[1][-1]), found.y_events[1][-1]
            states += list(reached[: np.count_nonzero(found.t < touch)])
            whole = finish("ok", f"{steps.count} steps")
            return replace(
                whole,
                time=np.append(whole.time, touch),
                state=np.vstack([whole.state, state]),
                log=contact.log(touch, state),
            )
        if found.status != 0 or len(found.t) == 0:
            states += list(reached[: len(found.t)])
            return finish("unstable", str(found.message))
        states += list(reached)
        state = found.y[:, -1]
    return finish("ok", f"{steps.count} steps")


def _run(
    motion: Motion,
    options: RunOptions,
    longest: float,
    span: tuple[float, float],
    state: FloatArray,
    inside: FloatArray,
    watched: tuple[_Steps, _Contact | None],
) -> Any:
    """Return what SciPy finds at the times `inside` a span and, where it ends at a kink, at its end."""
    schedule = motion.schedule
    is_function = schedule is not None and not isinstance(schedule, DrivenArguments)
    until = span[1] < motion.t_end
    last = float(np.nextafter(span[1], span[0]))  # before a jump
    own = None if schedule is None else (lambda t: schedule(min(t, last) if until else t))
    derivative = build_derivative(motion.model, motion.arguments, own)
    times = np.append(inside, span[1]) if until else inside
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what they say is in the status
        return scipy.integrate.solve_ivp(
            derivative,
            span,
            state,
            find_method(options.method).scipy,
            t_eval=times,
            rtol=options.rtol,
            atol=options.absolute,
            max_step=min(longest, MAX_STEP * motion.t_end if is_function or watched[1] else np.inf),
            events=[event for event in watched if event is not None],
        )
