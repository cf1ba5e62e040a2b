"""The section of a summary's page on what results depend on: Sobol' indices, rank correlations."""

from collections.abc import Iterator, Sequence

import numpy as np

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page import Block, Paragraph, Section
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table, number_cell, text_cell
from tensegrity_codegen.sweeps.summary.figures import draw_indices
from tensegrity_codegen.sweeps.summary.indices import Indices
from tensegrity_codegen.sweeps.summary.summary import ResultSummary, SweepSummary


def build_causes(summary: SweepSummary) -> Iterator[Section]:
    """Return Sobol' indices where the cases allow them, and rank correlations."""
    shown = [item for item in summary.chosen if item.distribution.count and not item.is_constant]
    if not shown or not summary.results.keys:
        return
    figures: list[Block] = []
    reasons: dict[str, list[str]] = {}
    for number, item in enumerate(shown):
        if isinstance(item.indices, str):
            reasons.setdefault(item.indices, []).append(item.result.name)
        elif len(item.indices.keys) > 1:
            figures.append(draw_indices(item.result, item.indices, f"indices{number}"))
    missing = [Paragraph(f"No Sobol' indices of {', '.join(of)}: {why}.") for why, of in reasons.items()]
    found = len(figures)
    text = f"Sobol' indices of {found} result{'s' * (found > 1)}" if found else "rank correlations"
    blocks: list[Block] = [*figures, *missing, _strength_table(summary, shown, with_indices=bool(found))]
    yield Section("causes", "results", "What results depend on", "plain", text, tuple(blocks))


def _strength_table(summary: SweepSummary, shown: Sequence[ResultSummary], *, with_indices: bool) -> Table:
    """Return a table with a row for each result and key, the strongest key of each result first."""
    columns = [Column("result", numeric=False), Column("key", numeric=False), Column("rank correlation")]
    columns += [Column("first order"), Column("total")] if with_indices else []
    rows: list[tuple[Cell, ...]] = []
    sources: dict[str, None] = {}
    for item in shown:
        for place in np.argsort(-item.strength, kind="stable").tolist():
            cells = [
                text_cell(item.result.name), text_cell(summary.results.keys[place]),
                number_cell(float(item.correlation[place]), ".2f"),
            ]  # fmt: skip
            if with_indices:
                cells += _index_cells(item.indices, place)
            rows.append(tuple(cells))
        if with_indices and isinstance(item.indices, Indices):
            sources[item.indices.source] = None
    note = "Spearman's rank correlation: 1 rises, −1 falls with the key, near 0 does neither."
    if sources:
        note = f"Indices with 95 % intervals, from: {'; '.join(sources)}. {note}"
    return Table("Each result and key, the strongest first", tuple(columns), tuple(rows), note)


def _index_cells(indices: Indices | str, place: int) -> list[Cell]:
    """Return first-order and total index with their intervals; dashes where there are none."""
    if isinstance(indices, str):
        return [number_cell(None, ".3f")] * 2
    pairs = ((indices.first, indices.first_error), (indices.total, indices.total_error))
    return [_index_cell(float(value[place]), float(error[place])) for value, error in pairs]


def _index_cell(value: float, error: float) -> Cell:
    interval = f" ± {format_number(error, '.3f')}" if error > 0.0 else ""
    return Cell((("", format_number(value, ".3f") + interval),), {"value": value, "interval": error})
