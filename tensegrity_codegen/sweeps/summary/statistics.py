"""Statistics of a sweep: outcomes, keys that tell failures apart, distributions, rank correlations."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.analyses.cases.registry import ANALYSES
from tensegrity_codegen.analyses.cases.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class Distribution:
    """Numbers that describe a result over the cases that have one; NaN without any."""

    count: int
    least: float
    percent_5: float
    median: float
    mean: float
    percent_95: float
    largest: float
    deviation: float

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return asdict(self)


def describe_distribution(values: FloatArray) -> Distribution:
    """Return the distribution of the finite values among `values`."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return Distribution(0, *(7 * [float("nan")]))
    low, median, high = np.quantile(finite, [0.05, 0.5, 0.95]).tolist()
    spread = float(finite.std(ddof=1)) if len(finite) > 1 else 0.0
    return Distribution(
        len(finite), float(finite.min()), low, median, float(finite.mean()), high, float(finite.max()), spread
    )


def compute_rank_correlation(keys: FloatArray, values: FloatArray) -> FloatArray:
    """Return Spearman's rank correlation of `values` (n,) with each column of `keys` (n, n_keys).

    Rows without a finite value are left aside; NaN where a column or the values are constant.
    """
    from scipy.stats import rankdata

    rows = np.isfinite(values)
    result = np.full(keys.shape[1], np.nan)
    if rows.sum() < 3:
        return result
    ranks = rankdata(values[rows])
    if np.ptp(ranks) == 0.0:
        return result
    for place in range(keys.shape[1]):
        others = rankdata(keys[rows, place])
        if np.ptp(others) > 0.0:
            result[place] = np.corrcoef(ranks, others)[0, 1]
    return result


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
    verb = ANALYSES.get(results.operation, CaseAnalysis).success_phrase
    text = f"{good:,} of {results.count:,} cases {verb}"
    if failed:
        text += f", {failed:,} {'failed' if verb.startswith(('were', 'are')) else 'did not'}"
    if good and results.options.get("control") == "steps":
        text += ", the error of none is estimated"
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
