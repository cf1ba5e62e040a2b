"""Memory of members along a load path: where members that flow turn back, and the path behind.

As long as a member flows one way, the return mapping from where it began is exact however long the steps
are. Where it turns it has to remember; there a step ends, and the path goes on with the stiffness ahead.
"""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.contacts.rest_memory import RestMemory
from tensegrity_codegen.runtime.paths.path_events import EventTracker, Step
from tensegrity_codegen.runtime.paths.path_solver import PathState
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.root import find_root

OFFSET = 1e-7  # in z: how far before and behind a point flow is looked at
LEAST_TURN = 1e-6  # of a step: a turn nearer to its start is at its start


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
        found: FloatArray | None = self.problem.settle(state.coordinate, state.load_factor)
        return found

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

        least = LEAST_TURN * step.length
        return find_root(rate, least, step.length, 1e-10 * step.length) if rate(least) > 0.0 else None

    def turn(
        self, state: PathState, tangent: FloatArray, tracker: EventTracker
    ) -> tuple[PathState, FloatArray]:
        """Let members that flow back along the tangent remember; return point and tangent then."""
        for _ in range(len(self.states.flow)):
            turned, rates = self._look(state, tangent)
            turned |= self._has_flowed(state) & (rates <= LEAST_TURN * np.abs(rates).max(initial=0.0))
            if not turned.any():
                break
            here = self.settle(state)
            assert here is not None
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
        found = solver.tangent(state, tangent, ahead)
        tangent = tangent if found is None else found
        values = tracker.watched(state.z + OFFSET * tangent, solver)
        for index, watch in enumerate(tracker.owner):
            if watch.falling == "yield":
                tracker.side[index] = 1.0 if values[index] >= 0.0 else -1.0
        return state, tangent

    def _has_flowed(self, state: PathState) -> BoolArray:
        here, flow = self.settle(state), self.states.flow
        assert here is not None
        moved: BoolArray = here[flow] > self.states.start[flow]
        return moved

    def _look(self, state: PathState, tangent: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Return which members turn back at a point, and the rates of flow of all, (n_plastic,)."""
        split = state.solver.split
        behind, here, ahead = (
            self.problem.settle(*split(state.z + shift * OFFSET * tangent)) for shift in (-1.0, 0.0, 1.0)
        )
        rates: FloatArray = (ahead - behind)[self.states.flow] / (2.0 * OFFSET)
        return self.states.find_turned(here, behind, ahead), rates
