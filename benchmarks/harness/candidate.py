"""A candidate: one way to evaluate one function; and how candidates are timed side by side.

Candidates take turns: each round runs every one of them once, so that a slow moment of the machine falls on
all. Ratios are taken round by round, and their median is what is reported. Times are processor time of this
process, all its threads, so that others on the same core do not count.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.compiled import Built

FloatArray = NDArray[np.float64]

ROUNDS = 15
TARGET = 4e-3  # s that one turn takes
MOST_CALLS = 1_000_000


class Unavailable(Exception):
    """A candidate that is not there; the text says why, and is shown in its row."""


@dataclass
class Candidate:
    """One way to evaluate one function.

    name: row title; run: count -> seconds for that many calls; value: the result of the last call; side:
    "ours" or "peer"; called: from where ("C" or "Python"); per_call: evaluations in one call; built: how its
    code was compiled; made: seconds to make it, compiler included; kept: what must live as long as it does.
    """

    name: str
    run: Callable[[int], float]
    value: Callable[[], FloatArray]
    side: str = "peer"
    called: str = "Python"
    per_call: int = 1
    built: Built | None = None
    made: float | None = None
    kept: object = None


@dataclass(frozen=True)
class Timing:
    """Nanoseconds an evaluation, round by round."""

    rounds: FloatArray

    @property
    def median(self) -> float:
        """Median over the rounds [ns]."""
        return float(np.median(self.rounds))

    @property
    def spread(self) -> float:
        """Distance of the quartiles, as part of the median."""
        low, high = np.percentile(self.rounds, (25, 75))
        return float((high - low) / self.median)

    def times_faster_than(self, other: "Timing") -> float:
        """Return the median over rounds of other / self."""
        return float(np.median(other.rounds / self.rounds))


def repeat_python(call: Callable[[], object]) -> Callable[[int], float]:
    """Return run(count) -> seconds of processor time, for something that is called from Python."""

    def run(count: int) -> float:
        started = time.process_time()
        for _ in range(count):
            call()
        return time.process_time() - started

    return run


def measure(
    candidates: Sequence[Candidate], rounds: int = ROUNDS, target: float = TARGET
) -> dict[str, Timing]:
    """Return name -> timing of all candidates, which take turns for that many rounds of `target` [s] each."""
    counts = [_calibrate(candidate, target) for candidate in candidates]
    samples = np.empty((len(candidates), rounds))
    for turn in range(rounds):
        for index, (candidate, count) in enumerate(zip(candidates, counts, strict=True)):
            samples[index, turn] = candidate.run(count) / (count * candidate.per_call) * 1e9
    return {candidate.name: Timing(row) for candidate, row in zip(candidates, samples, strict=True)}


def _calibrate(candidate: Candidate, target: float) -> int:
    """Return how many calls take about `target` [s], after the first ones have warmed everything up."""
    count, taken = 1, max(candidate.run(1), 1e-9)
    while taken < target / 4 and count < MOST_CALLS:
        count *= 2
        taken = max(candidate.run(count), 1e-9)
    return max(1, min(MOST_CALLS, round(count * target / taken)))
