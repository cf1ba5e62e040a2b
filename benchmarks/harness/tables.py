"""Rows as text: rich tables on the terminal, Markdown and CSV in files."""

import csv
import io
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.acceptance import Floor, Line, from_throughput
from harness.ensemble import MANY
from harness.session import Row

MEANINGFUL_POINTS = 3


def fit_exponent(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Return the slope of log(values) over log(sizes) by least squares, None for less than three points.

    Values must be positive. 1 is linear growth, 0 none.
    """
    if len(sizes) < MEANINGFUL_POINTS:
        return None
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


@dataclass(frozen=True)
class Comparison:
    """The fastest of ours and the fastest of the others."""

    own: Row
    peer: Row

    @property
    def ratio(self) -> float:
        """Time of the other way over ours."""
        return (self.peer.ns or 0.0) / (self.own.ns or 1.0)


def compare_rows(rows: Sequence[Row]) -> list[Comparison]:
    """Return a comparison for each structure and quantity that both sides were timed at.

    One state a call is compared with one state a call: batches count for many states alone. Our expression
    printed by CasADi counts as another way.
    """
    found = []
    timed = [row for row in rows if row.ns]
    for structure, quantity in dict.fromkeys((row.structure, row.quantity) for row in timed):
        chosen = [row for row in timed if (row.structure, row.quantity) == (structure, quantity)]
        own = [row for row in chosen if row.side == "ours" and (MANY in structure or "batch" not in row.name)]
        peers = [row for row in chosen if row.side != "ours"]
        if own and peers:
            found.append(Comparison(min(own, key=_time), min(peers, key=_time)))
    return found


def describe_finding(rows: Sequence[Row]) -> str:
    """Return in how many comparisons ours is the fastest, how many times at the median, and the worst."""
    compared = compare_rows(rows)
    ratios = [item.ratio for item in compared]
    if not ratios:
        timed = sum(row.ns is not None for row in rows)
        return f"{timed:,} functions timed, 0 comparisons with other ways"
    wins = sum(ratio > 1.0 for ratio in ratios)
    middle = f"{_factor(statistics.median(ratios))} times as fast as the fastest other at the median"
    worst = min(compared, key=lambda item: item.ratio)
    at = f"{worst.own.structure}, {worst.own.quantity}: {worst.peer.name}"
    return f"Fastest in {wins} of {len(ratios)} comparisons, {middle}, {_factor(worst.ratio)} at worst ({at})"


def describe_rows(rows: Sequence[Row]) -> str:
    """Return how much was measured, as sentences."""
    structures = {row.structure for row in rows}
    quantities = {row.quantity for row in rows}
    timed = [row for row in rows if row.ns is not None]
    own = sum(row.side == "ours" for row in timed)
    return (
        f"{len(timed):,} timings, {own:,} of generated functions and {len(timed) - own:,} of other ways: "
        f"{len(quantities)} quantities, {len(structures)} structures. Every result is compared with ours "
        "before it is timed; times are medians of processor time on one core."
    )


def comparison_cells(rows: Sequence[Row]) -> list[list[str]]:
    """Return heading and rows: the fastest of both sides, and their ratio."""
    heading = ["structure", "members", "quantity", "fastest of ours", "ours [ns a member]"]
    heading += ["fastest other way", "its time [ns a member]", "its time over ours"]
    return [
        heading,
        *(
            [
                item.own.structure,
                f"{item.own.members:,}",
                item.own.quantity,
                item.own.name,
                number(item.own.ns_member),
                item.peer.name,
                number(item.peer.ns_member),
                _factor(item.ratio),
            ]
            for item in compare_rows(rows)
        ),
    ]


def _time(row: Row) -> float:
    return row.ns or 0.0


def _factor(value: float) -> str:
    if value < 1.0:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{value:,.0f}"


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


Cells = list[list[str]]


def summary_sections(rows: Sequence[Row]) -> list[tuple[str, Cells]]:
    """Return title and cells: ns a member of each quantity, rates of many states, code, compile seconds."""
    single = [row for row in rows if MANY not in row.structure]
    own = [row for row in single if row.side == "ours"]
    found: list[tuple[str, Cells]] = []
    for quantity in dict.fromkeys(row.quantity for row in single):
        cells = pivot_cells(single, quantity, lambda row: row.ns_member)
        found.append((f"{quantity}: ns a member, by number of members", cells))
    found.append(("States a second and core", rate_cells(rows)))
    for quantity in dict.fromkeys(row.quantity for row in own):
        cells = pivot_cells(own, quantity, lambda row: row.code_bytes)
        found.append((f"{quantity}: bytes of instructions, tables aside", cells))
        cells = pivot_cells(own, quantity, lambda row: row.compile_seconds)
        found.append((f"{quantity}: seconds to compile", cells))
    return [(title, cells) for title, cells in found if len(cells) > 1]


def pivot_cells(rows: Sequence[Row], quantity: str, value: Callable[[Row], float | None]) -> Cells:
    """Return heading and rows of one quantity: a row a candidate that was timed, a column a structure."""
    chosen = [row for row in rows if row.quantity == quantity and row.ns is not None]
    sizes = sorted({(row.members, row.structure) for row in chosen})
    places = {(row.name, row.structure): number(value(row)) for row in chosen}
    names = dict.fromkeys(row.name for row in chosen)
    heading = [
        "candidate",
        *(f"{structure.rstrip('0123456789')} {members:,}" for members, structure in sizes),
    ]
    body = [[name, *(places.get((name, structure), "") for _, structure in sizes)] for name in names]
    return [heading, *(row for row in body if any(row[1:]))]


def rate_cells(rows: Sequence[Row]) -> Cells:
    """Return heading and rows: evaluations a second of many states, a column a quantity."""
    chosen = [row for row in rows if MANY in row.structure and row.ns]
    quantities = list(dict.fromkeys(row.quantity for row in chosen))
    places = {(row.name, row.quantity): number(1e9 / row.ns) for row in chosen if row.ns}
    names = dict.fromkeys(row.name for row in chosen)
    body = [[name, *(places.get((name, quantity), "") for quantity in quantities)] for name in names]
    return [["candidate", *quantities], *body]


def large_cells(large: Mapping[int, Mapping[str, Any]]) -> Cells:
    """Return heading and rows: what a scene takes from its file to a loaded library, or why it failed."""
    heading = ["members", "scene to loaded library [s]", "memory of all processes [GB]"]
    heading += ["instructions [B]", "tables [B]", "quantities"]
    rows = []
    for stages, found in sorted(large.items()):
        if "error" in found:
            rows.append([f"tower of {stages:,} stages", "", "", "", "", found["error"]])
            continue
        peak = found.get("peak")
        rows.append(
            [
                f"{found['members']:,}",
                f"{found['seconds']:.1f}",
                f"{peak / 1e9:.2f}" if peak else "",
                number(found["code_bytes"]),
                number(found["table_bytes"]),
                ", ".join(found["quantities"]),
            ]
        )
    return [heading, *rows]
