"""Outcomes of the cases of a sweep: counts, first messages, and the keys that tell failures apart."""

import math
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.sweeps.operations import OPERATIONS
from tensegrity_codegen.sweeps.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.sweeps.tasks.operation import Operation

CLEAR = 1.36  # of the distance of Kolmogorov and Smirnov over its scale: by chance in 5 of 100 samples


@dataclass(frozen=True)
class Ending:
    """A status: word, whether it is good, number of cases, the first case with it and its message."""

    status: str
    good: bool
    count: int
    first: int
    message: str


@dataclass(frozen=True)
class KeyDifference:
    """How differently a key is distributed in failed cases.

    distance: the largest difference of the two distribution functions, 0 to 1; failed, good: medians.
    """

    key: str
    distance: float
    failed: float
    good: float


def count_endings(results: SweepResults) -> tuple[Ending, ...]:
    """Return the statuses that occur, the good ones first, then the most frequent first."""
    endings = []
    for place, word in enumerate(results.words):
        cases = np.flatnonzero(results.status == place)
        if len(cases):
            first = int(cases[0])
            endings.append(Ending(word, word in GOOD, len(cases), first, results.message(first)))
    return tuple(sorted(endings, key=lambda item: (not item.good, item.status == NOT_COMPUTED, -item.count)))


def describe_count(results: SweepResults) -> str:
    """Return the finding in a few words: "9,987 of 10,000 cases converged, 13 did not"."""
    good, left = int(results.is_good.sum()), int((~results.is_computed).sum())
    failed = results.count - good - left
    verb = OPERATIONS.get(results.operation, Operation).ended
    text = f"{good:,} of {results.count:,} cases {verb}"
    if failed:
        text += f", {failed:,} {'failed' if verb.startswith(('were', 'are')) else 'did not'}"
    return f"{text}, {left:,} not computed yet" if left else text


def is_difference_clear(results: SweepResults, difference: KeyDifference) -> bool:
    """Return whether a key tells failed and good cases apart by more than chance (at 5 %)."""
    good = int(results.is_good.sum())
    failed = int(results.is_computed.sum()) - good
    if not (good and failed):
        return False
    return difference.distance > CLEAR * math.sqrt((good + failed) / (good * failed))


def find_failing_keys(results: SweepResults) -> tuple[KeyDifference, ...]:
    """Return how each key differs between failed and good cases, the largest difference first.

    Notes
    -----
    The distance is that of Kolmogorov and Smirnov between the two empirical distributions. Empty unless some
    cases failed and some are good.
    """
    good = results.is_good
    failed = results.is_computed & ~good
    if not (good.any() and failed.any()):
        return ()
    rows = []
    for place, key in enumerate(results.keys):
        values = results.key_values[:, place]
        bad, fine = np.sort(values[failed]), np.sort(values[good])
        points = np.concatenate([bad, fine])
        steps = [np.searchsorted(part, points, side="right") / len(part) for part in (bad, fine)]
        distance = float(np.abs(steps[0] - steps[1]).max())
        rows.append(KeyDifference(key, distance, float(np.median(bad)), float(np.median(fine))))
    return tuple(sorted(rows, key=lambda row: -row.distance))
