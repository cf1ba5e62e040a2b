"""Tables of a summary for the terminal."""

from collections.abc import Iterator

from rich import box
from rich.table import Table

from tensegrity_codegen.sweeps.summary.indices import Indices
from tensegrity_codegen.sweeps.summary.summary import SweepSummary


def list_tables(summary: SweepSummary) -> Iterator[Table | str]:
    """Yield endings, keys of failures, results, what these depend on, and worst cases."""
    table = _start("status", "cases", "first case", "its message")
    for ending in summary.endings:
        table.add_row(ending.status, f"{ending.count:,}", str(ending.first), ending.message)
    yield table
    if summary.failing:
        table = _start("key", "distance of failed cases", "median, failed", "median, good")
        for row in summary.failing:
            table.add_row(row.key, f"{row.distance:.2f}", f"{row.failed:.5g}", f"{row.good:.5g}")
        yield table
    if not summary.chosen:
        return
    table = _start("result", "unit", "least", "5 %", "median", "mean", "95 %", "largest")
    for item in summary.chosen:
        spread = item.distribution
        numbers = (
            spread.least, spread.percent_5, spread.median, spread.mean, spread.percent_95, spread.largest
        )  # fmt: skip
        table.add_row(item.result.name, item.result.unit, *(f"{value:.5g}" for value in numbers))
    yield table
    yield from _causes(summary)


def _causes(summary: SweepSummary) -> Iterator[Table | str]:
    """Yield a table of indices and correlations; reasons where there are no indices."""
    table = _start("result", "key", "first order", "total", "rank correlation")
    for item in summary.chosen:
        found = item.indices if isinstance(item.indices, Indices) else None
        for place, key in enumerate(summary.results.keys):
            words = ("", "")
            if found is not None:
                words = (
                    f"{found.first[place]:.3f} ± {found.first_error[place]:.3f}",
                    f"{found.total[place]:.3f} ± {found.total_error[place]:.3f}",
                )
            table.add_row(item.result.name, key, *words, f"{item.correlation[place]:.2f}")
    yield table
    for reason in sorted({item.indices for item in summary.chosen if isinstance(item.indices, str)}):
        yield f"no Sobol' indices: {reason}"


def _start(*names: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in names:
        table.add_column(name, overflow="fold")
    return table
