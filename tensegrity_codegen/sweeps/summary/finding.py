"""The finding of a sweep in one sentence of numbers, the headline of its page; its tables in the terminal."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import BEYOND
from tensegrity_codegen.analyses.cases.record import LIMIT_USE
from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED
from tensegrity_codegen.report.long_table import LongTable, rank_rows
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.sweeps.summary.chosen import ChosenResult
from tensegrity_codegen.sweeps.summary.indices import Indices
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.sweeps.summary.statistics import Distribution, describe_count, is_difference_clear
from tensegrity_codegen.sweeps.summary.summary import ResultSummary, SweepSummary
from tensegrity_codegen.system.errors import name_list

MOST_STATUSES = 2
MOST_NAMED = 3  # keys in the lead, and of a worst case in the terminal


def describe_finding(summary: SweepSummary) -> str:
    """Return how many cases have a result, why others have none, and the range of the first result."""
    results = summary.results
    good = int(results.is_good.sum())
    text = describe_count(results)
    if good == results.count and good > 1:
        text = f"All {text.partition(' of ')[2]}"
    words = [item.status for item in summary.endings if not item.good and item.status != NOT_COMPUTED]
    if words:
        shown = ", ".join(word.replace("_", " ") for word in words[:MOST_STATUSES])
        text += f" ({shown}{', ...' if len(words) > MOST_STATUSES else ''})"
    beyond = _count_beyond(results)
    if beyond:
        text += f"; in {beyond:,} {BEYOND}"
    found = [item for item in summary.chosen if item.distribution.count]
    if not found:
        return text
    item = found[0]
    return f"{text}; {describe_range(item.result, item.distribution)}"


def _count_beyond(results: SweepResults) -> int:
    """Return the number of good cases with a limit_use above 1, 0 where it was not kept."""
    if LIMIT_USE not in results.kept:
        return 0
    blocks = results.kept[LIMIT_USE].blocks()
    return sum(int((results.is_good[k : k + len(use)] & (use > 1)).sum()) for k, use in blocks)


def describe_range(result: ChosenResult, spread: Distribution) -> str:
    """Return the least and largest value of a result: "member_tension[max] 1.2 to 30 N"."""
    unit = _unit(result.unit)
    low, high = (_format(value, spread) for value in (spread.least, spread.largest))
    values = low if low == high else f"{low} to {high}"
    return f"{result.name} {values}{unit}{' in all cases' if low == high and spread.count > 1 else ''}"


def _format(value: float, spread: Distribution) -> str:
    """Return a number with digits that show the range; what is rounding beside the other end is zero."""
    if abs(value) < 1e-12 * max(abs(spread.least), abs(spread.largest)):
        return "0"
    digits = 3
    while (
        digits < 9
        and spread.least != spread.largest
        and abs(spread.largest - spread.least) < abs(value) * 10.0 ** (1 - digits)
    ):
        digits += 1
    return format_short(value, digits)


def describe_lead(summary: SweepSummary) -> str:
    """Return the main findings in two or three sentences."""
    results, keys = summary.results, summary.results.keys
    varied = [_describe_varied(summary, place) for place in range(len(keys))]
    texts = [f"Varied: {name_list(varied, MOST_NAMED)}."] if varied else []
    for row in [row for row in summary.failing if is_difference_clear(results, row)][:1]:
        unit = _unit(results.key_units.get(row.key, ""))
        texts.append(
            f"Failed cases differ most in {row.key}: median {format_short(row.failed)}{unit}, "
            f"{format_short(row.good)}{unit} of the others."
        )
    for item in summary.chosen[:1]:
        if isinstance(item.indices, Indices) and len(keys) > 1:
            top = int(np.argmax(item.indices.total))
            texts.append(
                f"{keys[top]} causes {100 * item.indices.first[top]:.0f} % of the variance of "
                f"{item.result.name} alone, {100 * item.indices.total[top]:.0f} % together with other keys."
            )
    return " ".join(texts)


def _describe_varied(summary: SweepSummary, place: int) -> str:
    """Return a key with its least and largest value: "gravity[2] −20 to 0 m/s2"."""
    results = summary.results
    key, values = results.keys[place], results.key_values[:, place]
    low, high = (
        format_short(float(pick(values, initial=np.nan))) for pick in (np.fmin.reduce, np.fmax.reduce)
    )
    return f"{key} {low}{f' to {high}' if low != high else ''}{_unit(results.key_units.get(key, ''))}"


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def list_tables(summary: SweepSummary) -> Iterator[LongTable | str]:
    """Yield endings, keys of failures, results, what these depend on, and worst cases."""
    endings = [(item.status, f"{item.count:,}", str(item.first), item.message) for item in summary.endings]
    yield _table("frrf", ("status", "cases", "first case", "its message"), endings, "statuses")
    failing = [
        (row.key, f"{row.distance:.2f}", f"{row.failed:.5g}", f"{row.good:.5g}") for row in summary.failing
    ]
    if failing:
        heads = ("key", "distance of\nfailed cases", "median,\nfailed", "median,\ngood")
        yield _table("frrr", heads, failing, "keys", "largest distance")
    if not summary.chosen:
        return
    columns = ("result", "unit", "least", "5 %", "median", "mean", "95 %", "largest")
    yield _table("ffrrrrrr", columns, [_describe_spread(item) for item in summary.chosen], "results")
    yield from _causes(summary)
    worst = [(str(item.case), _list_keys(item.keys), item.reason) for item in summary.worst]
    yield _table("rff", ("worst case", "its keys", "why"), worst, "worst cases")


def _list_keys(keys: Mapping[str, float]) -> str:
    """Return the first keys of a case with their values, and how many more it has."""
    return name_list([f"{key} = {value:.5g}" for key, value in keys.items()], MOST_NAMED)


def _describe_spread(item: ResultSummary) -> tuple[str, ...]:
    """Return a result with its distribution, as a row."""
    spread = item.distribution
    numbers = (
        spread.least, spread.percent_5, spread.median, spread.mean, spread.percent_95, spread.largest
    )  # fmt: skip
    return (item.result.name, item.result.unit, *(f"{value:.5g}" for value in numbers))


def _causes(summary: SweepSummary) -> Iterator[LongTable | str]:
    """Yield a table of indices and correlations; reasons where there are no indices."""
    rows = []
    for item in summary.chosen:
        found = item.indices if isinstance(item.indices, Indices) else None
        for place, key in enumerate(summary.results.keys):
            words = ("", "")
            if found is not None:
                words = (
                    f"{found.first[place]:.3f} ± {found.first_error[place]:.3f}",
                    f"{found.total[place]:.3f} ± {found.total_error[place]:.3f}",
                )
            rows.append((item.result.name, key, *words, f"{item.correlation[place]:.2f}"))
    order = rank_rows(-np.concatenate([item.strength for item in summary.chosen]))
    heads = ("result", "key", "first order", "total", "rank\ncorrelation")
    yield _table("ffrrr", heads, rows, "pairs of result and key", "strongest", order)
    for reason in sorted({item.indices for item in summary.chosen if isinstance(item.indices, str)}):
        yield f"no Sobol' indices: {reason}"


def _table(
    sides: str,
    heads: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    things: str,
    why: str = "first",
    order: Sequence[int] | None = None,
) -> LongTable:
    """Return a table without title; order: of its rows, where the first are not those that matter most."""
    ranking = ((why, range(len(rows)) if order is None else order),)
    return LongTable("", heads, sides, len(rows), rows.__getitem__, things, ranking)
