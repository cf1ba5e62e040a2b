"""The heading of a picture: a title and a line of facts, left-aligned above the panels."""

import textwrap
from typing import TYPE_CHECKING

from tensegrity_codegen.report.pictures.palette import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text


# Inches: left margin, base lines below the upper edge, and the height of all.
LEFT, TITLE_LINE, FACTS_LINE, HEIGHT = 0.22, 0.32, 0.55, 0.66
TITLE_SIZE, FACTS_SIZE = 13.0, 9.0
# Characters of a bold title or of the facts that fit into an inch, on the safe side.
TITLE_LETTERS, FACTS_LETTERS = 7.5, 13.0


def add_heading(figure: "Figure", title: str, facts: str) -> None:
    """Write `title` and below it `facts`, cut to the width of the figure, and keep the panels below them."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    width, height = figure.get_size_inches()
    rows = (
        (title, TITLE_LINE, TITLE_SIZE, TITLE_LETTERS, "bold", INK),
        (facts, FACTS_LINE, FACTS_SIZE, FACTS_LETTERS, "normal", MUTED),
    )
    for text, line, size, letters, weight, color in rows:
        short = textwrap.shorten(text, width=int((width - 2 * LEFT) * letters), placeholder=" …")
        row = figure.text(
            LEFT / width, 1 - line / height, short, fontsize=size, fontweight=weight, color=color,
            va="baseline",
        )  # fmt: skip
        row.set_parse_math(False)
        row.set_in_layout(False)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, 0.0, 1.0, 1 - HEIGHT / height))


def add_clock(figure: "Figure") -> "Text":
    """Return an empty text at the right end of the title line."""
    width, height = figure.get_size_inches()
    clock = figure.text(
        1 - LEFT / width, 1 - TITLE_LINE / height, "", ha="right", va="baseline", fontsize=11, color=INK
    )
    clock.set_in_layout(False)
    return clock
