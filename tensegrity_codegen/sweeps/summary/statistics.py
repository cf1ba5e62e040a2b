"""Statistics of a sweep: outcomes, keys that tell failures apart, distributions, rank correlations."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.analyses.cases.registry import ANALYSES
from tensegrity_codegen.analyses.cases.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import SWEEP, import_extra


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
    """Return Spearman's correlation of values (n,) with columns of keys (n, n_keys); NaN if constant."""
    from scipy.stats import rankdata

    rows = np.isfinite(values)
    result = np.full(keys.shape[1], np.nan)
    if rows.sum() < 3:
        return result
    ranks = rankdata(values[rows])
    if np.ptp(ranks) == 0.0:
        return result
    for column in range(keys.shape[1]):
        key_ranks = rankdata(keys[rows, column])
        if np.ptp(key_ranks) > 0.0:
            result[column] = np.corrcoef(ranks, key_ranks)[0, 1]
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

    failed, good: medians.
    """

    key: str
    distance: float  # the largest difference of the two distribution functions, 0 to 1
    failed: float
    good: float


def count_endings(results: SweepResults) -> tuple[Ending, ...]:
    """Return the statuses that occur, the good ones first, then the most frequent first."""
    endings = []
    for code, status in enumerate(results.words):
        cases = np.flatnonzero(results.status == code)
        if len(cases):
            start = int(cases[0])
            endings.append(Ending(status, status in GOOD, len(cases), start, results.message(start)))
    return tuple(sorted(endings, key=lambda item: (not item.good, item.status == NOT_COMPUTED, -item.count)))


def describe_count(results: SweepResults) -> str:
    """Return the finding in a few words: "9,987 of 10,000 cases converged, 13 did not"."""
    good, n_pending = int(results.is_good.sum()), int((~results.is_computed).sum())
    failed = results.count - good - n_pending
    verb = ANALYSES.get(results.operation, CaseAnalysis).success_phrase
    finding = f"{good:,} of {results.count:,} cases {verb}"
    if failed:
        finding += f", {failed:,} {'failed' if verb.startswith(('were', 'are')) else 'did not'}"
    if good and results.options.get("control") == "steps":
        finding += ", the error of none is estimated"
    return f"{finding}, {n_pending:,} not computed yet" if n_pending else finding


def is_difference_clear(results: SweepResults, difference: KeyDifference) -> bool:
    """Return whether a key tells failed and good cases apart by more than chance (at 5 %)."""
    good = int(results.is_good.sum())
    failed = int(results.is_computed.sum()) - good
    if not (good and failed):
        return False
    return difference.distance > CLEAR * math.sqrt((good + failed) / (good * failed))


def find_failing_keys(results: SweepResults) -> tuple[KeyDifference, ...]:
    """Return the Kolmogorov-Smirnov distance between failed and good cases of each key, largest first."""
    good = results.is_good
    failed = results.is_computed & ~good
    if not (good.any() and failed.any()):
        return ()
    rows = []
    for index, key in enumerate(results.keys):
        values = results.key_values[:, index]
        bad, fine = np.sort(values[failed]), np.sort(values[good])
        points = np.concatenate([bad, fine])
        steps = [np.searchsorted(sample, points, side="right") / len(sample) for sample in (bad, fine)]
        distance = float(np.abs(steps[0] - steps[1]).max())
        rows.append(KeyDifference(key, distance, float(np.median(bad)), float(np.median(fine))))
    return tuple(sorted(rows, key=lambda row: -row.distance))


CONFIDENCE = 0.95
RESAMPLES = 200
MOST_DRAWN = 4_000_000  # numbers that the resampling holds at once
LEAST_SAMPLE = 16
MOST_LOST = 0.05  # part of the base sample that failed cases may take away


@dataclass(frozen=True)
class Indices:
    """First-order and total indices of the keys, with half widths of their 95 % confidence intervals.

    first, total: part of the variance that the key causes alone; and together with others; first_error,
    total_error: half widths of the intervals; zero for a grid, which has no random error.
    """

    keys: tuple[str, ...]  # names of varied numbers
    first: FloatArray
    total: FloatArray
    first_error: FloatArray
    total_error: FloatArray
    source: str  # from which cases, and how, in one sentence


def compute_indices(results: SweepResults, values: FloatArray) -> Indices | str:
    """Return the indices of one result (count,), or the reason why the cases do not allow them."""
    if results.method == "saltelli" and not results.axes:
        return compute_sobol_indices(results.keys, values)
    if results.axes and len(results.axes) == len(results.keys):  # all keys are axes of one grid
        shape = [len(points) for _, points in results.axes]
        return compute_grid_indices(results.keys, values, shape)
    return "they need a grid of all keys, or the sampling saltelli"


def compute_sobol_indices(keys: Sequence[str], values: FloatArray) -> Indices | str:
    """Return Sobol' indices from a sample in the layout of Saltelli.

    keys: what varies, n_keys names; values: results of the rows A, AB_1, ..., AB_n, B of each point of the
    base sample, in this order; NaN where a case has none.

    Estimators of Saltelli et al., Computer Physics Communications 181 (2010) 259-270, by SALib; intervals by
    resampling. A point of the base sample with a failed case is left out with all its cases.
    """
    n = len(keys)
    if len(values) % (n + 2):
        return "the number of cases is not that of a complete sample"
    blocks = values.reshape(-1, n + 2)
    complete = np.isfinite(blocks).all(axis=1)
    lost = 1.0 - complete.mean() if len(blocks) else 1.0
    if lost > MOST_LOST:
        return f"cases without result are missing in {100 * lost:.0f} % of the base sample"
    used = blocks[complete]
    if len(used) < LEAST_SAMPLE:
        return f"{len(used)} points of the base sample are too few; at least {LEAST_SAMPLE} are needed"
    if np.ptp(used) <= 1e-14 * np.abs(used).max():
        return "the result is constant"
    return _analyze(tuple(keys), used, len(blocks))


def _analyze(keys: tuple[str, ...], used: FloatArray, n_base: int) -> Indices:
    """Return the indices of complete rows (n, n_keys + 2)."""
    sobol = import_extra("SALib.analyze.sobol", SWEEP)
    problem = {"num_vars": len(keys), "names": list(keys), "bounds": [[0.0, 1.0]] * len(keys)}
    resamples = int(np.clip(MOST_DRAWN // len(used), 20, RESAMPLES))
    analysis = sobol.analyze(
        problem, used.ravel(), calc_second_order=False, num_resamples=resamples, conf_level=CONFIDENCE, seed=1
    )
    omitted = "" if len(used) == n_base else f", {n_base - len(used)} of {n_base} left out for failed cases"
    first_order, total, first_error, total_error = (
        np.array(analysis[name], dtype=np.float64) for name in ("S1", "ST", "S1_conf", "ST_conf")
    )
    source = f"base sample of {len(used)} points{omitted}; estimators of Saltelli (SALib)"
    return Indices(keys, first_order, total, first_error, total_error, source)


def compute_grid_indices(keys: Sequence[str], values: FloatArray, shape: Sequence[int]) -> Indices | str:
    """Return first-order and total indices of a complete grid, its points equally probable.

    keys: one for each axis; values: results, the last axis running fastest; shape: lengths of the axes.

    S_j = Var(E[Y | x_j]) / Var(Y), T_j = 1 - Var(E[Y | all x but x_j]) / Var(Y), as sums over the points:
    exact for these points.
    """
    if not np.isfinite(values).all():
        lost = int((~np.isfinite(values)).sum())
        return f"{lost} of {len(values)} points of the grid have no result"
    table = values.reshape(tuple(shape))
    centred = table - table.mean()
    variance = float(np.mean(centred**2))
    if np.ptp(table) <= 1e-14 * np.abs(table).max():
        return "the result is constant"
    every = range(table.ndim)
    alone = [float(np.var(centred.mean(axis=tuple(k for k in every if k != j)))) / variance for j in every]
    total = [1.0 - float(np.var(centred.mean(axis=j))) / variance for j in every]
    zero = np.zeros(table.ndim)
    source = "all points of the grid, equally probable"
    return Indices(tuple(keys), np.array(alone), np.array(total), zero, zero, source)
