"""Equilibria of cables with friction at rings: material slips until the capstan holds it everywhere.

s_k, what slips through ring k, stays at its start where 1 / E <= T_(k+1) / T_k <= E, and else goes so far
that the ratio of the tensions is at that limit: no farther than it has to, on a straight way from the start.
For given s the strands are plain members, and the equilibrium of these is sought. With f and b, what the
tensions exceed the limit by to either side, and any a > 0, s is a zero of

s - max(0, s + a f) - min(0, s - a b)

(B. Alart and A. Curnier, Computer Methods in Applied Mechanics and Engineering 92, 1991, for contacts), found
by Newton's method, with differences of equilibria for derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.statics.newton import FOUND, Outcome
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import SLID_END

ACCURACY = 2e-11  # of the largest tension: how near to the capstan's limit rings come
PROBE = 1e-6  # of the longest member: slip by which derivatives are found
MOST_ITERATIONS = 40
LEAST_PART = 1 / 64  # of a step of Newton's method
MOST_WAITED = 4  # iterations in a row without an excess that is less by a tenth
NO_RESISTANCE = 1e-3  # of what is beyond the limit: change of that by a slip as long as the longest member
LARGEST_SLIP = 0.2  # of the longest member, in one step


@dataclass(frozen=True)
class _State:
    """An equilibrium with so much slip."""

    slid: FloatArray  # (n_rings,) [m]
    outcome: Outcome
    excess: FloatArray  # (n_rings, 2) [N], tensions beyond the limit, behind each ring and before it

    def find_gap(self, slope: float) -> tuple[FloatArray, Any]:
        """Return what is to be zero, (n_rings,) [m], and which way each ring slips, 0: it sticks."""
        forth, back = self.slid + self.excess[:, 0] * slope, self.slid - self.excess[:, 1] * slope
        side = np.where(forth > 0, 1, np.where(back < 0, -1, 0))
        return self.slid - np.maximum(0.0, forth) - np.minimum(0.0, back), side

    def pull(self, side: Any) -> FloatArray:
        """Return the excess on the side to which each ring slips, against the slip [N]."""
        return np.where(side >= 0, -self.excess[:, 0], self.excess[:, 1])


def slip_until_held(problem: StaticProblem, start: Point, search: Callable[[Point], Outcome]) -> Outcome:
    """Return the equilibrium from a start, its cables held by friction at all rings.

    search: returns the equilibrium from a point with rings that stick. What has slipped is left in the
    internal states of the problem.
    """
    names = problem.model.manifest.internal_name
    row = np.array([k for k, name in enumerate(names) if name.endswith(SLID_END)])
    begun = problem.internal
    unslipped = search(start)
    spent = unslipped.iterations
    if unslipped.status not in FOUND:
        return unslipped

    def put(slid: FloatArray) -> None:
        states = begun.copy()
        states[row] += slid
        problem.put_internal(states)

    def measure(slid: FloatArray, outcome: Outcome) -> _State:
        excess = np.array(problem.compute("ring_excess", outcome.point.coordinate)).reshape(-1, 2)
        return _State(slid, outcome, excess)

    def settle(slid: FloatArray, near: Point) -> _State | None:
        """Return the equilibrium with so much slip, None where none is found."""
        nonlocal spent
        put(slid)
        point = problem.find_point(near.coordinate)
        outcome = None if point is None else search(point)
        if outcome is None:
            return None
        spent += outcome.iterations
        return measure(slid, outcome) if outcome.status in FOUND else None

    state = measure(np.zeros(len(row)), unslipped)
    size = float(np.max(problem.compute("member_length", state.outcome.point.coordinate)))
    slope = first_slope = PROBE * size / max(state.outcome.point.largest_force, 1e-300)
    best, least_gap, waited = state, np.inf, 0
    for _ in range(MOST_ITERATIONS):
        point = state.outcome.point
        largest = float(np.abs(state.find_gap(first_slope)[0]).max())
        waited = 0 if largest < 0.9 * least_gap else waited + 1
        if largest < least_gap:
            best, least_gap = state, largest
        if waited > MOST_WAITED:
            break
        gap, side = state.find_gap(slope)
        rounding = problem.rounding_floor(problem.stiffness(point.coordinate), point)
        if np.abs(gap).max() <= slope * max(ACCURACY * point.largest_force, rounding):
            put(state.slid)
            return replace(state.outcome, iterations=spent)
        step, compliance = _find_step(state, side, PROBE * size, settle)
        if step is None:
            break
        if compliance:
            slope = compliance
            gap = state.find_gap(slope)[0]
        fraction, largest = 1.0, float(np.abs(step).max())
        step = step * min(1.0, LARGEST_SLIP * size / largest) if largest > 0 else step
        while True:
            trial = settle(state.slid + fraction * step, point)
            if (
                trial is not None
                and np.abs(trial.find_gap(slope)[0]).max() < (1 - 0.1 * fraction) * np.abs(gap).max()
            ):
                break
            fraction /= 2
            if fraction < LEAST_PART:
                break
        if trial is None:
            break
        state = trial
    put(best.slid)
    message = "material slips through rings, and no state was found in which friction holds it"
    point = _drop_slipping_tensions(problem, best.outcome.point)
    return replace(best.outcome, point=point, status="stalled", iterations=spent, message=message)


def _drop_slipping_tensions(problem: StaticProblem, point: Point) -> Point:
    """Return a point without the tensions of strands at rings: those that balance cannot be held there."""
    tension = point.tension.copy()
    before = [problem.model.manifest.member_name.index(name) for name in problem.model.manifest.ring_name]
    tension[[row + side for row in before for side in (0, 1)]] = np.nan
    return replace(point, tension=tension)


def _find_step(
    state: _State, side: Any, probe: float, settle: Callable[..., _State | None]
) -> tuple[Any, float]:
    """Return Newton's step of all rings [m], None where none is found, and a compliance, else 0 [m/N]."""
    step, slips = np.where(side == 0, -state.slid, 0.0), np.flatnonzero(side)
    pull = state.pull(side)
    target = -pull[slips]
    matrix = np.zeros((len(slips), len(side)))
    for k in np.flatnonzero((side != 0) | (step != 0)):
        direction = np.zeros(len(side))
        direction[k] = probe if side[k] >= 0 else -probe
        displaced = settle(state.slid + direction, state.outcome.point)
        if displaced is None:
            return None, 0.0
        matrix[:, k] = (displaced.pull(side) - pull)[slips] / direction[k]
    target = target - matrix @ step
    if slips.size and np.abs(matrix).max() * state.outcome.point.longest < NO_RESISTANCE * np.abs(pull).max():
        return None, 0.0
    step[slips] = np.linalg.lstsq(matrix[:, slips], target, rcond=None)[0]
    stiffest = float(np.abs(matrix[np.arange(len(slips)), slips]).max(initial=0.0))
    return step, 1.0 / stiffest if stiffest > 0 else 0.0
