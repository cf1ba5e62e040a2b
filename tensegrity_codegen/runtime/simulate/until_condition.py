"""Motions that a condition ends: what the integrator shall watch, and the event at the end."""

from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.integrate.event_log import Condition, Watch
from tensegrity_codegen.runtime.integrate.methods import METHODS, find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.knots import follows_in_c
from tensegrity_codegen.runtime.simulate.condition import build_condition, is_comparison
from tensegrity_codegen.runtime.trajectory.motion_event import MotionEvent
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import JUMP_KINDS


def watch_condition(
    model: CompiledModel,
    method: str,
    condition: str | Condition | None,
    is_end: bool,
    arguments: Mapping[str, Any],
    schedule: Schedule | None = None,
) -> Watch | None:
    """Return what the integrator shall watch: a condition, if there is one, and the cables if it knows them.

    is_end: whether the condition ends the run. Raises InvalidValueError for a method that watches none, as
    those are that follow a schedule unless it is a profile in C, and what build_condition raises.
    """
    if condition is None:
        return None
    if not (isinstance(condition, str) or callable(condition)):
        raise InvalidValueError(
            "not a condition",
            where="condition",
            given=condition,
            allowed='a text such as "top.z < 0.1", or a function (time, coordinate, velocity) -> float',
        )
    if not find_method(method).finds_events:
        raise InvalidValueError(
            "this method does not monitor conditions",
            where="condition",
            given=method,
            allowed=", ".join(list_methods("finds_events")),
        )
    if schedule is not None and not follows_in_c(schedule, model.manifest):
        raise InvalidValueError(
            "a run with this schedule uses SciPy, which does not monitor conditions",
            where="condition",
            given="schedule and condition",
            allowed="one of them",
            hint="make the schedule a Profile of inputs, or evaluate the condition at the samples of the run",
        )
    call = build_condition(condition, model, arguments, schedule) if isinstance(condition, str) else condition
    known = next((spec.events for spec in model.manifest.integrators if METHODS[spec.name].finds_events), ())
    kinds = (*(kind for kind in known if kind in JUMP_KINDS), "condition")
    return Watch(kinds, ("condition",) if is_end else (), call)


def stop_at_condition(
    motion: Motion, options: RunOptions, condition: str | Condition
) -> tuple[RawTrajectory, tuple[MotionEvent, ...]]:
    """Return the samples up to where the watched condition ends the motion, and that event if it does.

    A comparison that holds from the start ends it at once.
    """
    call, n = motion.watch.condition if motion.watch else None, len(motion.state) // 2
    name = condition if isinstance(condition, str) else "condition"
    compares = isinstance(condition, str) and is_comparison(condition)
    if compares and call is not None and call(0.0, motion.state[:n], motion.state[n:]) > 0:
        start, said = motion.state[None, :], "the condition holds from the start"
        raw = RawTrajectory(motion.sample_time[:1], start, "ok", said, options.method, 0, 0)
        return raw, (_event(raw, name),)
    raw = integrate(motion, options)
    is_over = raw.log.count and raw.log.kind[-1] == "condition" and raw.time[-1] >= raw.log.time[-1]
    return raw, (_event(raw, name),) if is_over else ()


def _event(raw: RawTrajectory, name: str) -> MotionEvent:
    """Return the event at the last sample of a run."""
    n, state = raw.state.shape[1] // 2, raw.state[-1]
    return MotionEvent("condition", (name,), float(raw.time[-1]), 0.0, state[:n], state[n:])
