"""Events of a motion: the first contact of bars, the first slack of cables, located by root finding.

The samples of a motion are far apart; each interval is split into parts of about one step of the integrator.
In a part a margin g (distance between bars, extension of a cable) falls through zero where its sign changes,
or where it is positive at both ends but falls at the first and rises at the second: the tangents at the ends
say whether its least value is worth a search, the zero of its rate where that is. Brent's method finds the
zeros, on states that are integrated anew from the start of the part.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.flow import Flow
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.margins import Margins, build_contact_margins, build_slack_margins
from tensegrity_codegen.runtime.trajectory.motion_event import MotionEvent
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.arrays import FloatArray

TIGHT = 1e-13  # relative tolerance of the states that events are located on
BETWEEN = 1e-8  # relative tolerance of the states that split an interval
EVALUATIONS = 24  # of the derivative, that a part of an interval is worth: four steps of rk54
SAME = 1e-9  # of the simulated time: events this near happen at once
MOST_PARTS = 1000  # at once, which bounds the memory
WORTH = 0.5  # of the smaller end value, that the tangents must fall to before the least value is sought


def find_contact(
    model: CompiledModel,
    trajectory: Trajectory,
    *,
    arguments: Mapping[str, Any] | None = None,
    schedule: Schedule | None = None,
) -> tuple[MotionEvent, ...]:
    """Find the first contact of each pair of bars in a simulated motion.

    Parameters
    ----------
    model : CompiledModel
        With the quantities ``bar_distance`` and ``bar_distance_jacobian``.
    trajectory : Trajectory
        The motion.
    arguments, schedule : optional
        As for the simulation of the trajectory.

    Returns
    -------
    tuple of MotionEvent
        One event for each pair that touches, in the order of time; pairs that overlap at the start have t =
        0.

    Raises
    ------
    FormulationError
        The model lacks a quantity.
    ConvergenceError
        The motion between two samples cannot be integrated again.
    """
    margins = build_contact_margins(model, arguments or {})
    return _find(margins, Flow(model, arguments or {}, schedule), _raw(trajectory))


def find_slack(
    model: CompiledModel,
    trajectory: Trajectory,
    members: Sequence[str],
    *,
    arguments: Mapping[str, Any] | None = None,
    schedule: Schedule | None = None,
) -> tuple[MotionEvent, ...]:
    """Find when each of some cables first goes slack in a simulated motion.

    Parameters
    ----------
    model : CompiledModel
        With the quantity ``member_extension``.
    trajectory : Trajectory
        The motion.
    members : sequence of str
        Names of the cables.
    arguments, schedule : optional
        As for the simulation of the trajectory.

    Returns
    -------
    tuple of MotionEvent
        One event for each cable that goes slack, in the order of time; a cable that is slack at the start has
        t = 0.

    Raises
    ------
    FormulationError
        The model lacks the quantity or a member.
    ConvergenceError
        The motion between two samples cannot be integrated again.
    """
    margins = build_slack_margins(model, tuple(members), arguments or {}, schedule)
    return _find(margins, Flow(model, arguments or {}, schedule), _raw(trajectory))


def stop_at_contact(
    motion: Motion, integrate: Callable[[Motion], RawTrajectory]
) -> tuple[RawTrajectory, tuple[MotionEvent, ...]]:
    """Return the samples up to the first contact and the state there, and that event; all if there is none.

    integrate: motion -> samples. What goes wrong after the contact does not matter: a run that did
    not end well is made again up to the sample after the contact. Raises as find_contact.
    """
    margins = build_contact_margins(motion.model, motion.arguments)
    flow = Flow(motion.model, motion.arguments, motion.schedule)
    raw = integrate(motion)
    events = _find(margins, flow, raw, only_first=True)
    if events and raw.status != "ok":
        times = motion.sample_time
        times = times[: max(2, int(np.sum(times <= events[0].time)) + 1)]
        raw = integrate(replace(motion, sample_time=times))
        events = _find(margins, flow, raw, only_first=True)
    if not events:
        return replace(raw, message="; ".join(filter(None, [raw.message, "no contact"]))), ()
    event = events[0]
    before = raw.time < event.time
    said = f"contact of {', '.join(event.names)} at t = {event.time:.9g} s"
    stopped = replace(
        raw,
        time=np.append(raw.time[before], event.time),
        state=np.vstack([raw.state[before], np.concatenate([event.coordinate, event.velocity])]),
        message="; ".join(filter(None, [raw.message, said])),
    )
    return stopped, (event,)


@dataclass(frozen=True)
class _Stretch:
    """A stretch of the motion in parts: times (n + 1,), and states, margins and their rates, a row a time."""

    time: FloatArray
    state: FloatArray
    values: FloatArray
    rates: FloatArray


@dataclass(frozen=True)
class _Found:
    """One margin that falls through zero."""

    index: int
    time: float
    state: FloatArray


def _raw(trajectory: Trajectory) -> RawTrajectory:
    state = np.hstack([trajectory.coordinate, trajectory.velocity])
    return RawTrajectory(
        trajectory.time, state, trajectory.status, "", trajectory.method, 0, trajectory.n_evaluations
    )


def _find(
    margins: Margins, flow: Flow, raw: RawTrajectory, *, only_first: bool = False
) -> tuple[MotionEvent, ...]:
    """Return the events of the motion; only_first: the first alone."""
    found: list[_Found] = []
    same = SAME * float(raw.time[-1])

    def is_over(time: float) -> bool:
        return only_first and bool(found) and min(item.time for item in found) + same < time

    pending = margins.values(raw.time[0], raw.state[0]) > margins.floor
    found += [_Found(int(k), float(raw.time[0]), raw.state[0]) for k in np.flatnonzero(~pending)]
    for stretch in _split(margins, flow, raw):
        if not pending.any() or is_over(float(stretch.time[0])):
            break
        for part, index in np.argwhere(_suspects(stretch)):
            if is_over(float(stretch.time[part])):
                break
            item = _locate(margins, flow, stretch, part, index) if pending[index] else None
            if item is not None:
                found.append(item)
                pending[index] = False
    events = _gather(margins, found, same)
    return events[:1] if only_first else events


def _split(margins: Margins, flow: Flow, raw: RawTrajectory) -> Iterator[_Stretch]:
    """Yield the motion in stretches, in order."""
    count = max(1, int(np.ceil(raw.n_evaluations / EVALUATIONS / max(1, len(raw.time) - 1))))
    for k in range(len(raw.time) - 1):
        time, state = np.linspace(raw.time[k], raw.time[k + 1], count + 1), raw.state[k]
        for first in range(0, count, MOST_PARTS):
            times = time[first : first + MOST_PARTS + 1]
            is_last = first + MOST_PARTS >= count
            inner = times[:-1] if is_last else times
            states = flow.states(float(times[0]), state, inner - times[0], BETWEEN)
            if is_last:
                states = np.vstack([states, raw.state[k + 1]])
            state = states[-1]
            pairs = list(zip(times.tolist(), states, strict=True))
            values = np.array([margins.values(t, x) for t, x in pairs])
            yield _Stretch(times, states, values, np.array([margins.rates(t, x) for t, x in pairs]))


def _suspects(stretch: _Stretch) -> NDArray[np.bool_]:
    """Return part by part which margins are not positive at its end, or may fall to zero and rise within."""
    first, last = stretch.values[:-1], stretch.values[1:]
    fall, rise = stretch.rates[:-1], stretch.rates[1:]
    length = np.diff(stretch.time)[:, None]
    turns = (fall < 0) & (rise > 0)
    steepness = np.where(turns, fall - rise, -1.0)
    meet = np.where(turns, (last - first - rise * length) / steepness, 0.0)  # where the end tangents meet
    least = first + fall * np.clip(meet, 0.0, length)
    return np.asarray((last <= 0) | (turns & (least <= WORTH * np.minimum(first, last))))


def _locate(margins: Margins, flow: Flow, stretch: _Stretch, part: int, index: int) -> _Found | None:
    """Return where a margin falls through zero in a part of a stretch, None if it does not."""
    start, first, last = float(stretch.time[part]), stretch.state[part], stretch.state[part + 1]
    end = float(stretch.time[part + 1]) - start

    def state(offset: float) -> FloatArray:
        return first if offset <= 0 else flow.state(start, first, offset, TIGHT)

    def value(offset: float) -> float:
        return float(margins.values(start + offset, state(offset))[index])

    def rate(offset: float) -> float:
        return float(margins.rates(start + offset, state(offset))[index])

    if stretch.values[part + 1, index] > 0:
        if rate(end) <= 0:  # so near the end that integrating anew does not find the turn
            return None
        end = _find_root(rate, end)
        if value(end) > 0:
            return None
    elif value(end) > 0:  # negative at the sample by less than its error
        return _Found(index, float(stretch.time[part + 1]), last)
    offset = 0.0 if stretch.values[part, index] <= 0 else _find_root(value, end)
    return _Found(index, start + offset, state(offset))


def _find_root(function: Callable[[float], float], end: float) -> float:
    """Return a zero of a function that has different signs at 0 and `end`."""
    return float(scipy.optimize.brentq(function, 0.0, end, xtol=1e-15 * end, rtol=1e-14))


def _gather(margins: Margins, found: Sequence[_Found], same: float) -> tuple[MotionEvent, ...]:
    """Return the events in the order of time, those at once as one."""
    groups: list[list[_Found]] = []
    for item in sorted(found, key=lambda item: (item.time, item.index)):
        if groups and item.time - groups[-1][0].time <= same:
            groups[-1].append(item)
        else:
            groups.append([item])
    return tuple(_describe(margins, group) for group in groups)


def _describe(margins: Margins, group: Sequence[_Found]) -> MotionEvent:
    first, n = group[0], len(group[0].state) // 2
    return MotionEvent(
        kind=margins.kind,
        names=tuple(margins.names[index] for index in sorted(item.index for item in group)),
        time=first.time,
        margin=float(margins.values(first.time, first.state)[first.index]),
        coordinate=first.state[:n],
        velocity=first.state[n:],
    )
