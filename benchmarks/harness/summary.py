"""A run on one screen: candidates down, structures across."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from harness.ensemble import MANY
from harness.session import Row
from harness.tables import number

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
