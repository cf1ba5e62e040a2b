"""Tables for the terminal whose rows are as many as a structure has nodes, members or modes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

# Reasons why rows matter, each with the rows' numbers, the most important first.
Ranking = tuple[tuple[str, Sequence[int]], ...]

MAX_WHOLE = 30  # rows of all tables of a result, up to which all are printed if they fit
MAX_TOGETHER = 20  # rows of all tables, if there are more
MAX_ROWS = 10  # of one table then; a table with a fifth more is printed whole
MIN_FOLDED = 8  # characters of a line of text that folds
AROUND = 7  # lines of a table besides its rows
SIDES = {"f": "left", "l": "left", "r": "right"}


@dataclass(frozen=True)
class LongTable:
    """A table whose rows are made when they are printed: all, or those that matter most.

    title: stands above it; may be empty.
    heads: headings of the columns.
    sides: a letter for each column: "f" text that may fold into several lines, "l" text and "r" numbers that
        stay on one line.
    count: number of rows.
    row: returns the texts of the row of a number, from 0 on.
    things: the word for the rows, such as "members".
    ranking: why rows matter, and their numbers, the most important first.
    caption: stands below it; may be empty.
    short: printed in its place if it is cut.
    """

    title: str
    heads: tuple[str, ...]
    sides: str
    count: int
    row: Callable[[int], Sequence[str]]
    things: str
    ranking: Ranking
    caption: str = ""
    short: "LongTable | None" = None

    def pick(self, limit: int) -> list[int]:
        """Return the numbers of at most `most` rows: the first of each reason in turn, reason by reason."""
        picked: dict[int, int] = {}
        for indices in zip_longest(*(order[:limit] for _, order in self.ranking)):
            for reason, index in enumerate(indices):
                if index is not None and len(picked) < limit:
                    picked.setdefault(index, reason)
        return sorted(picked, key=lambda index: picked[index])

    def describe_cut(self, limit: int) -> str:
        """Return the title, how many rows are shown and why these, and how many are not."""
        shown = len(self.pick(limit))
        why = ", ".join(reason for reason, order in self.ranking if len(order))
        cut = f"{shown} of {self.count:,} {self.things} ({why}), {self.count - shown:,} more"
        return f"{self.title}; {cut}" if self.title else cut

    def fits(self, width: int) -> bool:
        """Return whether all that stays on one line fits into so many characters beside text that folds."""
        texts = [self.heads, *map(self.row, range(self.count))]
        lengths = [
            max(len(line) for text in column for line in text.split("\n"))
            for column in zip(*texts, strict=True)
        ]
        selected = [
            min(n, MIN_FOLDED) if side == "f" else n for side, n in zip(self.sides, lengths, strict=True)
        ]
        return sum(selected) + 2 * len(selected) <= width

    def __rich__(self) -> "Table":
        from rich.text import Text

        table = new_table(self.title)
        for head, side in zip(self.heads, self.sides, strict=True):
            justify: Any = SIDES[side]
            folds = side == "f"
            table.add_column(
                Text(head), justify=justify, no_wrap=not folds, overflow="fold" if folds else "ellipsis"
            )
        for index in range(self.count):
            add_row(table, *self.row(index))
        if self.caption:
            table.caption, table.caption_justify = Text(self.caption), "left"
        return table

    def write(self, rows: Sequence[int], title: str) -> str:
        """Return rows as text in columns, a line each, which takes far less time than to draw them."""
        upward = zip_longest(*(head.split("\n")[::-1] for head in self.heads), fillvalue="")
        heads, texts = [*upward][::-1], [*map(self.row, rows)]
        widths = [max(map(len, column)) for column in zip(*heads, *texts, strict=True)]
        columns = zip(self.sides, widths, strict=True)
        form = "  ".join(f"{{:{'>' if side == 'r' else '<'}{width}}}" for side, width in columns)
        rule = "-" * (sum(widths) + 2 * len(widths) - 2)
        lines = [title, *(form.format(*row) for row in heads), rule, *(form.format(*row) for row in texts)]
        return "\n".join(line.rstrip() for line in [*lines, self.caption] if line) + "\n\n"


def find_most_rows(counts: Sequence[int], lines: int = 55) -> int:
    """Return how many rows tables of these many rows may have to fit into `lines`, ten at most if not all.

    >>> find_most_rows([6, 12]), find_most_rows([4000, 9384]), find_most_rows([30, 30, 30])
    (12, 10, 6)
    """
    room = lines - AROUND * len(counts)
    if sum(counts) <= min(room, MAX_WHOLE):
        return max(counts, default=0)
    room = min(room, MAX_TOGETHER)
    fitting = (
        limit for limit in range(MAX_ROWS, 1, -1) if sum(min(count, limit) for count in counts) <= room
    )
    return next(fitting, 1)


def rank_rows(values: Any) -> list[int]:
    """Return the numbers of rows in the order of their values, the smallest first, NaN last."""
    import numpy as np  # which --help does without

    order: list[int] = np.argsort(values, kind="stable").tolist()
    return order


def is_cut(count: int, limit: int) -> bool:
    """Return whether a table of so many rows is cut to `most`: a fifth more fits as well."""
    return count > limit + limit // 5


def new_table(title: str, *texts: str, **columns: str) -> "Table":
    """Return an empty table with text columns, then columns by name -> alignment."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title) if title else None,
        box=box.SIMPLE_HEAD,
        title_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )
    for name in texts:
        table.add_column(Text(name.replace("_", " ")), overflow="fold")
    for name, side in columns.items():
        justify: Any = side
        table.add_column(Text(name.replace("_", " ")), justify=justify, no_wrap=True)
    return table


def add_row(table: "Table", *cells: str) -> None:
    """Add a row of plain texts, in which square brackets mean themselves."""
    from rich.text import Text

    table.add_row(*(Text(cell) for cell in cells))
