"""Load paths by pseudo-arc-length continuation, with events located by root finding.

From a point z of the path with unit tangent t the next one is where g = 0 and t . (z' - z) = h: a plane
across the path instead of a given load, so the path is followed through limit points, where the load turns
back (Riks 1979, Keller 1977). Each step is searched for events; at those where the stiffness jumps it is cut,
and the path taken up anew with the stiffness of the far side.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import check_shape, to_doubles
from tensegrity_codegen.runtime.paths.load_path import (
    LoadPath,
    NeutralMotions,
    PathEvent,
    PathPoint,
    PathProblem,
    Watch,
    collect_path,
)
from tensegrity_codegen.runtime.paths.path_events import (
    MAX_PREDICTION_ERROR,
    SLOPE_STEP,
    Crossing,
    EventTracker,
    LostError,
    PathMemory,
    Step,
)
from tensegrity_codegen.runtime.paths.path_solver import PathSolver, PathState
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.checks import (
    check_callback,
    check_instance,
    check_positive,
    check_whole,
    is_number,
)
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.system.progress import describe_pass

# Newton iterations up to which the next step is longer, above which it is shorter.
FEW_ITERATIONS, MANY_ITERATIONS = 3, 6
MIN_TANGENT_COSINE = 0.9  # least cosine of the angle between tangents of one step
KINK_OFFSET = 1e-7  # how far behind a kink the stiffness of the far side is taken, in z
TURN_STEP_RATIO = 1e-2  # step that tells how a floating structure turns, as part of the largest
MAX_CROSSINGS = 4  # of one step, for each value that is watched; with more it is tried shorter
MIN_LOOP_POINTS = 10  # points that a closed path has at least
# Distance from the first point, as part of a step, at which a path counts as closed.
LOOP_CLOSURE_TOLERANCE = 0.02
FIRST_STEP_RATIO = 0.1  # first step as part of the largest
# Steps, as part of the largest, from which one that goes back over the kink where it begins is tried shorter.
BACK_STEP_RATIO = 1e-3


@dataclass(frozen=True)
class StepControl:
    """Largest and smallest step in scaled z (a straight path is about 1.4 long), and the most steps."""

    largest: float = 0.1
    smallest: float = 1e-7
    most_steps: int = 1000

    def __post_init__(self) -> None:
        check_positive(self.largest, "largest")
        check_positive(self.smallest, "smallest")
        check_whole(self.most_steps, "most_steps", 1)


def follow_path(
    problem: PathProblem,
    start: ArrayLike,
    *,
    most: float,
    least: float = 0.0,
    watches: Sequence[Watch] = (),
    neutral: NeutralMotions | None = None,
    control: StepControl | None = None,
    floor: float | None = None,
    stop_at: Sequence[str] = (),
    progress: Callable[[int, float], None] | None = None,
) -> LoadPath:
    """Follow the equilibria g(q, lambda) = 0 by pseudo-arc-length continuation from `least` to `most`."""
    # A path that has turned back ends at the load factor `floor`: -inf for none, by default `least`.
    control = StepControl() if control is None else control
    check_instance(control, StepControl, "control", "a StepControl")
    for name in ("residual", "stiffness", "load_vector"):
        if not callable(getattr(problem, name, None)):
            allowed = "what build_path(...) returns"
            raise InvalidValueError("wrong type", where="problem", given=problem, allowed=allowed)
    check_callback(neutral, "neutral")
    check_callback(progress, "progress")
    _check_lists(watches, stop_at)
    begin = _check_start(start, least, most)
    if floor is not None and not (is_number(floor) or (isinstance(floor, float) and math.isinf(floor))):
        raise InvalidValueError(
            "not a load factor", where="floor", given=floor, allowed="a number, -inf for none, or None"
        )
    expected = begin.shape
    with suppress(NonFiniteError):  # then the path has no start
        expected = np.shape(problem.residual(begin, float(least)))
    check_shape(begin, expected, "start")
    path = _Path(problem, tuple(watches), neutral, control, (least, most))
    path.tracker.floor = least if floor is None else float(floor)
    path.stop_at = frozenset(stop_at)
    status, message = path.run(begin, progress)
    return collect_path(path.points, path.events, status, message, path.solver.n_iterations)


class _Path:
    """A path under way."""

    def __init__(
        self,
        problem: PathProblem,
        watches: tuple[Watch, ...],
        neutral: NeutralMotions | None,
        control: StepControl,
        span: tuple[float, float],
    ) -> None:
        self.problem, self.neutral, self.control = problem, neutral, control
        self.least, self.most = span
        self.solver = PathSolver(problem, (1.0, abs(self.most - self.least)), neutral)
        self.tracker = EventTracker(watches, self.least, self.most)
        memory = getattr(problem, "memory", None)
        self.memory = PathMemory(problem) if memory is not None and memory.members else None
        self.points: list[PathPoint] = []
        self.events: list[PathEvent] = []
        self.stop_at: frozenset[str] = frozenset()
        self.kinked: BoolArray = np.zeros(0, dtype=bool)  # what crossed where the last step was cut

    def run(self, start: FloatArray, progress: Callable[[int, float], None] | None) -> tuple[str, str]:
        """Follow the path; return status and message."""
        if self.memory is not None:
            self.memory.begin()
        begun = self._begin(start)
        if isinstance(begun, str):
            return "no_start", begun
        state, tangent = begun
        for event in self.events:
            if event.kind not in ("limit", "stability"):
                return "stopped", f"{event.kind} of {', '.join(event.names)} at the start"
        # Steps: next point, its events, then the tangent from there.
        length = self.control.largest * FIRST_STEP_RATIO
        for _ in range(self.control.most_steps):
            step, length = self._find_step(state, tangent, length)
            if step is None:
                return "stalled", f"no equilibrium was found beyond load factor {state.load_factor:.10g}"
            ended = self._take(step)
            if ended:
                return ended
            state, n_events = step.end, len(self.events)
            self.kinked = step.crossings[-1].crossed if step.is_cut else np.zeros_like(self.kinked)
            next_tangent = self._far_tangent(step) if step.is_cut else step.solver.tangent(state, tangent)
            if next_tangent is None:
                return "stalled", f"the stiffness is singular beyond load factor {state.load_factor:.10g}"
            tangent = next_tangent
            if self.memory is not None:
                state, tangent = self.memory.turn(state, tangent, self.tracker)
            ended = self._find_stop(n_events) or self._find_loop(step, tangent)
            if ended:
                return ended
            describe_pass(
                f"following a load path: point {len(self.points):,}, load factor {state.load_factor:.4g}"
            )
            if progress is not None:
                progress(len(self.points), state.load_factor)
        return "step_limit", f"the load was not reached in {self.control.most_steps} steps"

    # The start

    def _begin(self, start: FloatArray) -> tuple[PathState, FloatArray] | str:
        """Return the first point and its tangent, or why there are none."""
        upward = np.append(np.zeros(len(start)), np.sign(self.most - self.least))
        begun = self.solver.begin(start, self.least, upward)
        if isinstance(begun, str):
            return begun
        self.solver, state, tangent = begun
        try:
            values = self.tracker.values(state, tangent)
        except NonFiniteError as error:
            return f"a monitored function is not finite at the start: {error.problem}"
        self.tracker.begin(values)
        self.kinked = np.zeros(len(values), dtype=bool)
        self._add(state, tangent)
        # Events that would end the path and are beyond zero already are noted, and passed over.
        tracker = self.tracker
        crossed = np.zeros(len(values), dtype=bool)
        for index, watch in enumerate(tracker.owner):
            crossed[index] = watch.stops and values[index] < 0
        if crossed.any():
            tracker.pass_over(crossed)
            step = Step(self.solver, state, tangent, state, 0.0)
            self.events += tracker.describe(Crossing(0.0, state, crossed), step, 0)
        if state.neutral.shape[1]:
            tangent = self._turn_with_load(state, tangent)
        return (state, tangent) if self.memory is None else self.memory.renew(state, tangent, self.tracker)

    def _turn_with_load(self, state: PathState, tangent: FloatArray) -> FloatArray:
        """Return the tangent along which a floating structure turns as well, by a short step."""
        short = self.control.largest * TURN_STEP_RATIO
        end = self.solver.solve(state.z + short * tangent, tangent, float(tangent @ state.z) + short)
        if end is None:
            return tangent
        secant = np.asarray((end.z - state.z) / np.linalg.norm(end.z - state.z))
        before = self.tracker.side.copy()
        self.tracker.renew(self.tracker.values(end, secant))
        self._note_jump(state, secant, before)
        return secant

    # A step

    def _find_step(self, state: PathState, tangent: FloatArray, length: float) -> tuple[Step | None, float]:
        """Return a step that is good, cut at its first event if need be, and the length of the next one."""
        while length >= self.control.smallest:
            step = self._try(state, tangent, length)
            if step is not None:
                slow = step.end.iterations
                factor = 2.0 if slow <= FEW_ITERATIONS else 1.0 if slow <= MANY_ITERATIONS else 0.5
                return step, min(length * factor, self.control.largest)
            length /= 2
        return None, length

    def _try(self, state: PathState, tangent: FloatArray, length: float) -> Step | None:
        level = float(tangent @ state.z) + length
        end = self.solver.solve(state.z + length * tangent, tangent, level)
        if end is None:
            return None
        step = Step(self.solver, state, tangent, end, length)
        try:
            touch = self.tracker.find_touch(step)
            if touch:
                return self._try(state, tangent, touch)
            turn = None if self.memory is None else self.memory.find_turn(step)
            if turn:
                return self._try(state, tangent, turn)
            self._search(step)
        except (LostError, NonFiniteError):
            return None
        went_back = (
            step.is_cut and step.length < KINK_OFFSET and (step.crossings[-1].crossed & self.kinked).any()
        )
        if went_back and length > BACK_STEP_RATIO * self.control.largest:
            return None  # Newton's method found another branch behind the kink
        aside = step.end.z - state.z - step.length * tangent
        if float(np.linalg.norm(aside)) > MAX_PREDICTION_ERROR * step.length:
            return None
        straight = step.is_cut or float(step.tangent_at(step.end) @ tangent) >= MIN_TANGENT_COSINE
        return step if straight else None

    def _search(self, step: Step) -> None:
        """Find the crossings of a step in order; cut it at the first that ends the path or is a kink."""
        sides = self.tracker.side.copy()
        try:
            self._find_crossings(step)
        finally:
            self.tracker.side = sides

    def _find_crossings(self, step: Step) -> None:
        tracker, lower = self.tracker, 0.0
        while len(step.crossings) < MAX_CROSSINGS * len(tracker.side):
            crossing = tracker.find_crossing(step, lower)
            if crossing is None:
                return
            step.crossings.append(crossing)
            ends = crossing.crossed[[tracker.ended, tracker.returned]].any()
            if ends or tracker.is_kink(crossing.crossed) or tracker.find_stop(crossing.crossed):
                step.end, step.length = crossing.state, crossing.length
                step.is_cut = True
                return
            # A value that is zero where it has crossed must not be found there again.
            lower = crossing.length + SLOPE_STEP * step.length * (crossing.length <= lower)
            tracker.pass_over(crossing.crossed)
        raise LostError

    def _take(self, step: Step) -> tuple[str, str] | None:
        """Add the points and events of a step; return status and message if the path ends there."""
        tracker = self.tracker
        for crossing in step.crossings:
            state, crossed = crossing.state, crossing.crossed
            tangent = step.tangent_at(state)
            stop, n_events = tracker.find_stop(crossed), len(self.events)
            self.events += tracker.describe(crossing, step, len(self.points))
            tracker.pass_over(crossed)
            if crossed[tracker.ended]:
                upward = np.append(np.zeros(len(state.z) - 1), 1.0)  # the point next to it with this load
                located = self.solver.solve(state.z, upward, self.most / self.solver.load_scale)
                self._add(state if located is None else located, tangent, self.most)
                return "completed", f"load factor {self.most:.10g} was reached"
            self._add(state, tangent)
            ended = self._find_stop(n_events)
            if ended:
                return ended
            if stop:
                return "stopped", f"{stop} at load factor {state.load_factor:.10g}"
            if crossed[tracker.returned]:
                return "returned", self._describe_return()
        if not step.is_cut:
            self._add(step.end, step.tangent_at(step.end))
        return None

    def _find_loop(self, step: Step, tangent: FloatArray) -> tuple[str, str] | None:
        """Return status and message where a step leads over the first point of the path again."""
        if len(self.points) < MIN_LOOP_POINTS:
            return None
        origin = self.solver.join(self.points[0].coordinate, self.points[0].load_factor)
        along = step.end.z - step.start.z
        length = float(np.linalg.norm(along))
        if length == 0.0:  # cut at a kink where the step begins
            return None
        fraction = float((origin - step.start.z) @ along) / length**2
        aside = float(np.linalg.norm(origin - step.start.z - np.clip(fraction, 0, 1) * along))
        if (
            not 0 <= fraction <= 1
            or aside > LOOP_CLOSURE_TOLERANCE * length
            or tangent[-1] * self.points[0].load_rate <= 0
        ):
            return None
        return "returned", "the path is a closed loop and returned to its start"

    def _find_stop(self, n_events: int) -> tuple[str, str] | None:
        """Return status and message where one of the events after the first `n_events` ends the path."""
        for event in self.events[n_events:]:
            if event.kind in self.stop_at:
                return "stopped", f"{event.kind} at load factor {event.load_factor:.10g}"
        return None

    def _describe_return(self) -> str:
        highest = max(
            self.points, key=lambda point: (point.load_factor - self.least) / (self.most - self.least)
        )
        reached = "its start"
        if self.tracker.floor != self.least:
            reached = f"load factor {self.tracker.floor:.10g}"
        return f"the path turned back at load factor {highest.load_factor:.10g} and returned to {reached}"

    def _far_tangent(self, step: Step) -> FloatArray | None:
        """Return the tangent on the far side of a kink, and note where load or stability turn with it."""
        state, tracker, inward = step.end, self.tracker, step.tangent_at(step.end)
        beyond = state.z + KINK_OFFSET * step.tangent
        try:
            stiffness = self.problem.stiffness(*self.solver.split(beyond))
            tangent = self.solver.tangent(state, inward, stiffness)
            if tangent is None:
                return None
            watched = [
                tracker.watched(state.z + sign * KINK_OFFSET * tangent, self.solver) for sign in (1, -1)
            ]
        except NonFiniteError:
            return None
        crossed = step.crossings[-1].crossed[: tracker.n_watched]
        n_after, n_before = (
            int((tracker.side[: tracker.n_watched] * row > 0)[crossed].sum()) for row in watched
        )
        if n_before > n_after:
            tangent = -tangent
        beyond_state = PathState(self.solver, beyond, state.residual, state.iterations)
        before = tracker.side.copy()
        tracker.renew(tracker.values(beyond_state, tangent))
        self._note_jump(state, inward, before)
        return tangent

    def _note_jump(self, state: PathState, tangent: FloatArray, before: FloatArray) -> None:
        tracker = self.tracker
        if tracker.side[tracker.limit] != before[tracker.limit]:
            kind = "limit"
        elif (tracker.side != before)[tracker.first_eigenvalue :].any():
            kind = "stability"
        else:
            return
        rate = np.append(tangent[:-1] * self.solver.coordinate_scale, tangent[-1] * self.solver.load_scale)
        point = len(self.points) - 1
        self.events.append(PathEvent(kind, ("load",), state.load_factor, state.coordinate, rate, point))

    def _add(self, state: PathState, tangent: FloatArray, load_factor: float | None = None) -> None:
        rate = float(tangent[-1]) * self.solver.load_scale
        load = state.load_factor if load_factor is None else load_factor
        internal = None if self.memory is None else self.memory.settle(state)
        point = PathPoint(state.coordinate, load, state.residual, state.smallest_eigenvalue, rate, internal)
        self.points.append(point)


def _check_lists(watches: Any, stop_at: Any) -> None:
    """Raise InvalidValueError unless these are a list of Watch and a list of kinds of events."""
    for values, kind, name in ((watches, Watch, "watches"), (stop_at, str, "stop_at")):
        check_instance(values, (tuple, list), name, f"a list of {kind.__name__}")
        for value in values:
            check_instance(value, kind, name, f"a list of {kind.__name__}")


def _check_start(start: ArrayLike, least: float, most: float) -> FloatArray:
    """Return a copy of the start; raise where no path can begin."""
    begin = to_doubles(start, "start", "coordinates of shape (n,)").copy()
    factors = [to_doubles(value, name, "a number") for name, value in (("least", least), ("most", most))]
    if not (np.isfinite(begin).all() and all(np.isfinite(value).all() for value in factors)):
        raise NonFiniteError("start and load factors have to be finite", where="follow_path")
    for name, value in (("least", least), ("most", most)):
        if not is_number(value):
            raise InvalidValueError("not a load factor", where=name, given=value, allowed="a finite number")
    if begin.ndim != 1 or begin.size == 0:
        raise InvalidValueError("the start is not a vector", where="start", given=begin.shape, allowed="(n,)")
    if most == least:
        raise InvalidValueError(
            "the path has no length", where="most", given=most, allowed=f"a load factor other than {least}"
        )
    return begin
