"""Search for the least mass: local descents from many starts, and branch and bound as the proof.

The mass of a bar that buckles is concave in its compression, so that a local optimum may be far from the
least. Over an interval of the compression the chord lies below the mass; with chords for masses the problem
is a linear program, whose optimum is a bound. The interval of the bar whose chord is farthest below is split
where the program has its force, at which both new chords are exact (J. E. Falk and R. M. Soland, "An
algorithm for separable nonconvex programming problems", Management Science 15, 1969).
"""

import heapq
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.pipeline.sizing.force_program import LARGEST_RESIDUAL, ForceProgram, Optimum
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.progress import describe_pass, work_pass

PROVING = "proving the least mass"
STARTS = 12  # random weights of masses from which descents start
MOST_DESCENTS = 50
LEAST_GAIN = 1e-12  # of the mass, with which a descent goes on
TIGHTENING_ROUNDS, LEAST_TIGHTENING = 3, 0.05  # part of the gap that a round must close for the next one
WIDENING = 1e-7  # of limits within which a program has no solution, and that is not proved
MARGIN = 1e-8  # by which proved limits of tensions are widened, for rounding
SMALL_FORCES = (1e-6, 1e-8, 0.0)  # of the largest force: smaller ones are left out where the others balance
NEAR_BEST = 1.05  # masses over the best one from which a descent is tried


@dataclass(frozen=True)
class LeastForces:
    """Tensions (n_cases, n_members) with the mass that they need, a bound of the least one, splits made."""

    tension: FloatArray
    mass: float
    bound: float
    splits: int


def find_least_forces(program: ForceProgram, gap: float, most_splits: int) -> LeastForces | None:
    """Return the forces of least mass up to `gap` or `most_splits`; None without any within limits."""
    search = _Search(program, gap)
    if not search.start():
        return None
    with work_pass(PROVING):
        bound, splits = search.prove(most_splits)
    return LeastForces(search.tension, search.mass, min(bound, search.mass), splits)


class _Search:
    """The best forces so far, their mass, and limits of tensions that no better ones exceed."""

    def __init__(self, program: ForceProgram, gap: float) -> None:
        self.program, self.law, self.gap = program, program.law, gap
        self.mass, self.tension = np.inf, np.zeros(program.lower.shape)
        self.lower, self.upper = program.lower, program.upper

    def start(self) -> bool:
        """Find forces by descents from many starts; return whether there are any."""
        random = np.random.default_rng(0)
        direct = (np.maximum(self.law.direct, 0.0), np.zeros_like(self.law.direct))
        for trial in range(STARTS + 1):
            weight = None if trial == 0 else random.exponential(size=len(self.law.direct))
            optimum = self.program.solve(direct, self.lower, self.upper, weight=weight)
            if optimum is None:
                break
            self.descend(optimum.tension)
        return bool(np.isfinite(self.mass))

    def descend(self, tension: FloatArray) -> None:
        """Lower the mass by linear programs with tangents, which lie above it; keep what is better.

        Members without mass get none.
        """
        tension, mass = self.measure(tension)
        for _ in range(MOST_DESCENTS):
            of_member = self.law.find_mass(tension).max(axis=0)
            line = self.law.find_tangent(np.minimum(self.law.find_compression(of_member), 1e12))
            unused = of_member == 0
            lower = np.where(unused, np.maximum(self.program.lower, 0.0), self.program.lower)
            upper = np.where(unused, np.minimum(self.program.upper, 0.0), self.program.upper)
            optimum = self.program.solve(line, lower, upper)
            if optimum is None:
                break
            after, less = self.measure(optimum.tension)
            if less >= mass * (1 - LEAST_GAIN):
                break
            tension, mass = after, less
        if mass < self.mass:
            self.tension, self.mass = tension, mass

    def measure(self, tension: FloatArray) -> tuple[FloatArray, float]:
        """Return forces of the same members that balance to rounding, and their mass, or infinity."""
        program = self.program
        for forces in (*(self.balance(tension, cut) for cut in SMALL_FORCES), tension):
            is_within = (forces >= program.lower).all() and (forces <= program.upper).all()
            if is_within and np.abs(forces @ program.matrix.T - program.load).max() <= LARGEST_RESIDUAL:
                return forces, float(self.law.find_mass(forces).max(axis=0).sum())
        return tension, np.inf

    def balance(self, tension: FloatArray, part: float) -> FloatArray:
        """Return forces that balance at best, of the members with more than a part of the largest force."""
        program = self.program
        exact = np.where(np.abs(tension) > part * np.abs(tension).max(initial=0.0), tension, 0.0)
        exact = np.clip(exact, program.lower, program.upper)
        is_free = (exact != 0) & (exact > program.lower) & (exact < program.upper)
        for case, free, load in zip(exact, is_free, program.load, strict=True):
            columns = program.matrix[:, free]
            case[free] += np.linalg.lstsq(columns, load - program.matrix @ case, rcond=None)[0]
        return exact

    def find_bound(self, lower: FloatArray, upper: FloatArray, more: float = WIDENING) -> Optimum | None:
        """Return the least mass with chords within these limits; None where that is proved not to exist."""
        chord = self.law.find_chord(np.maximum(-upper, 0.0), np.maximum(-lower, 0.0))
        # More than masses within these limits can be, so that it limits nothing.
        optimum = self.program.solve(chord, lower, upper, 2 * self.mass * lower.shape[1])
        if optimum is not None:
            return optimum
        if self.program.find_unbalanced(lower, upper).is_proved:
            return None
        if more > 1:  # neither solved nor proved to have no solution: no mass is below 0
            return Optimum(0.0, self.tension, np.zeros_like(lower))
        wider = np.maximum(lower - more, self.program.lower), np.minimum(upper + more, self.program.upper)
        return self.find_bound(*wider, 10 * more)

    def tighten(self, rounds: int) -> Optimum | None:
        """Limit the tensions of bars to those that forces with less mass than the best can have."""
        heaviest = self.mass / np.maximum(self.law.direct, 1e-300)
        push = np.minimum(heaviest, self.law.find_compression(np.full_like(heaviest, self.mass)))
        self.lower = np.maximum(self.program.lower, -push * (1 + MARGIN))
        self.upper = np.minimum(self.program.upper, heaviest * (1 + MARGIN))
        optimum = self.find_bound(self.lower, self.upper)
        for _ in range(rounds):
            if optimum is None or optimum.bound >= self.mass * (1 - self.gap):
                break
            before = optimum.bound
            for index in zip(*np.nonzero(self.program.is_curved), strict=True):
                chord = self.law.find_chord(np.maximum(-self.upper, 0.0), np.maximum(-self.lower, 0.0))
                for sign, limit in ((1.0, self.lower), (-1.0, self.upper)):
                    cost = np.zeros(self.lower.shape)
                    cost[index] = sign
                    smallest = self.program.solve(chord, self.lower, self.upper, self.mass, cost=cost)
                    if smallest is not None:
                        end = sign * smallest.bound - sign * MARGIN
                        limit[index] = max(limit[index], end) if sign > 0 else min(limit[index], end)
            optimum = self.find_bound(self.lower, self.upper)
            if optimum is None or optimum.bound - before < LEAST_TIGHTENING * (self.mass - before):
                break
        return optimum

    def prove(self, most_splits: int) -> tuple[float, int]:
        """Return a bound of the least mass, and how often an interval was split."""
        root = self.tighten(TIGHTENING_ROUNDS if most_splits > self.lower.size else 1)
        if root is None:
            return self.mass, 0
        proved, splits, made = self.mass, 0, 1  # least bound of all that was left
        queue = [(root.bound, 0, self.lower, self.upper, root)]
        while queue:
            bound, _, lower, upper, optimum = heapq.heappop(queue)
            if bound >= self.mass * (1 - self.gap) or splits >= most_splits:
                return min(proved, bound), splits
            splits += 1
            describe_pass(f"{PROVING}: {1 - bound / self.mass:.3%} open after {splits:,} splits")
            # What one unit of a tension costs limits how far it goes with less mass than the best.
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = (self.mass - bound) / np.abs(optimum.reduced) + MARGIN
            is_dear = np.abs(optimum.reduced) > MARGIN
            lower = np.where(is_dear & (optimum.reduced < 0), np.maximum(lower, upper - reach), lower)
            upper = np.where(is_dear & (optimum.reduced > 0), np.minimum(upper, lower + reach), upper)
            index, at = self.choose_split(lower, upper, optimum.tension)
            if upper[index] - lower[index] <= MARGIN:  # rounding is all that is left
                proved = min(proved, bound)
                continue
            for side in (0, 1):
                low, high = lower.copy(), upper.copy()
                (low if side else high)[index] = at
                child = self.find_bound(low, high)
                if child is None:
                    continue
                if child.bound < self.mass * (1 - self.gap):
                    if self.law.find_mass(child.tension).max(axis=0).sum() < NEAR_BEST * self.mass:
                        self.descend(child.tension)
                    made += 1
                    heapq.heappush(queue, (max(child.bound, bound), made, low, high, child))
                else:
                    proved = min(proved, child.bound)
        return proved, splits

    def choose_split(
        self, lower: FloatArray, upper: FloatArray, tension: FloatArray
    ) -> tuple[tuple[int, int], float]:
        """Return (case, member) whose chord is farthest below its mass, and the tension to split at."""
        push = np.maximum(-tension, 0.0)
        slope, intercept = self.law.find_chord(np.maximum(-upper, 0.0), np.maximum(-lower, 0.0))
        below = np.maximum(slope * push + intercept, self.law.direct * np.abs(tension))
        error = self.law.find_mass(-push) - below.max(axis=0)
        error = np.where(self.program.is_curved, error, -np.inf)
        case, member = np.unravel_index(int(error.argmax()), error.shape)
        index = (int(case), int(member))
        low, high = lower[index], upper[index]
        inside = low < tension[index] < high
        return index, float(tension[index] if inside else 0.5 * (low + high))
