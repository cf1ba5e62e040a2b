"""Rows as text: rich tables on the terminal, Markdown and CSV in files."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from harness.acceptance import Line
from harness.floor import Floor, from_throughput
from harness.growth import fit_exponent
from harness.session import Row

HEADINGS = (
    *("candidate", "from", "ns", "ns a member", "spread", "times", "error"),
    *("code [B]", "tables [B]", "compile [s]", "peak [MB]", "note"),
)
MB = 1e6


def number(value: float | None, digits: int = 3) -> str:
    """Return a number short: thousands grouped, `digits` significant ones below, "" for None."""
    if value is None:
        return ""
    if value == 0 or 1e-3 <= abs(value) < 10 ** (digits - 1):
        return f"{value:.{digits}g}"
    return f"{value:,.0f}" if abs(value) >= 1 else f"{value:.0e}"


def row_cells(row: Row) -> list[str]:
    """Return the cells of one row, in the order of HEADINGS."""
    peak = None if row.compile_peak is None else row.compile_peak / MB
    return [
        row.name,
        row.called,
        number(row.ns),
        number(row.ns_member),
        "" if row.spread is None else f"{100 * row.spread:.0f} %",
        number(row.times),
        "" if row.error is None else f"{row.error:.0e}",
        number(row.code_bytes),
        number(row.table_bytes),
        number(row.compile_seconds),
        number(peak),
        row.note,
    ]


def gather_untimed(rows: Iterable[Row]) -> list[Row]:
    """Return the rows, those without a time at the end, as one row for each reason."""
    listed = list(rows)
    reasons: dict[str, list[Row]] = {}
    for row in listed:
        if row.ns is None:
            reasons.setdefault(row.note, []).append(row)
    gathered = [replace(same[0], name=", ".join(row.name for row in same)) for same in reasons.values()]
    return [*(row for row in listed if row.ns is not None), *gathered]


def floor_cells(floor: Floor) -> list[list[str]]:
    """Return heading and rows: ns a lane of every operation, a column a width."""
    widths = sorted(floor.lanes)
    names = list(dict.fromkeys(name for width in widths for name in floor.lanes[width]))
    heading = ["ns a lane", *(f"{64 * width} bit" for width in widths)]
    rows = [[name, *(_digits(floor.lanes[width].get(name)) for width in widths)] for name in names]
    derived = {width: from_throughput(floor.lanes[width]) for width in widths}
    for way in dict.fromkeys(way for width in widths for way in derived[width]):
        rows.append([f"a member from throughputs, {way}", *(_digits(derived[w].get(way)) for w in widths)])
    return [heading, *rows]


def _digits(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def growth_cells(rows: Iterable[Row]) -> list[list[str]]:
    """Return heading and rows: exponents of time, code and compile seconds over the towers."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row.structure.startswith("tower") and row.ns:
            found.setdefault((row.quantity, row.name), []).append(row)
    heading = ["quantity", "candidate", "members", "time", "code", "compile"]
    return [heading, *(_growth(*key, group) for key, group in found.items() if len(group) > 2)]


def _growth(quantity: str, name: str, group: Sequence[Row]) -> list[str]:
    sizes = [row.members for row in group]
    cells = [quantity, name, f"{min(sizes)} to {max(sizes):,}"]
    for values in (
        [row.ns for row in group],
        [row.code_bytes for row in group],
        [row.compile_seconds for row in group],
    ):
        known = [(size, value) for size, value in zip(sizes, values, strict=True) if value]
        exponent = fit_exponent([s for s, _ in known], [v for _, v in known])
        cells.append("" if exponent is None else f"{exponent:.2f}")
    return cells


def acceptance_cells(lines: Iterable[Line]) -> list[list[str]]:
    """Return heading and rows: asked, measured, holds."""
    words = {True: "yes", False: "no", None: "not measured"}
    return [
        ["asked", "measured", "holds"],
        *([line.asked, line.measured, words[line.holds]] for line in lines),
    ]


def markdown_table(cells: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the first row is the heading, columns without any text are left out."""
    kept = [k for k in range(len(cells[0])) if any(row[k] for row in cells[1:])]
    lines = ["| " + " | ".join(row[k].replace("|", "/") for k in kept) + " |" for row in cells]
    return "\n".join([lines[0], "|---" * len(kept) + "|", *lines[1:]]) + "\n"


def csv_text(rows: Iterable[Mapping[str, object]]) -> str:
    """Return rows of equal keys as CSV."""
    listed, stream = list(rows), io.StringIO()
    writer = csv.DictWriter(stream, fieldnames=list(listed[0]) if listed else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(listed)
    return stream.getvalue()
