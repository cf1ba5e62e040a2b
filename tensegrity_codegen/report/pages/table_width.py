"""How wide a table becomes, estimated from its words: what a phone shows as cards, where a hint is needed."""

from collections.abc import Sequence
from dataclasses import dataclass

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
        place = wide + MARGINS
        names.append(f"hint-{next((w for w in HINT_WIDTHS[:-1] if place <= w), HINT_WIDTHS[-1])}")
    return " ".join(["table", *names])


def _count_letters(column: ColumnText, least: int) -> int:
    """Return the letters of the longest line of a column that is not broken; words are, from `least` on."""
    heads = [word for text in column.heading for word in text.split()]
    if column.numeric:
        return max(map(len, (*heads, *column.cells)), default=0)
    longest = max((min(len(text), least) for text in column.cells), default=0)
    return max(longest, *map(len, (*heads, "")), *(len(w) for text in column.cells for w in text.split()))
