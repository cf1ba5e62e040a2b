"""Events on a path: values whose zeros matter, on which side of zero each is, and where they cross.

As long as a member with memory flows one way, the return mapping from where it began is exact however long
the steps are. Where it turns back it has to remember; there a step ends, and the path goes on with the
stiffness ahead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from numpy.polynomial import Polynomial

from tensegrity_codegen.runtime.contacts.rest_memory import RestMemory
from tensegrity_codegen.runtime.paths.load_path import PathEvent, Watch
from tensegrity_codegen.runtime.paths.path_solver import MAX_EIGENVALUES, PathSolver, PathState
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.system.root import find_root

CROSSING_TOLERANCE = 1e-8  # of a value's change over the step: values this near zero cross at the same place
# Part of the load along a mode of zero stiffness, below which the mode is a bifurcation.
BIFURCATION_TOLERANCE = 1e-7
ITERATED_BIFURCATION_TOLERANCE = 1e-4  # the same where the mode is found by iteration
SLOPE_STEP = 1e-6  # step in z for slopes along the tangent
MAX_PREDICTION_ERROR = 0.5  # largest correction of a predicted point, as part of the step
# Part of the end values that a cubic through the step must fall to before its minimum is sought.
TOUCH_RATIO = 0.05
OFFSET = 1e-7  # in z: how far before and behind a point flow is looked at
MIN_TURN = 1e-6  # of a step: a turn nearer to its start is at its start


@dataclass
class Step:
    """A step of the path, `length` measured along the tangent; is_cut: it ends at its last crossing."""

    solver: PathSolver
    start: PathState
    tangent: FloatArray
    end: PathState
    length: float
    crossings: "list[Crossing]" = field(default_factory=list)
    is_cut: bool = False

    def at(self, length: float, points: Mapping[float, PathState] | None = None) -> PathState | None:
        """Return the point of the path at a part of the length, None if it is not found.

        points: known ones by length, which interpolate where the stiffness is so nearly singular, along a
        mode that the load does not push, that Newton's corrections are rounding.
        """
        points = {0.0: self.start, self.length: self.end, **(points or {})}
        low = max(at for at in points if at <= length)
        high = min(at for at in points if at >= length)
        fraction = (length - low) / (high - low) if high > low else 0.0
        guess = points[low].z + fraction * (points[high].z - points[low].z)
        level = float(self.tangent @ self.start.z) + length
        state = self.solver.solve(guess, self.tangent, level)
        if state is not None and np.linalg.norm(state.z - guess) <= MAX_PREDICTION_ERROR * (high - low):
            return state
        return self.solver.find_state(guess, 0) or state

    def tangent_at(self, state: PathState) -> FloatArray:
        """Return the tangent at a point of the step, that of the step's start where there is none."""
        tangent = self.solver.tangent(state, self.tangent)
        return self.tangent if tangent is None else tangent


@dataclass(frozen=True)
class Crossing:
    """The first place in a step where values cross zero: its length, state, and which values."""

    length: float
    state: PathState
    crossed: BoolArray  # over all values


class EventTracker:
    """Values to watch, their sides of zero, and their crossings.

    The values are those of all watches, the load rate dlambda/ds (limit points), the load left to the end
    and above the floor, and the smallest eigenvalues over the size of the stiffness (bifurcations).
    """

    def __init__(self, watches: Sequence[Watch], start: float, end: float) -> None:
        self.watches = tuple(watches)
        self.start, self.end, self.floor = start, end, start
        self.owner = [watch for watch in self.watches for _ in watch.names]
        self.name = [name for watch in self.watches for name in watch.names]
        self.n_watched = len(self.name)
        self.limit, self.ended, self.returned = range(self.n_watched, self.n_watched + 3)
        self.loads = slice(self.ended, self.returned + 1)
        self.first_eigenvalue = self.n_watched + 3
        self.side = np.zeros(0)

    def watched(self, z: FloatArray, solver: PathSolver) -> FloatArray:
        """Return the values of the watches at z, (n_watched,)."""
        coordinate, load_factor = solver.split(z)
        values = [np.asarray(watch.values(coordinate, load_factor), dtype=float) for watch in self.watches]
        return np.concatenate([np.zeros(0), *values])

    def values(self, state: PathState, tangent: FloatArray) -> FloatArray:
        """Return all values at a point of the path."""
        span = self.end - self.start
        above = (state.load_factor - self.floor) / span if np.isfinite(self.floor) else 1.0
        remaining = [(self.end - state.load_factor) / span, above]
        size = float(np.abs(state.stiffness.diagonal()).max(initial=0.0)) or 1.0
        # Neutral motions come and go; what is no eigenvalue counts as positive.
        eigenvalues = np.ones(MAX_EIGENVALUES)
        eigenvalues[: len(state.eigen[0])] = state.eigen[0] / size
        return np.concatenate([self.watched(state.z, state.solver), tangent[-1:], remaining, eigenvalues])

    def begin(self, values: FloatArray) -> None:
        """Take the sides of zero from values at the start; the start itself is not below its own load."""
        self.side = np.where(values >= 0, 1.0, -1.0)
        self.side[self.returned] = 1.0

    def renew(self, values: FloatArray) -> None:
        """Take the sides of load rate and eigenvalues anew, behind a kink where they have jumped."""
        for renewed in (slice(self.limit, self.limit + 1), slice(self.first_eigenvalue, None)):
            self.side[renewed] = np.where(values[renewed] >= 0, 1.0, -1.0)

    def pass_over(self, crossed: BoolArray) -> None:
        """Note that values have gone to the other side."""
        self.side = np.where(crossed, -self.side, self.side)

    def find_crossing(self, step: Step, least: float = 0.0) -> Crossing | None:
        """Return the first crossing beyond the length `least`, or None; LostError if the path is lost."""
        before = self.values(step.start, step.tangent)
        seen = {step.length: (step.end, self.values(step.end, step.tangent_at(step.end)))}

        def look(length: float) -> tuple[PathState, FloatArray]:
            if length not in seen:
                state = step.at(length, {at: state for at, (state, _) in seen.items()})
                if state is None:
                    raise LostError
                seen[length] = state, self.values(state, step.tangent_at(state))
            return seen[length]

        def locate(crossing: BoolArray, end: float) -> Crossing:
            change = np.where(crossing, np.abs(look(end)[1] - before), 1.0)
            change[change == 0] = 1.0

            def lowest(at: float) -> float:
                return float((self.side * look(at)[1] / change)[crossing].min())

            # The first root; `least` where the values are not positive there.
            length = least if lowest(least) <= 0 else find_root(lowest, least, end, 1e-14 * end)
            state, values = look(length)
            scaled = self.side * values / change
            is_near = crossing & (np.abs(scaled) <= CROSSING_TOLERANCE)
            # Where none is near zero, one has jumped through it.
            return Crossing(
                length, state, is_near if is_near.any() else crossing & (scaled <= scaled[crossing].min())
            )

        crossing_found, crossing, end = None, self.side * look(step.length)[1] < 0, step.length
        while crossing.any():
            crossing_found = locate(crossing, end)
            # What crosses twice is not seen at the end: the load, where it turns back at a limit point or a
            # kink, and before a kink what jumps there.
            for end, among in (
                (crossing_found.length, self.loads),
                (crossing_found.length - SLOPE_STEP * step.length, slice(None)),
            ):
                crossing = np.zeros(len(before), dtype=bool)
                if end > least:
                    crossing[among] = (self.side * look(end)[1] < 0)[among]
                    crossing &= ~crossing_found.crossed
                if crossing.any():
                    break
        return crossing_found

    def find_touch(self, step: Step) -> float | None:
        """Return a length in the step at which a value is beyond zero though not at its end, by a cubic."""
        if not self.n_watched:
            return None
        side = self.side[: self.n_watched]
        try:
            start_value, rise = self._value_and_slope(step.start, step.tangent)
            end_value, fall = self._value_and_slope(step.end, step.tangent_at(step.end))
        except NonFiniteError:
            return None
        for index in np.flatnonzero(
            (side * start_value > 0) & (side * end_value > 0) & (side * rise < 0) & (side * fall > 0)
        ):
            ends = side[index] * start_value[index], side[index] * end_value[index]
            slopes = side[index] * rise[index], side[index] * fall[index]
            if _least_of_cubic(ends, slopes, step.length) > TOUCH_RATIO * min(ends):
                continue
            length = self._find_least(step, int(index), float(side[index]))
            if length is not None:
                return length
        return None

    def describe(self, crossing: Crossing, step: Step, point: int) -> list[PathEvent]:
        """Return the events of a crossing, those of one kind together; unnamed ones are left out."""
        state, tangent = crossing.state, step.tangent_at(crossing.state)
        names_by_kind: dict[str, list[str]] = {}
        for index in np.flatnonzero(crossing.crossed[: self.n_watched]):
            watch = self.owner[index]
            kind = watch.falling if self.side[index] > 0 else watch.rising
            if kind:
                names_by_kind.setdefault(kind, []).append(self.name[index])
        modes = {kind: np.zeros((0, 0)) for kind in names_by_kind}
        if crossing.crossed[self.limit]:
            names_by_kind["limit"], modes["limit"] = ["load"], self._zero_modes(state, 1)[0]
        if crossing.crossed[self.first_eigenvalue :].any():
            free = self._zero_modes(state, int(crossing.crossed[self.first_eigenvalue :].sum()))[1]
            if free.shape[1]:
                names_by_kind["bifurcation"] = [f"mode{k + 1}" for k in range(free.shape[1])]
                modes["bifurcation"] = free
        rate = np.append(tangent[:-1] * state.solver.coordinate_scale, tangent[-1] * state.solver.load_scale)
        return [
            PathEvent(kind, tuple(names), state.load_factor, state.coordinate, rate, point, modes[kind])
            for kind, names in names_by_kind.items()
        ]

    def is_kink(self, crossed: BoolArray) -> bool:
        """Return whether the stiffness jumps at this crossing."""
        return any(self.owner[index].is_kink for index in np.flatnonzero(crossed[: self.n_watched]))

    def find_stop(self, crossed: BoolArray) -> str:
        """Return the name of the event that ends the path here, "" if nothing does."""
        for index in np.flatnonzero(crossed[: self.n_watched]):
            if self.owner[index].stops and self.side[index] > 0:
                return f"{self.owner[index].falling} of {self.name[index]}"
        return ""

    def _zero_modes(self, state: PathState, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the modes of the `count` eigenvalues nearest zero: all, and those without load."""
        values, vectors = state.eigen
        zero_modes = vectors[:, np.argsort(np.abs(values))[:count]]
        load = state.solver.problem.load_vector(state.coordinate, state.load_factor)
        push = zero_modes.T @ load
        # Eigenvectors of large problems are iterated, and known less well.
        free = BIFURCATION_TOLERANCE if len(load) <= DENSE_LIMIT else ITERATED_BIFURCATION_TOLERANCE
        if float(np.linalg.norm(push)) <= free * float(np.linalg.norm(load)):
            return zero_modes, zero_modes
        turn = np.linalg.qr(push[:, None], mode="complete")[0]
        return zero_modes, zero_modes @ turn[:, 1:]

    def _value_and_slope(self, state: PathState, tangent: FloatArray) -> tuple[FloatArray, FloatArray]:
        forward = self.watched(state.z + SLOPE_STEP * tangent, state.solver)
        back = self.watched(state.z - SLOPE_STEP * tangent, state.solver)
        return self.watched(state.z, state.solver), (forward - back) / (2 * SLOPE_STEP)

    def _find_least(self, step: Step, index: int, side: float) -> float | None:
        """Return the length of the least value if it is beyond zero."""

        def value(length: float) -> float:
            state = step.at(length)
            return np.inf if state is None else side * float(self.watched(state.z, state.solver)[index])

        with np.errstate(invalid="ignore"):  # differences of infinite values, where no point is found
            minimum = scipy.optimize.minimize_scalar(
                value, bounds=(0.0, step.length), method="bounded", options={"xatol": 1e-4 * step.length}
            )
        return float(minimum.x) if minimum.fun < 0 else None


class LostError(Exception):
    """A point within a step that Newton's method did not find."""


def _least_of_cubic(ends: tuple[float, float], slopes: tuple[float, float], length: float) -> float:
    """Return the least value within the step of the cubic of these end values and slopes."""
    bend = 3 * (ends[1] - ends[0]) - length * (2 * slopes[0] + slopes[1])
    twist = 2 * (ends[0] - ends[1]) + length * (slopes[0] + slopes[1])
    cubic = Polynomial([ends[0], length * slopes[0], bend, twist])
    roots = np.asarray(cubic.deriv().roots(), dtype=complex)
    turns = np.clip(roots.real[np.abs(roots.imag) < 1e-12], 0, 1)
    return float(np.min(cubic(np.append(turns, [0.0, 1.0]))))


class PathMemory:
    """The memory of a path that is under way."""

    def __init__(self, problem: Any) -> None:
        self.problem = problem
        self.states: RestMemory = problem.memory

    def begin(self) -> None:
        """Begin with the states that the problem was given."""
        self.states.begin()

    def settle(self, state: PathState) -> FloatArray | None:
        """Return the internal states at a point, (n_internal,)."""
        states: FloatArray | None = self.problem.settle(state.coordinate, state.load_factor)
        return states

    def find_turn(self, step: Step) -> float | None:
        """Return the length of a step up to where a member turns back that has flowed, None without any."""
        turned, _ = self._look(step.end, step.tangent_at(step.end))
        if not turned.any():
            return None

        def rate(length: float) -> float:
            state = step.at(length)
            if state is None:
                return -1.0
            return float(self._look(state, step.tangent_at(state))[1][turned].min())

        lower = MIN_TURN * step.length
        return find_root(rate, lower, step.length, 1e-10 * step.length) if rate(lower) > 0.0 else None

    def turn(
        self, state: PathState, tangent: FloatArray, tracker: EventTracker
    ) -> tuple[PathState, FloatArray]:
        """Let members that flow back along the tangent remember; return point and tangent then."""
        for _ in range(len(self.states.flow)):
            turned, rates = self._look(state, tangent)
            here, flow = self.settle(state), self.states.flow
            assert here is not None
            has_flowed = here[flow] > self.states.start[flow]
            turned |= has_flowed & (rates <= MIN_TURN * np.abs(rates).max(initial=0.0))
            if not turned.any():
                break
            self.states.remember(turned, here)
            state, tangent = self.renew(state, tangent, tracker)
        return state, tangent

    def renew(
        self, state: PathState, tangent: FloatArray, tracker: EventTracker
    ) -> tuple[PathState, FloatArray]:
        """Return point and tangent anew where members begin from it: with the stiffness ahead."""
        solver = state.solver
        state = PathState(solver, state.z, state.residual, state.iterations)
        ahead = self.problem.stiffness(*solver.split(state.z + OFFSET * tangent))
        new_tangent = solver.tangent(state, tangent, ahead)
        tangent = tangent if new_tangent is None else new_tangent
        values = tracker.watched(state.z + OFFSET * tangent, solver)
        for index, watch in enumerate(tracker.owner):
            if watch.falling == "yield":
                tracker.side[index] = 1.0 if values[index] >= 0.0 else -1.0
        return state, tangent

    def _look(self, state: PathState, tangent: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Return which members turn back at a point, and the rates of flow of all, (n_plastic,)."""
        split = state.solver.split
        before, here, after = (
            self.problem.settle(*split(state.z + shift * OFFSET * tangent)) for shift in (-1.0, 0.0, 1.0)
        )
        rates: FloatArray = (after - before)[self.states.flow] / (2.0 * OFFSET)
        return self.states.find_turned(here, before, after), rates
