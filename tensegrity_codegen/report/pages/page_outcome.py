"""The outcome of a page as a table for the terminal."""

from rich import box
from rich.table import Table
from rich.text import Text

from tensegrity_codegen.report.pages.page import Page


def outcome_table(page: Page) -> Table:
    """Return a table with a row for each section of the page: paper, place, title, verdict."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in ("paper", "there", "what", "result"):
        table.add_column(name, overflow="fold")
    for chapter in page.chapters:
        for section in chapter.sections:
            words = (chapter.name, section.source, section.title, section.outcome)
            table.add_row(*(Text(word) for word in words))
    return table
