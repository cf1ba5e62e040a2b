"""Bars beside each other for the rows of a table in a page."""

from html import escape

# Colours of the columns, from the first; a column beyond them is grey.
CLASSES = 5


def write_bars(words: str, following: str, page: str) -> str:
    """Return a chart of the first table of `following` in HTML, one line a row of the table.

    words: the columns that name a line, a colon, the columns of which each is a part of its bar. Rows without
    numbers there have no line.
    """
    names, _, parts = words.partition(": ")
    heads, rows = _read_table(following)
    wanted = [*names.split(", "), *parts.split(", ")]
    unknown = [name for name in wanted if name not in heads]
    if unknown:
        raise ValueError(f"{page}: the table has no column {', '.join(unknown)}; it has {', '.join(heads)}")
    shown = parts.split(", ")
    rows = [row for row in rows if all(_is_number(row[heads.index(name)]) for name in shown)]
    labels = [" ".join(row[heads.index(name)] for name in names.split(", ")) for row in rows]
    values = [[float(row[heads.index(name)].replace(",", "")) for name in shown] for row in rows]
    most = max(map(sum, values))
    lines = [_write_line(label, row, shown, most) for label, row in zip(labels, values, strict=True)]
    keys = [f'<span class="part part-{k}"></span>{escape(name)}' for k, name in enumerate(shown)]
    legend = f'<p class="keys">{" ".join(keys)}</p>'
    return (
        f'<div class="bars" role="img" aria-label="the table below as bars">{legend}{"".join(lines)}</div>\n'
    )


def _is_number(text: str) -> bool:
    return text.replace(",", "").replace(".", "", 1).isdigit()


def _write_line(label: str, row: list[float], shown: list[str], most: float) -> str:
    parts = "".join(
        f'<span class="part part-{min(k, CLASSES)}" style="width:{100 * value / most:.2f}%" '
        f'title="{escape(shown[k])}: {value:g}"></span>'
        for k, value in enumerate(row)
        if value
    )
    number = f"{row[0]:g}" if len(row) == 1 else ""
    return f'<div class="line"><span class="name">{escape(label)}</span><span>{parts}{number}</span></div>'


def _read_table(text: str) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the first Markdown table in the text."""
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith("|"):
            lines.append(line)
        elif lines:
            break
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return (cells[0], cells[2:]) if cells else ([], [])
