"""The section of a summary's page on what results depend on: Sobol' indices, rank correlations."""

from __future__ import annotations

from collections.abc import Iterator

from tensegrity_codegen.report.pages.page import Block, Paragraph, Section
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.sweeps.summary.figures import draw_indices
from tensegrity_codegen.sweeps.summary.indices import Indices
from tensegrity_codegen.sweeps.summary.summary import ResultSummary, SweepSummary

__all__ = ["build_causes"]


def build_causes(summary: SweepSummary) -> Iterator[Section]:
    """Return Sobol' indices where the cases allow them, and rank correlations."""
    if not summary.chosen or not summary.results.keys:
        return
    blocks: list[Block] = []
    tables: list[Block] = []
    for number, item in enumerate(summary.chosen):
        if isinstance(item.indices, Indices) and len(item.indices.keys) > 1:
            blocks.append(draw_indices(item.result, item.indices, f"indices{number}"))
            tables.append(_index_table(item, item.indices))
    reasons = {item.indices for item in summary.chosen if isinstance(item.indices, str)}
    tables += [Paragraph(f"No Sobol' indices: {reason}.") for reason in sorted(reasons)]
    tables.append(_correlation_table(summary))
    found = len(blocks)
    text = f"Sobol' indices of {found} result{'s' * (found > 1)}" if found else "rank correlations"
    yield Section("causes", "results", "What results depend on", "plain", text, (*blocks, *tables))


def _index_table(item: ResultSummary, indices: Indices) -> Table:
    columns = (
        Column("key", numeric=False), Column("first order"), Column("± 95 %"), Column("total"),
        Column("± 95 %"),
    )  # fmt: skip
    rows = tuple(
        (text_cell(key), *(number_cell(float(value), ".3f") for value in values))
        for key, *values in zip(
            indices.keys, indices.first, indices.first_error, indices.total, indices.total_error, strict=True
        )
    )
    return Table(f"Sobol' indices of {item.result.name}", columns, rows, f"From: {indices.source}.")


def _correlation_table(summary: SweepSummary) -> Table:
    columns = (
        Column("key", numeric=False),
        *(Column(item.result.name) for item in summary.chosen),
    )
    rows = tuple(
        (text_cell(key), *(number_cell(float(item.correlation[place]), ".2f") for item in summary.chosen))
        for place, key in enumerate(summary.results.keys)
    )
    note = "Spearman's rank correlation: 1 rises, -1 falls with the key, near 0 does neither."
    return Table("Rank correlations", columns, rows, note)
