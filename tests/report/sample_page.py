"""A small page with everything that a page can hold."""

from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram
from tensegrity_codegen.report.pages.page import (
    Chapter,
    Entry,
    Figure,
    Page,
    Paragraph,
    Remark,
    Section,
    diagram_figure,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, compare_cell, compare_cells, text_cell
from tensegrity_codegen.report.pages.picture import draw_picture

DIAGRAM = Diagram(
    "time [s]",
    "T_S [N]",
    [Series("T_S", [0, 1, 2], [1.0, 4.0, 2.0]), Series("b", [0, 2], [2, 3], "dashed", 1)],
)
HOSTILE = "<script>alert('x')</script> & \"quotes\""


def make_section(anchor: str, verdict: str = "agrees") -> Section:
    columns = (
        Column("what", numeric=False),
        Column("paper", "N"),
        Column("ours", "N"),
        Column("difference", "N"),
    )
    stacked = (Column("load", "N"), Column("spring", "mm"))
    raster = draw_picture(draw_diagram(DIAGRAM), f"{anchor}-raster", most_svg=0)
    stack = compare_cell(31.32, 32.04, ".2f")
    blocks = (
        Paragraph(f"Text with {HOSTILE}."),
        diagram_figure(f"{anchor}-lines", DIAGRAM, "A diagram.", "Two lines."),
        Figure(raster, "The same as a raster.", "Two lines again."),
        Table("Side by side.", columns, ((text_cell("tension"), *compare_cells(26.11, 26.1082, ".4f")),)),
        Table(
            "One above the other.",
            stacked,
            ((text_cell("-1"), stack),),
            "From above.",
        ),
        Remark("differs", "They differ by rounding.", ("entry-1",)),
    )
    return Section(anchor, "Table 1", "A section", verdict, "all is well at 10 N", blocks)  # type: ignore[arg-type]


def make_page(*anchors: str) -> Page:
    sections = tuple(make_section(anchor) for anchor in anchors or ("first", "second"))
    chapter = Chapter("paper", "P&Q", "a paper", "Somewhere, 2002.", sections)
    entry = Entry("entry-1", "P&Q 1: a slip", "Eq. (1)", "What is printed, and what holds.")
    return Page("A page", "What it is about.", (chapter,), "Errata", (entry,), ("A fact.",))
