"""Distributions of results, and how closely they follow the keys."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

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
