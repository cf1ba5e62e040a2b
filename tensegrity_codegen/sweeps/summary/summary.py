"""The summary of a sweep as data: how cases ended, distributions, indices, worst cases."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.sweeps.summary.chosen import ChosenResult, choose_results
from tensegrity_codegen.sweeps.summary.indices import Indices, compute_indices
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.sweeps.summary.statistics import (
    Distribution,
    Ending,
    KeyDifference,
    compute_rank_correlation,
    count_endings,
    describe_count,
    describe_distribution,
    find_failing_keys,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import UnknownNameError, suggest

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
    results: SweepResults,
    chosen: Sequence[ChosenResult],
    build_commands: BuildCommands,
    most: int = MOST_OF_A_KIND,
) -> tuple[WorstCase, ...]:
    """Return the first cases of each bad status, and those with the largest and least value of each result.

    A case is listed once, with all its reasons; build_commands returns what runs it alone.
    """
    reasons: dict[int, list[str]] = {}
    for place, word in enumerate(results.words):
        if word in GOOD or word == NOT_COMPUTED:
            continue
        for case in np.flatnonzero(results.status == place)[:most].tolist():
            reasons.setdefault(case, []).append(word.replace("_", " "))
    for result in chosen:
        values = result.values
        if not np.isfinite(values).any() or np.nanmax(values) == np.nanmin(values):
            continue
        unit = "" if result.unit in ("", "1") else f" {result.unit}"
        for word, case in (("largest", np.nanargmax(values)), ("least", np.nanargmin(values))):
            reasons.setdefault(int(case), []).append(f"{word} {result.name}: {values[case]:.6g}{unit}")
    return tuple(
        _describe(results, case, "; ".join(texts), build_commands(results, case))
        for case, texts in reasons.items()
    )


def _describe(results: SweepResults, case: int, reason: str, commands: tuple[str, ...]) -> WorstCase:
    return WorstCase(
        case,
        reason,
        results.words[int(results.status[case])],
        results.message(case),
        dict(zip(results.keys, results.key_values[case].tolist(), strict=True)),
        commands,
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
        left = int((~results.is_computed).sum())
        return {
            "scene": results.scene,
            "do": results.operation,
            "headline": self.headline,
            "n_cases": results.count,
            "n_good": int(results.is_good.sum()),
            "n_not_computed": left,
            "n_not_run": left,  # the same by its former name
            "method": results.method,
            "seed": results.seed,
            "keys": [_describe_key(results, place) for place in range(len(results.keys))],
            "endings": [asdict(item) for item in self.endings],
            "failing_keys": [asdict(item) for item in self.failing],
            "results": [_describe_result(item, results.keys) for item in self.chosen],
            "worst": [asdict(item) for item in self.worst],
        }


def summarize(
    results: SweepResults,
    names: Sequence[str] = (),
    over: Sequence[str] = (),
    build_commands: BuildCommands = lambda results, case: (),
) -> SweepSummary:
    """Return the summary of a sweep.

    names: results, as in `choose_results`; by default the first few.
    over: keys that results are drawn over; by default those that matter most.
    build_commands: returns the commands that run a case alone, for each of the worst cases.
    Raises UnknownNameError, InvalidValueError for a result or key that the sweep does not have.
    """
    places = tuple(dict.fromkeys(_find_key(results, key) for key in over))
    chosen = choose_results(results, names)
    summaries = tuple(
        ResultSummary(
            item,
            describe_distribution(item.values),
            compute_rank_correlation(results.key_values, item.values),
            compute_indices(results, item.values),
        )
        for item in chosen
    )
    return SweepSummary(
        results,
        count_endings(results),
        find_failing_keys(results),
        summaries,
        find_worst_cases(results, chosen, build_commands),
        places,
    )


def _find_key(results: SweepResults, key: str) -> int:
    if key not in results.keys:
        raise UnknownNameError(
            "this key does not vary",
            where="over",
            given=key,
            allowed=", ".join(results.keys) or "the sweep varies no key",
            hint=suggest(key, results.keys),
        )
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
    found: dict[str, Any] = {"indices": None, "no_indices": indices} if isinstance(indices, str) else {
        "indices": asdict(indices), "no_indices": ""
    }  # fmt: skip
    return {
        "name": item.result.name,
        "unit": item.result.unit,
        "sentence": item.result.sentence,
        "distribution": item.distribution.as_dict(),
        "rank_correlation": dict(zip(keys, item.correlation.tolist(), strict=True)),
        **found,
    }
