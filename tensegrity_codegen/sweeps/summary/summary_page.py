"""The summary of a sweep as a page: outcome, what varied, results, what they follow from, worst cases."""

from collections.abc import Iterator, Sequence

import numpy as np

from tensegrity_codegen.analyses.cases.registry import ANALYSES
from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Command,
    Figure,
    Page,
    Paragraph,
    Remark,
    Section,
    command_section,
)
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.sweeps.summary.figures import (
    draw_curve,
    draw_failures,
    draw_heat_map,
    draw_histogram,
    draw_indices,
    draw_scatter,
)
from tensegrity_codegen.sweeps.summary.finding import describe_finding, describe_lead
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.sweeps.summary.statistics import Indices, describe_distribution, is_difference_clear
from tensegrity_codegen.sweeps.summary.summary import ResultSummary, SweepSummary
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

MOST_KEYS = 2  # over which each result is drawn, unless keys are chosen
METHODS = {
    "grid": "all points of a grid",
    "random": "a random sample",
    "latin_hypercube": "a Latin hypercube sample",
    "sobol": "a sample by a scrambled Sobol' sequence",
    "saltelli": "a sample for Sobol' indices (Saltelli)",
    "table": "the rows of a table",
}


def build_summary_page(summary: SweepSummary, command: str) -> Page:
    """Return the page of a summary; command: the command line that makes the page."""
    results = summary.results
    sections = (
        _outcome(summary),
        *_failures(summary),
        *_over_keys(summary),
        *_distributions(summary),
        _varied(summary),
        *build_causes(summary),
        *_worst(summary),
        command_section(command),
    )
    method = METHODS.get(results.method, results.method)
    count = f"{describe_count(results.count, 'case')}, {describe_count(len(results.keys), 'key')}, {method}."
    return Page(
        subject=f"Sweep of {results.scene}",
        title=describe_finding(summary),
        lead=describe_lead(summary),
        chapters=(Chapter("sweep", results.scene, "", count, sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Words and equations: docs/sweep.md."),
    )


def _outcome(summary: SweepSummary) -> Section:
    columns = (
        Column("status", numeric=False), Column("cases"), Column("share", "%"), Column("first case"),
        Column("its message", numeric=False),
    )  # fmt: skip
    total = max(summary.results.count, 1)
    rows = tuple(
        (
            text_cell(ending.status.replace("_", " ")), number_cell(ending.count, ",.0f"),
            number_cell(100 * ending.count / total, ".2f"), number_cell(ending.first, ".0f"),
            text_cell("; ".join(line.strip() for line in ending.message.splitlines() if line.strip())),
        )
        for ending in summary.endings
    )  # fmt: skip
    note = "Cases are numbered from 0; the message is that of the first case with this status."
    blocks: list[Block] = [Table("How cases ended", columns, rows, note)]
    n_pending = int((~summary.results.is_computed).sum())
    if n_pending:
        blocks.append(
            Remark(
                "differs",
                f"{n_pending:,} cases are not computed yet: the same command of sweep goes on with them.",
            )
        )
    return Section("outcome", "", "Outcome", "plain", "", tuple(blocks))


def _failures(summary: SweepSummary) -> Iterator[Section]:
    """Return the section of failures; nothing if none failed, or all."""
    rows = summary.failing
    if not rows:
        return
    keys = summary.results.keys
    clear = [row for row in rows if is_difference_clear(summary.results, row)]
    columns = (
        Column("key", numeric=False), Column("distance", "0 to 1"), Column("median, failed"),
        Column("median, good"),
    )  # fmt: skip
    cells = tuple(
        (text_cell(row.key), number_cell(row.distance, ".2f"), number_cell(row.failed, ".4g"),
         number_cell(row.good, ".4g"))
        for row in rows
    )  # fmt: skip
    note = (
        "Distance: largest difference of the distribution functions of failed and good cases; "
        "0: failures do not depend on this key alone."
    )
    table = Table("Keys of failed and good cases", columns, cells, note)
    blocks: list[Block] = [table]
    finding = "no key alone tells failed cases from good ones, by more than chance"
    if clear:
        key_indices = [keys.index(row.key) for row in clear[:2]]
        blocks.insert(0, draw_failures(summary.results, key_indices, "failures"))
        finding = f"failed and good cases differ most in {clear[0].key}"
    yield Section("failures", "", "Where cases fail", "plain", finding, tuple(blocks))


def _varied(summary: SweepSummary) -> Section:
    results = summary.results
    columns = (
        Column("key", numeric=False), Column("unit", numeric=False), Column("how", numeric=False),
        Column("different values"), Column("least"), Column("median"), Column("largest"),
    )  # fmt: skip
    rows = []
    for index, key in enumerate(results.keys):
        values = results.key_values[:, index]
        spread = describe_distribution(values)
        how = results.ranges.get(key, "")
        rows.append(
            (
                text_cell(key), text_cell(results.key_units.get(key, "")), text_cell(how),
                number_cell(len(np.unique(values)), ",.0f"),
                number_cell(spread.least, ".5g"), number_cell(spread.median, ".5g"),
                number_cell(spread.largest, ".5g"),
            )
        )  # fmt: skip
    seed = "" if results.seed is None else f", seed {results.seed}"
    method = METHODS.get(results.method, results.method)
    finding = f"{describe_count(len(results.keys), 'key')}: {method}{seed}"
    blocks: list[Block] = [Table("Keys", columns, tuple(rows))] if rows else []
    options = " ".join(_list_options(results))
    if options:
        blocks.append(Paragraph(f"Options of {results.operation} that are no defaults: {options}"))
    return Section("varied", "", "What varied", "plain", finding, tuple(blocks))


def _list_options(results: SweepResults) -> Iterator[str]:
    """Yield the options of a sweep that differ from their defaults, as words of its command line."""
    kind = ANALYSES.get(results.operation)
    for option in () if kind is None else kind.list_sweep_options():
        value = results.options.get(option.name, option.default)
        if value in (None, "", option.default):
            continue
        label = f"--{option.argument.replace('_', '-')}"
        yield label if option.flag is not None else f"{label} {value}"


def _distributions(summary: SweepSummary) -> Iterator[Section]:
    if not summary.chosen:
        return
    columns = (
        Column("result", numeric=False), Column("unit", numeric=False), Column("cases"), Column("least"),
        Column("5 %"), Column("median"), Column("mean"), Column("95 %"), Column("largest"),
        Column("deviation"),
    )  # fmt: skip
    rows, figures = [], []
    meanings: dict[str, list[str]] = {}  # results by what they are
    for number, entry in enumerate(summary.chosen):
        spread = entry.distribution
        numbers = (
            spread.least, spread.percent_5, spread.median, spread.mean, spread.percent_95, spread.largest,
            spread.deviation,
        )  # fmt: skip
        rows.append(
            (text_cell(entry.result.name), text_cell(entry.result.unit), number_cell(spread.count, ",.0f"),
             *(number_cell(value, ".4g") for value in numbers))
        )  # fmt: skip
        if spread.count and not entry.is_constant and not _is_curve(summary):
            figures.append(draw_histogram(entry.result, f"histogram{number}"))
        meanings.setdefault(entry.result.sentence.rstrip("."), []).append(entry.result.name)
    sentences = [f"{', '.join(names)}: {meaning}." for meaning, names in meanings.items()]
    table = Table("Results", columns, tuple(rows), "Over cases that have the result. " + " ".join(sentences))
    yield Section("results", "", "Distributions", "plain", "", (*figures, table))


def _over_keys(summary: SweepSummary) -> Iterator[Section]:
    """Return results over keys: heat maps of grids, curves, scatter plots."""
    figures = [
        figure
        for number, entry in enumerate(summary.chosen)
        if entry.distribution.count and not entry.is_constant
        for figure in _draw_over(summary, entry, number)
    ]
    if figures:
        finding = "over the chosen keys" if summary.over else "over the keys that matter most"
        yield Section("keys", "", "Results over keys", "plain", finding, tuple(figures))


def _draw_over(summary: SweepSummary, item: ResultSummary, number: int) -> Iterator[Figure]:
    results = summary.results
    order = summary.over or _order_keys(summary, item)
    axes = [index for index in order if results.keys[index] in dict(results.axes)]
    name = f"over{number}-"
    if _is_curve(summary) and axes:
        yield draw_curve(results, axes[0], item.result, f"{name}0")
        return
    if len(axes) >= 2:
        x_key, y_key = axes[:2]
        yield draw_heat_map(results, (x_key, y_key), item.result, f"{name}map")
        mapped = (x_key, y_key) if summary.over else axes
        remaining = [index for index in order if index not in mapped]
    else:
        remaining = list(order)
    for index in remaining if summary.over else remaining[:MOST_KEYS]:
        yield draw_scatter(results, index, item.result, f"{name}{index}")


def _is_curve(summary: SweepSummary) -> bool:
    """Return whether one key varies along a grid: results are curves, and their distributions say nothing."""
    return len(summary.results.keys) == 1 and bool(summary.results.axes)


def _order_keys(summary: SweepSummary, item: ResultSummary) -> tuple[int, ...]:
    """Return the places of the keys that vary, the strongest first."""
    results = summary.results
    varying = [index for index in range(len(results.keys)) if np.ptp(results.key_values[:, index]) > 0.0]
    return tuple(sorted(varying, key=lambda index: -float(item.strength[index])))


def _worst(summary: SweepSummary) -> Iterator[Section]:
    if not summary.worst:
        return
    columns = (
        Column("case"), Column("why", numeric=False), Column("values of the keys", numeric=False),
    )  # fmt: skip
    rows = tuple(
        (
            number_cell(case.case, ".0f"), text_cell(case.reason),
            text_cell(", ".join(f"{key} = {value:.9g}" for key, value in case.keys.items())),
        )
        for case in summary.worst
    )  # fmt: skip
    kind = ANALYSES.get(summary.results.operation)
    origin = (
        ", from the scene as it was, to which the controller belongs" if kind and kind.needs_scene else ""
    )
    blocks: list[Block] = [
        Table("Failed cases, and cases with extreme results", columns, rows),
        Paragraph(
            f"Of each case, the first command writes the scene; the second runs the case alone{origin}:"
        ),
        *(Command("\n".join(case.commands)) for case in summary.worst),
    ]
    finding = f"{describe_count(len(rows), 'case')}, each with the commands that run it alone"
    yield Section("worst", "", "Worst cases", "plain", finding, tuple(blocks))


def build_causes(summary: SweepSummary) -> Iterator[Section]:
    """Return Sobol' indices, if the cases allow them, and rank correlations."""
    shown = [entry for entry in summary.chosen if entry.distribution.count and not entry.is_constant]
    if not shown or not summary.results.keys:
        return
    figures: list[Block] = []
    reasons: dict[str, list[str]] = {}
    for number, entry in enumerate(shown):
        if isinstance(entry.indices, str):
            reasons.setdefault(entry.indices, []).append(entry.result.name)
        elif len(entry.indices.keys) > 1:
            figures.append(draw_indices(entry.result, entry.indices, f"indices{number}"))
    missing = [Paragraph(f"No Sobol' indices of {', '.join(of)}: {why}.") for why, of in reasons.items()]
    count = len(figures)
    finding = f"Sobol' indices of {count} result{'s' * (count > 1)}" if count else "rank correlations"
    blocks: list[Block] = [*figures, *missing, _strength_table(summary, shown, with_indices=bool(count))]
    yield Section("causes", "", "What results depend on", "plain", finding, tuple(blocks))


def _strength_table(summary: SweepSummary, shown: Sequence[ResultSummary], *, with_indices: bool) -> Table:
    """Return a table with a row for each result and key, the strongest key of each result first."""
    columns = [Column("result", numeric=False), Column("key", numeric=False), Column("rank correlation")]
    columns += [Column("first order"), Column("total")] if with_indices else []
    rows: list[tuple[Cell, ...]] = []
    sources: dict[str, None] = {}
    for entry in shown:
        for index in np.argsort(-entry.strength, kind="stable").tolist():
            cells = [
                text_cell(entry.result.name), text_cell(summary.results.keys[index]),
                number_cell(float(entry.correlation[index]), ".2f"),
            ]  # fmt: skip
            if with_indices:
                cells += _index_cells(entry.indices, index)
            rows.append(tuple(cells))
        if with_indices and isinstance(entry.indices, Indices):
            sources[entry.indices.source] = None
    note = "Spearman's rank correlation: 1 rises, −1 falls with the key, near 0 does neither."
    if sources:
        note = f"Indices with 95 % intervals, from: {'; '.join(sources)}. {note}"
    return Table("Each result and key, the strongest first", tuple(columns), tuple(rows), note)


def _index_cells(indices: Indices | str, key_index: int) -> list[Cell]:
    """Return first-order and total index with their intervals; dashes without any."""
    if isinstance(indices, str):
        return [number_cell(None, ".3f")] * 2
    pairs = ((indices.first, indices.first_error), (indices.total, indices.total_error))
    return [_index_cell(float(value[key_index]), float(error[key_index])) for value, error in pairs]


def _index_cell(value: float, error: float) -> Cell:
    interval = f" ± {format_number(error, '.3f')}" if error > 0.0 else ""
    return Cell((("", format_number(value, ".3f") + interval),), {"value": value, "interval": error})
