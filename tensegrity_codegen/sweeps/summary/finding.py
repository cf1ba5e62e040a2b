"""The finding of a sweep in one sentence of numbers, the headline of its page; its tables in the terminal."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import BEYOND
from tensegrity_codegen.analyses.cases.record import LIMIT_USE
from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED
from tensegrity_codegen.report.long_table import LongTable, rank_rows
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.sweeps.summary.statistics import (
    Distribution,
    Indices,
    describe_count,
    is_difference_clear,
)
from tensegrity_codegen.sweeps.summary.summary import ChosenResult, ResultSummary, SweepSummary
from tensegrity_codegen.system.errors import name_list

MOST_STATUSES = 2
MOST_NAMED = 3  # keys in the lead, and of a worst case in the terminal


def describe_finding(summary: SweepSummary) -> str:
    """Return how many cases have a result, why others have none, and the range of the first result."""
    results = summary.results
    good = int(results.is_good.sum())
    finding = describe_count(results)
    if good == results.count and good > 1:
        finding = f"All {finding.partition(' of ')[2]}"
    statuses = [entry.status for entry in summary.endings if not entry.good and entry.status != NOT_COMPUTED]
    if statuses:
        shown = ", ".join(status.replace("_", " ") for status in statuses[:MOST_STATUSES])
        finding += f" ({shown}{', ...' if len(statuses) > MOST_STATUSES else ''})"
    beyond = _count_beyond(results)
    if beyond:
        finding += f"; in {beyond:,} {BEYOND}"
    summaries = [entry for entry in summary.chosen if entry.distribution.count]
    if not summaries:
        return finding
    entry = summaries[0]
    return f"{finding}; {describe_range(entry.result, entry.distribution)}"


def _count_beyond(results: SweepResults) -> int:
    """Return the number of good cases with a limit_use above 1, 0 without this result."""
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
    """Return a number with digits that show the range; zero if it is rounding beside the other end."""
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
    varied = [_describe_varied(summary, index) for index in range(len(keys))]
    texts = [f"Varied: {name_list(varied, MOST_NAMED)}."] if varied else []
    for row in [row for row in summary.failing if is_difference_clear(results, row)][:1]:
        unit = _unit(results.key_units.get(row.key, ""))
        texts.append(
            f"Failed cases differ most in {row.key}: median {format_short(row.failed)}{unit}, "
            f"{format_short(row.good)}{unit} of the others."
        )
    for entry in summary.chosen[:1]:
        if isinstance(entry.indices, Indices) and len(keys) > 1:
            top = int(np.argmax(entry.indices.total))
            texts.append(
                f"{keys[top]} causes {100 * entry.indices.first[top]:.0f} % of the variance of "
                f"{entry.result.name} alone, {100 * entry.indices.total[top]:.0f} % together with other keys."
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
    endings = [(end.status, f"{end.count:,}", str(end.first), end.message) for end in summary.endings]
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
    yield _table("ffrrrrrr", columns, [_describe_spread(entry) for entry in summary.chosen], "results")
    yield from _causes(summary)
    worst = [(str(entry.case), _list_keys(entry.keys), entry.reason) for entry in summary.worst]
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
    """Yield a table of indices and correlations; reasons if there are no indices."""
    rows = []
    for entry in summary.chosen:
        indices = entry.indices if isinstance(entry.indices, Indices) else None
        for index, key in enumerate(summary.results.keys):
            shares_text = ("", "")
            if indices is not None:
                shares_text = (
                    f"{indices.first[index]:.3f} ± {indices.first_error[index]:.3f}",
                    f"{indices.total[index]:.3f} ± {indices.total_error[index]:.3f}",
                )
            rows.append((entry.result.name, key, *shares_text, f"{entry.correlation[index]:.2f}"))
    order = rank_rows(-np.concatenate([entry.strength for entry in summary.chosen]))
    heads = ("result", "key", "first order", "total", "rank\ncorrelation")
    yield _table("ffrrr", heads, rows, "pairs of result and key", "strongest", order)
    for reason in sorted({entry.indices for entry in summary.chosen if isinstance(entry.indices, str)}):
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
