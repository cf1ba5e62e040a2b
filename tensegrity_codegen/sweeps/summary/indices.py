"""Sobol' indices: which part of a result's variance each key causes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import SWEEP, import_extra

CONFIDENCE = 0.95
RESAMPLES = 200
MOST_DRAWN = 4_000_000  # numbers that the resampling holds at once
LEAST_SAMPLE = 16
MOST_LOST = 0.05  # part of the base sample that failed cases may take away


@dataclass(frozen=True)
class Indices:
    """First-order and total indices of the keys, with half widths of their 95 % confidence intervals.

    keys: what varies.
    first, total: part of the variance that the key causes alone; and together with others.
    first_error, total_error: half widths of the intervals; zero for a grid, which has no random error.
    source: from which cases, and how, in one sentence.
    """

    keys: tuple[str, ...]
    first: FloatArray
    total: FloatArray
    first_error: FloatArray
    total_error: FloatArray
    source: str


def compute_indices(results: SweepResults, values: FloatArray) -> Indices | str:
    """Return the indices of one result (count,), or the reason why the cases do not allow them.

    Raises MissingExtraError: without SALib, for a sample made for it.
    """
    if results.method == "saltelli" and not results.axes:
        return compute_sobol_indices(results.keys, values)
    if results.is_grid:
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
    found = sobol.analyze(
        problem,
        used.ravel(),
        calc_second_order=False,
        num_resamples=resamples,
        conf_level=CONFIDENCE,
        seed=1,
    )
    part = "" if len(used) == n_base else f", {n_base - len(used)} of {n_base} left out for failed cases"
    first, total, first_error, total_error = (
        np.array(found[name], dtype=np.float64) for name in ("S1", "ST", "S1_conf", "ST_conf")
    )
    source = f"base sample of {len(used)} points{part}; estimators of Saltelli (SALib)"
    return Indices(keys, first, total, first_error, total_error, source)


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
    first = [float(np.var(centred.mean(axis=tuple(k for k in every if k != j)))) / variance for j in every]
    total = [1.0 - float(np.var(centred.mean(axis=j))) / variance for j in every]
    zero = np.zeros(table.ndim)
    source = "all points of the grid, equally probable"
    return Indices(tuple(keys), np.array(first), np.array(total), zero, zero, source)
