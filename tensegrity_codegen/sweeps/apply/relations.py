"""Values of a structure that equal a key, a multiple of it, or it plus a constant, bit by bit.

A relation is taken only where it holds exactly at every probe, so that what is computed for all cases at once
is what the scene would have given, to the last bit.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray, IntArray

NEARLY = 1e-9  # part by which values are compared before they are compared bit by bit


@dataclass(frozen=True, eq=False)
class Relations:
    """Entries that follow from one key each: value = factor * key + offset, with one of the two operations.

    Attributes
    ----------
    entries, keys : ndarray of int, shape (n,)
        The entry, and the key that it follows from.
    factors, offsets : ndarray, shape (n,)
        Factor 1 and offset 0 for an entry that equals the key; else one of them differs from these.
    """

    entries: IntArray
    keys: IntArray
    factors: FloatArray
    offsets: FloatArray

    def compute(self, values: FloatArray) -> FloatArray:
        """Return the entries of cases with these values (n_cases, n_keys), (n_cases, n)."""
        result: FloatArray = values[:, self.keys]
        if (self.factors != 1).any():
            result = result * self.factors
        return result + self.offsets if (self.offsets != 0).any() else result


def find_relations(x: FloatArray, y: FloatArray, same: float = 0.0) -> Relations:
    """Return the relations that hold at all probes.

    x: (n_probes, n_keys) values of keys; y: (n_probes, n_entries) entries that vary; same: the part by which
    a multiple may differ, 0 for relations to the last bit.
    """
    found: list[tuple[int, int, float, float]] = []
    equal = {x[:, key].tobytes(): key for key in reversed(range(x.shape[1])) if np.ptp(x[:, key]) > 0}
    for entry, column in enumerate(y.T):
        key = equal.get(np.ascontiguousarray(column).tobytes())
        if key is not None:
            found.append((entry, key, 1.0, 0.0))
            continue
        for key in _find_candidates(x, column):
            relation = _relate(x[:, key], column) or _relate_nearly(x[:, key], column, same)
            if relation is not None:
                found.append((entry, key, *relation))
                break
    entries, keys, factors, offsets = (
        [item[part] for item in found] for part in range(4)
    )  # fmt: skip
    return Relations(
        np.array(entries, dtype=np.int64),
        np.array(keys, dtype=np.int64),
        np.array(factors, dtype=np.float64),
        np.array(offsets, dtype=np.float64),
    )


def _find_candidates(x: FloatArray, y: FloatArray) -> list[int]:
    """Return the keys of x (n_probes, n_keys) of which y (n_probes,) is nearly a multiple or a sum."""
    with np.errstate(all="ignore"):
        ratio, difference = y[:, None] / x, y[:, None] - x
    ratio[x == 0] = np.nan
    scale = np.abs(x).max(axis=0) + np.abs(y).max()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of keys that are zero at all probes
        spread = np.nanmax(ratio, axis=0) - np.nanmin(ratio, axis=0)
        is_multiple = spread <= NEARLY * np.abs(np.nanmax(ratio, axis=0))
    is_sum = np.ptp(difference, axis=0) <= NEARLY * scale
    return np.flatnonzero((is_multiple | is_sum) & (np.ptp(x, axis=0) > 0)).tolist()


def _relate(x: FloatArray, y: FloatArray) -> tuple[float, float] | None:
    """Return (factor, offset) with y = factor * x or y = x + offset, None where neither holds exactly."""
    if np.array_equal(x, y):
        return 1.0, 0.0
    for factor in _near(_median_ratio(x, y)):
        if np.array_equal(factor * x, y):
            return factor, 0.0
    for offset in _near(float(np.median(y - x))):
        if np.array_equal(x + offset, y):
            return 1.0, offset
    return None


def _relate_nearly(x: FloatArray, y: FloatArray, same: float) -> tuple[float, float] | None:
    """Return (factor, 0) with y = factor * x but for a part `same` of y."""
    factor = _median_ratio(x, y)
    near = np.abs(factor * x - y) <= same * np.abs(y)
    return (factor, 0.0) if same > 0 and factor != 0 and near.all() else None


def _median_ratio(x: FloatArray, y: FloatArray) -> float:
    some = x != 0
    return float(np.median(y[some] / x[some])) if some.any() else 0.0


def _near(value: float) -> list[float]:
    """Return a number and its neighbours: a quotient of rounded numbers may be one of them."""
    if not np.isfinite(value) or value == 0:
        return []
    steps = [value]
    for direction in (-np.inf, np.inf):
        beside = value
        for _ in range(3):
            beside = float(np.nextafter(beside, direction))
            steps.append(beside)
    return steps
