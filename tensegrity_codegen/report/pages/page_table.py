"""Tables of a page: paper, ours and difference side by side or one above the other, numbers aligned."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tensegrity_codegen.report.long_table import rank_rows
from tensegrity_codegen.report.number_text import format_number

# Widths of a window [px] up to which a table may be told to scroll sideways.
HINT_WIDTHS = (640, 760, 900, 1050, 1250, 4000)
MARGINS = 64  # of the page, both sides together [px]
PHONE = 372  # place of a table in a window of 400 px [px]
LETTER, SMALL_LETTER = 8.6, 7.7  # mean width of a letter, wide and on a phone [px]
PADDING, SMALL_PADDING, MANY_PADDING = 24, 16, 14  # of a cell, both sides together [px]
MANY = 6  # columns above which cells have less padding
WORDS = 16  # letters of a line of words that is still easy to read


@dataclass(frozen=True)
class ColumnText:
    """The words of a column: of its heading, and of its cells, line by line."""

    numeric: bool
    heading: tuple[str, ...]
    cells: Sequence[str]


def choose_layout(columns: Sequence[ColumnText]) -> str:
    """Return the CSS classes of a table: "cards" if it is too wide for a phone, "hint-W" up to which width.

    A browser breaks words into lines before it lets a table become wider than its place, numbers not.
    """
    padding = MANY_PADDING if len(columns) > MANY else PADDING
    wide = sum(_count_letters(column, 0) for column in columns) * LETTER + padding * len(columns)
    small = sum(_count_letters(column, WORDS) for column in columns) * SMALL_LETTER
    names = []
    if small + SMALL_PADDING * len(columns) > PHONE:
        names.append("cards")
    if wide > PHONE:
        offset = wide + MARGINS
        names.append(f"hint-{next((w for w in HINT_WIDTHS[:-1] if offset <= w), HINT_WIDTHS[-1])}")
    return " ".join(["table", *names])


def _count_letters(column: ColumnText, limit: int) -> int:
    """Return the letters of the longest line of a column that is not broken; words are, from `least` on."""
    heads = [word for text in column.heading for word in text.split()]
    if column.numeric:
        return max(map(len, (*heads, *column.cells)), default=0)
    longest = max((min(len(text), limit) for text in column.cells), default=0)
    return max(longest, *map(len, (*heads, "")), *(len(w) for text in column.cells for w in text.split()))


MAX_ROWS = 14  # of a table that is shown as a whole
HEAD_ROWS = 8


@dataclass(frozen=True)
class Column:
    """A column: its heading, the unit below it, and whether it holds numbers (right-aligned)."""

    name: str
    unit: str = ""
    numeric: bool = True

    @property
    def heading(self) -> str:
        """Heading and unit on one line."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Cell:
    """One field: lines of (role, text) to show, and the value behind them for the data file.

    The roles are "" (plain), "paper", "ours" and "difference".
    """

    lines: tuple[tuple[str, str], ...]
    value: Any = None


@dataclass(frozen=True)
class Table:
    """A table with its caption; every row has a cell for every column; `note` says how to read it.

    Of more than MAX_ROWS rows those with the indices `head` are shown (the first HEAD_ROWS where it is
    empty), `head_note` says which they are ("the 5 largest errors"), and all rows are folded below.
    folded: text of the line that opens a table which is folded as a whole.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    kind: str = "table"
    head: tuple[int, ...] = ()
    head_note: str = ""
    folded: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.caption}: a row of {len(row)} cells, {len(self.columns)} columns")

    @property
    def filled(self) -> "Table":
        """The table without the columns that are empty in every row."""
        shown = [
            k
            for k in range(len(self.columns))
            if not self.rows or any(text not in ("", "–") for row in self.rows for _, text in row[k].lines)
        ]
        rows = tuple(tuple(row[k] for k in shown) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in shown), rows=rows)

    @property
    def is_long(self) -> bool:
        """Whether rows are folded."""
        return len(self.rows) > MAX_ROWS

    @property
    def head_rows(self) -> tuple[tuple[Cell, ...], ...]:
        """The rows of a long table that are always visible."""
        return tuple(self.rows[k] for k in self.head) if self.head else self.rows[:HEAD_ROWS]

    @property
    def head_text(self) -> str:
        """Which rows of a long table are visible, in words."""
        count = len(self.head_rows)
        if self.head_note:
            return self.head_note
        return f"the first {count}" if not self.head else f"{count} of {len(self.rows):,} rows"

    @property
    def row_count(self) -> str:
        """The number of rows, in words."""
        return f"{len(self.rows):,} row{'' if len(self.rows) == 1 else 's'}"

    @property
    def layout(self) -> str:
        """The CSS classes by which narrow screens lay it out."""
        columns = [
            ColumnText(
                column.numeric,
                (column.name, column.unit),
                [text for row in self.rows for _, text in row[k].lines],
            )
            for k, column in enumerate(self.columns)
        ]
        return choose_layout(columns)

    def as_dict(self) -> dict[str, Any]:
        """Return caption, columns and the values of the rows."""
        return {
            "kind": self.kind,
            "caption": self.caption,
            "columns": [{"name": column.name, "unit": column.unit} for column in self.columns],
            "rows": [[cell.value for cell in row] for row in self.rows],
        }


def find_largest(values: Any) -> tuple[int, ...]:
    """Return the rows that a long table has as its `head`: those with the largest values (n_rows,)."""
    return tuple(rank_rows(-values)[:HEAD_ROWS])


def text_cell(text: str) -> Cell:
    """Return a cell of words."""
    return Cell((("", text),), text)


def number_cell(value: float | None, spec: str, role: str = "") -> Cell:
    """Return a cell with a number in the format `spec`; None and NaN show as a dash."""
    stated = None if value is None or math.isnan(value) else value
    return Cell(((role, format_number(stated, spec)),), stated)


def compare_cell(paper: float | None, ours: float | None, spec: str) -> Cell:
    """Return one cell with three lines: paper, ours and ours minus paper."""
    difference = _difference(paper, ours)
    lines = (
        ("paper", format_number(paper, spec)),
        ("ours", format_number(ours, spec)),
        ("difference", format_number(difference, f"+{spec}")),
    )
    return Cell(lines, {"paper": paper, "ours": ours, "difference": difference})


def compare_cells(paper: float | None, ours: float | None, spec: str) -> tuple[Cell, Cell, Cell]:
    """Return three cells beside each other: paper, ours and ours minus paper."""
    return (
        number_cell(paper, spec, "paper"),
        number_cell(ours, spec, "ours"),
        number_cell(_difference(paper, ours), f"+{spec}", "difference"),
    )


def _difference(paper: float | None, ours: float | None) -> float | None:
    return None if paper is None or ours is None else ours - paper


def make_table(
    caption: str, columns: Mapping[str, str], rows: Iterable[Sequence[Any]], **options: Any
) -> Table:
    """Return a table of values.

    columns: heading with its unit ("error [m]") -> format of the column's numbers, "" for a column of words.
    rows: a value for each column: a number or None, words, or a Cell, which is taken as it is.
    **options: the other fields of Table: note, head, head_note, folded.
    """
    made = []
    for heading, spec in columns.items():
        name, _, unit = heading.partition(" [")
        made.append(Column(name, unit.removesuffix("]"), numeric=bool(spec)))
    specs = tuple(columns.values())
    cells = tuple(
        tuple(_make_cell(value, spec) for value, spec in zip(row, specs, strict=True)) for row in rows
    )
    return Table(caption, tuple(made), cells, **options)


def _make_cell(value: Any, spec: str) -> Cell:
    if isinstance(value, Cell):
        return value
    return text_cell(value) if isinstance(value, str) else number_cell(value, spec)
