"""Certified errors of all cases as a diagram, one colour and marker a method."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from tensegrity_codegen.report.pages.diagram import Diagram
from tensegrity_codegen.report.pages.method_style import choose_styles, method_series
from tensegrity_codegen.report.pages.page import Figure, diagram_figure
from tensegrity_codegen.studies.stability.judge import ALLOWED
from tensegrity_codegen.studies.stability.outcome import Outcome
from tensegrity_codegen.system.errors import MissingExtraError
from tensegrity_codegen.system.extras import require_plot

LEAST = 1e-8  # errors over tolerance below are drawn here


def draw_errors(rows: Sequence[Outcome], scene: str, name: str) -> Iterator[Figure]:
    """Yield the diagram of outcomes that have an error; nothing where pictures cannot be drawn.

    Cases stand from left to right in the order in which they are made; `name` is unique on the page.
    """
    try:
        require_plot()
    except MissingExtraError:
        return
    cases = {case: k + 1 for k, case in enumerate(dict.fromkeys((row.group, row.case) for row in rows))}
    styles = choose_styles(dict.fromkeys(row.contender for row in rows))
    series = []
    for method, style in styles.items():
        own = [row for row in rows if row.contender == method]
        x = [cases[row.group, row.case] for row in own]
        y = [max(row.error or 0.0, LEAST) for row in own]
        series.append(replace(method_series(method, x, y, style), style="points"))
    diagram = Diagram(
        "number of the case",
        "error / tolerance",
        series,
        log_y=True,
        horizontal=((ALLOWED, "wrong above"),),
        legend_columns=5,
    )
    caption = (
        f"{scene}: certified errors of {len(rows)} results in {len(cases)} cases; below the dotted line a "
        f"result is right. Errors below {LEAST:g} are drawn there."
    )
    yield diagram_figure(name, diagram, caption, f"Error over tolerance of {len(rows)} results, logarithmic.")
