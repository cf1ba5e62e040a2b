"""The summary of a sweep as data: how cases ended, distributions, indices, worst cases."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.results import KeptQuantity, SweepResults
from tensegrity_codegen.sweeps.summary.statistics import (
    Distribution,
    Ending,
    Indices,
    KeyDifference,
    compute_indices,
    compute_rank_correlation,
    count_endings,
    describe_count,
    describe_distribution,
    find_failing_keys,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest


def _compute_mean(values: FloatArray, axis: int) -> FloatArray:
    """Return the mean along an axis of the numbers that are not NaN; NaN without any."""
    is_known = ~np.isnan(values)
    count = is_known.sum(axis=axis)
    total = np.where(is_known, values, 0.0).sum(axis=axis)
    mean: FloatArray = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return mean


# Over the entries that are there: rows of natural frequencies, for example, are filled up with NaN.
REDUCTIONS: dict[str, Callable[..., FloatArray]] = {
    "max": np.fmax.reduce,
    "min": np.fmin.reduce,
    "mean": _compute_mean,
}
DEFAULT_COUNT = 4
# What states how a result was computed; described by default where nothing else was kept.
DIAGNOSTICS = (
    "residual", "residual_rate", "energy_drift", "error_estimate", "n_steps", "steps", "rejected",
    "iterations", "neutral_motions", "saddles_left", "zero_eigenvalues",
)  # fmt: skip
_SPEC = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(?:\[(.*)\])?\s*")


@dataclass(frozen=True)
class ChosenResult:
    """One number a case: its name as on the command line, unit, sentence, values (count,), NaN if none."""

    name: str
    unit: str
    sentence: str
    values: FloatArray

    @property
    def label(self) -> str:
        """Name and unit, for axes and headings."""
        return f"{self.name} [{self.unit}]" if self.unit not in ("", "1") else self.name


def choose_results(results: SweepResults, names: Sequence[str] = ()) -> tuple[ChosenResult, ...]:
    """Return the results that are named, else the first few of the sweep.

    names: "NAME", or for a quantity with dimensions "NAME[PART,...]": a part for each dimension, which is a
        label, a place from 0 on (-1: the last) or max, min, mean; one of these three alone is over all
        dimensions. NAME without parts stands for NAME[max] and NAME[min].
    Raises UnknownNameError for a quantity or label that the sweep does not have; InvalidValueError for a text
    that is no such name, or another number of parts.
    """
    picks: dict[str, tuple[KeptQuantity, tuple[str, ...]]] = {}
    for spec in names or _default_specs(results):
        for name, quantity, reductions in _read_spec(results, spec):
            picks[name] = (quantity, reductions)
    if not names:
        picks = dict(list(picks.items())[:DEFAULT_COUNT])
    good = results.is_good
    return tuple(_compute(name, quantity, reductions, good) for name, (quantity, reductions) in picks.items())


def _default_specs(results: SweepResults) -> list[str]:
    """Return tensions, numbers, quantities with dimensions, diagnostics; in the order of `keep`."""
    order = sorted(
        (quantity for quantity in results.kept.values() if quantity.shape == () or min(quantity.shape) > 0),
        key=lambda quantity: (
            quantity.name in DIAGNOSTICS,
            quantity.name == "displacement" and "change" in results.kept,  # almost the same
            _find_rank(quantity.name, results.keep),
            not quantity.name.startswith("member_tension"),
            len(quantity.dims),
        ),
    )
    few = [quantity for quantity in order if len(quantity.dims) < 2]
    return [spec for quantity in few or order for spec in _list_parts(quantity)]


def _find_rank(name: str, keep: Sequence[str]) -> int:
    """Return the index of a result among the kept ones, written NAME or NAME = EXPRESSION."""
    written = [entry.partition("=")[0].strip() for entry in keep]
    return written.index(name) if name in written else len(written)


def _list_parts(item: KeptQuantity) -> list[str]:
    """Return the descriptions of a quantity by one number a case that are not the same."""
    if not item.dims:
        return [item.name]
    if math.prod(item.shape) == 1:
        return [f"{item.name}[{','.join(str(labels[0]) for labels in item.labels)}]"]
    ending = item.name.rpartition("_")[2]
    return [f"{item.name}[{name}]" for name in ([ending] if ending in ("max", "min") else ["max", "min"])]


def _read_spec(results: SweepResults, text: str) -> list[tuple[str, KeptQuantity, tuple[str, ...]]]:
    """Return name, quantity and parts of each result that a text stands for."""
    match = _SPEC.fullmatch(text)
    if match is None:
        problem = "not the name of a result"
        raise InvalidValueError(problem, where="result", given=text, allowed="NAME or NAME[PART,...]")
    name, inside = match[1], match[2]
    if name not in results.kept:
        allowed, hint = "a quantity that the sweep kept", suggest(name, results.kept)
        raise UnknownNameError("unknown result", where="result", given=name, allowed=allowed, hint=hint)
    quantity = results.kept[name]
    if not quantity.dims and inside is None:
        return [(name, quantity, ())]
    if inside is None:
        return [(f"{name}[{reduction}]", quantity, (reduction,)) for reduction in ("max", "min")]
    reductions = tuple(choice.strip() for choice in inside.split(","))
    alone = len(reductions) == 1 and reductions[0] in REDUCTIONS and quantity.dims
    if len(reductions) != len(quantity.dims) and not alone:
        problem = f"{len(reductions)} parts for a quantity with {len(quantity.dims)} dimensions"
        raise InvalidValueError(problem, where="result", given=text, allowed=_describe_parts(quantity))
    for dimension, choice in enumerate(reductions):
        if choice not in REDUCTIONS:
            _find_place(quantity, dimension, choice)
    return [(f"{name}[{','.join(reductions)}]", quantity, reductions)]


def _describe_parts(quantity: KeptQuantity) -> str:
    """Return how parts of this quantity are written."""
    if not quantity.dims:
        return f"{quantity.name} alone: it is one number a case"
    return f"{quantity.name}[{','.join(dim.upper() for dim in quantity.dims)}], or max, min, mean"


def _find_place(quantity: KeptQuantity, place: int, part: str) -> int:
    """Return the index along a dimension that a label or number means."""
    labels = [str(label) for label in quantity.labels[place]]
    if part in labels:
        return labels.index(part)
    size = quantity.shape[place]
    if re.fullmatch(r"-?\d{1,9}", part) and -size <= int(part) < size:
        return int(part)
    problem = f"unknown {quantity.dims[place]} of {quantity.name}"
    allowed = f"a label, a place from 0 to {size - 1}, or max, min, mean"
    raise UnknownNameError(problem, where="result", given=part, allowed=allowed, hint=suggest(part, labels))


def _compute(
    name: str, quantity: KeptQuantity, parts: tuple[str, ...], good: NDArray[np.bool_]
) -> ChosenResult:
    """Return the result, read in pieces; cases that are not good have NaN."""
    values = np.full(len(good), np.nan)
    for start, block in quantity.blocks():
        values[start : start + len(block)] = _reduce(quantity, parts, block)
    values[~good] = np.nan
    return ChosenResult(name, quantity.unit, quantity.sentence, values)


def _reduce(quantity: KeptQuantity, parts: tuple[str, ...], block: FloatArray) -> FloatArray:
    """Return one number for each row of a block (rows, *shape)."""
    if not quantity.dims:
        return block
    if len(parts) == 1 and parts[0] in REDUCTIONS:
        flat = block.reshape(len(block), -1)
        return np.asarray(REDUCTIONS[parts[0]](flat, axis=1), dtype=np.float64)
    for dimension in reversed(range(len(parts))):
        axis = dimension + 1
        if parts[dimension] in REDUCTIONS:
            block = np.asarray(REDUCTIONS[parts[dimension]](block, axis=axis))
        else:
            block = np.take(block, _find_place(quantity, dimension, parts[dimension]), axis=axis)
    return block


MOST_OF_A_KIND = 3  # worst cases
BuildCommands = Callable[[SweepResults, int], tuple[str, ...]]


@dataclass(frozen=True)
class WorstCase:
    """A case: number, why it is listed, status, message, values of the keys, commands that run it alone."""

    case: int
    reason: str
    status: str
    message: str
    keys: dict[str, float]
    commands: tuple[str, ...]


def find_worst_cases(
    results: SweepResults, chosen: Sequence[ChosenResult], build_commands: BuildCommands
) -> tuple[WorstCase, ...]:
    """Return the first cases of each bad status, and those with extreme results, once with all reasons."""
    reasons: dict[int, list[str]] = {}
    for code, label in enumerate(results.words):
        if label in GOOD or label == NOT_COMPUTED:
            continue
        for case in np.flatnonzero(results.status == code)[:MOST_OF_A_KIND].tolist():
            reasons.setdefault(case, []).append(label.replace("_", " "))
    for result in chosen:
        values = result.values
        if not np.isfinite(values).any() or np.nanmax(values) == np.nanmin(values):
            continue
        unit = "" if result.unit in ("", "1") else f" {result.unit}"
        for label, case in (("largest", np.nanargmax(values)), ("least", np.nanargmin(values))):
            reasons.setdefault(int(case), []).append(f"{label} {result.name}: {values[case]:.6g}{unit}")
    return tuple(
        WorstCase(
            case,
            "; ".join(texts),
            results.words[int(results.status[case])],
            results.message(case),
            dict(zip(results.keys, results.key_values[case].tolist(), strict=True)),
            build_commands(results, case),
        )
        for case, texts in reasons.items()
    )


@dataclass(frozen=True)
class ResultSummary:
    """One result: values, distribution, rank correlation with each key, and indices or why there are none."""

    result: ChosenResult
    distribution: Distribution
    correlation: FloatArray
    indices: Indices | str

    @property
    def is_constant(self) -> bool:
        """Whether all cases have the same value, but for rounding."""
        low, high = self.distribution.least, self.distribution.largest
        return bool(high - low <= 1e-12 * max(abs(low), abs(high)))

    @property
    def strength(self) -> FloatArray:
        """How much each key matters, (n_keys,), for the order of figures: total indices or correlations."""
        if isinstance(self.indices, Indices):
            return self.indices.total
        return np.nan_to_num(np.abs(self.correlation))


@dataclass(frozen=True)
class SweepSummary:
    """All that is found of a sweep; `over`: places of the keys that the user chose, () if none."""

    results: SweepResults
    endings: tuple[Ending, ...]
    failing: tuple[KeyDifference, ...]
    chosen: tuple[ResultSummary, ...]
    worst: tuple[WorstCase, ...]
    over: tuple[int, ...] = ()

    @property
    def headline(self) -> str:
        """The finding: how many cases converged."""
        return describe_count(self.results)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary in plain types."""
        results = self.results
        n_pending = int((~results.is_computed).sum())
        return {
            "scene": results.scene,
            "do": results.operation,
            "headline": self.headline,
            "n_cases": results.count,
            "n_good": int(results.is_good.sum()),
            "n_not_computed": n_pending,
            "n_not_run": n_pending,  # the same by its former name
            "method": results.method,
            "seed": results.seed,
            "keys": [_describe_key(results, index) for index in range(len(results.keys))],
            "endings": [asdict(entry) for entry in self.endings],
            "failing_keys": [asdict(entry) for entry in self.failing],
            "results": [_describe_result(entry, results.keys) for entry in self.chosen],
            "worst": [asdict(entry) for entry in self.worst],
        }


def summarize(
    results: SweepResults,
    names: Sequence[str] = (),
    over: Sequence[str] = (),
    build_commands: BuildCommands = lambda results, case: (),
) -> SweepSummary:
    """Return the summary of a sweep; names: results; over: keys of figures, else the strongest."""
    key_indices = tuple(dict.fromkeys(_find_key(results, key) for key in over))
    chosen = choose_results(results, names)
    summaries = tuple(
        ResultSummary(
            result,
            describe_distribution(result.values),
            compute_rank_correlation(results.key_values, result.values),
            compute_indices(results, result.values),
        )
        for result in chosen
    )
    return SweepSummary(
        results,
        count_endings(results),
        find_failing_keys(results),
        summaries,
        find_worst_cases(results, chosen, build_commands),
        key_indices,
    )


def _find_key(results: SweepResults, key: str) -> int:
    if key not in results.keys:
        allowed, hint = ", ".join(results.keys) or "the sweep varies no key", suggest(key, results.keys)
        raise UnknownNameError("this key does not vary", where="over", given=key, allowed=allowed, hint=hint)
    return results.keys.index(key)


def _describe_key(results: SweepResults, place: int) -> dict[str, Any]:
    values = results.key_values[:, place]
    key = results.keys[place]
    return {
        "key": key,
        "range": results.ranges.get(key, ""),
        "is_axis": key in dict(results.axes),
        "n_values": len(np.unique(values)),
        **describe_distribution(values).as_dict(),
    }


def _describe_result(item: ResultSummary, keys: tuple[str, ...]) -> dict[str, Any]:
    indices = item.indices
    indices_data: dict[str, Any] = {"indices": None, "no_indices": indices} if isinstance(indices, str) else {
        "indices": asdict(indices), "no_indices": ""
    }  # fmt: skip
    return {
        "name": item.result.name,
        "unit": item.result.unit,
        "sentence": item.result.sentence,
        "distribution": item.distribution.as_dict(),
        "rank_correlation": dict(zip(keys, item.correlation.tolist(), strict=True)),
        **indices_data,
    }
