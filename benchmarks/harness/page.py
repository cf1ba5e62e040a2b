"""The page of a run: the comparison with other ways, times, sizes, rates, all rows, machine."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from harness.comparison import comparison_cells, describe_finding, describe_rows
from harness.ensemble import MANY
from harness.floor import Floor
from harness.pictures import Drawing, can_draw, draw_rates, draw_sizes, draw_times
from harness.session import Row
from harness.summary import large_cells, pivot_cells, rate_cells
from harness.tables import HEADINGS, floor_cells, gather_untimed, growth_cells, row_cells
from tensegrity_codegen.report.pages.page import Block, Chapter, Command, Figure, Page, Section
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.system.provenance import describe_provenance

Cells = Sequence[Sequence[str]]
LEAST = 2  # rows of each column that stay visible


def build_page(
    rows: Sequence[Row],
    machine: Mapping[str, str],
    floor: Floor | None,
    large: Mapping[int, Mapping[str, Any]],
    scripts: Mapping[str, str],
) -> Page:
    """Return the page; large: see large_scene.py; scripts: title -> what other scripts printed."""
    chapters = [
        Chapter("comparison", "Comparison", "ours and other ways", "", tuple(_comparison(rows, floor))),
        Chapter("sizes", "Code", "size and time to compile", "", (*_sizes(rows), *_largest(large))),
        Chapter(
            "rows", "All rows", "every function at every structure", "", (_all_rows(rows),) if rows else ()
        ),
        Chapter("machine", "Machine", "what a core can do at best", "", tuple(_machine(machine, floor))),
        Chapter("scripts", "Other scripts", "what they printed", "", tuple(_scripts(scripts))),
    ]
    return Page(
        title=describe_finding(rows),
        subject="Speed and size of generated functions",
        lead=describe_rows(rows),
        chapters=tuple(chapter for chapter in chapters if chapter.sections),
        facts=(*describe_provenance(), *(f"{name}: {value}." for name, value in machine.items() if value)),
        summary_heads=("part", "what", "result"),
    )


def table_of(caption: str, cells: Cells, head: Sequence[int] = (), head_note: str = "") -> Table:
    """Return cells as a table of the page: without empty columns, units apart, numbers aligned.

    head: rows of `cells` without its heading that stay visible where the table is long.
    """
    kept = [k for k in range(len(cells[0])) if any(row[k] for row in cells[1:])]
    columns = []
    for k in kept:
        name, _, unit = cells[0][k].partition(" [")
        texts = [row[k] for row in cells[1:] if row[k]]
        columns.append(
            Column(name, unit.rstrip("]"), numeric=all(text[0] in "-−0123456789" for text in texts))
        )
    rows = tuple(tuple(Cell((("", row[k]),), row[k]) for k in kept) for row in cells[1:])
    return Table(caption, tuple(columns), rows, head=tuple(head), head_note=head_note)


def _comparison(rows: Sequence[Row], floor: Floor | None) -> Iterator[Section]:
    cells = comparison_cells(rows)
    if len(cells) > 1:
        caption = "The fastest of ours and the fastest other way"
        table = table_of(caption, cells, _worst(cells), "the least ratios")
        yield Section("fastest", "all", "Every comparison", "plain", describe_finding(rows), (table,))
    single = [row for row in rows if MANY not in row.structure]
    for quantity in dict.fromkeys(row.quantity for row in single):
        caption = f"{quantity}: ns a member, by number of members"
        table = _pivot(caption, rows, quantity, lambda row: row.ns_member)
        if table is not None:
            figures = _figures(partial(draw_times, rows, quantity, floor))
            result = describe_finding([row for row in single if row.quantity == quantity])
            blocks = (*figures, table)
            yield Section(f"time-{quantity}", "one state", quantity, "plain", result, blocks)
    cells = rate_cells(rows)
    if len(cells) > 1:
        table = table_of("States a second and core", cells)
        figures = _figures(partial(draw_rates, rows))
        result = describe_finding([row for row in rows if MANY in row.structure])
        yield Section("rates", "many states", "States a second", "plain", result, (*figures, table))


def _worst(cells: Cells) -> list[int]:
    """Return the rows with the least ratios."""
    ratios = [float(row[-1].replace(",", "")) for row in cells[1:]]
    return sorted(range(len(ratios)), key=ratios.__getitem__)[:8]


def _sizes(rows: Sequence[Row]) -> Iterator[Section]:
    own = [row for row in rows if row.side == "ours" and MANY not in row.structure]
    figures = tuple(_figures(partial(draw_sizes, rows)))
    for quantity in dict.fromkeys(row.quantity for row in own):
        code = _pivot(
            f"{quantity}: bytes of instructions, tables aside", own, quantity, lambda row: row.code_bytes
        )
        compiling = _pivot(f"{quantity}: seconds to compile", own, quantity, lambda row: row.compile_seconds)
        tables = [table for table in (code, compiling) if table is not None]
        if tables:
            drawn = figures if quantity == "node_force" else ()
            yield _section(f"size-{quantity}", "code", quantity, tables[0], (*drawn, *tables))
    cells = growth_cells(rows)
    if len(cells) > 1:
        table = table_of("Exponents of growth with the number of members, over the towers", cells)
        yield _section("growth", "growth", "Growth with the number of members", table, (table,))


def _largest(large: Mapping[int, Mapping[str, Any]]) -> Iterator[Section]:
    cells = large_cells(large)
    if len(cells) > 1:
        table = table_of("Towers by `table`, read, generated, compiled and loaded", cells)
        yield _section("largest", "size", "From a scene to a loaded library", table, (table,))


def _pivot(
    caption: str, rows: Sequence[Row], quantity: str, value: Callable[[Row], float | None]
) -> Table | None:
    """Return a row a candidate, a column a structure; the least of each column stay visible."""
    cells = pivot_cells([row for row in rows if MANY not in row.structure], quantity, value)
    if len(cells) < 2:
        return None
    best = set()
    for k in range(1, len(cells[0])):
        known = [(float(row[k].replace(",", "")), n) for n, row in enumerate(cells[1:]) if row[k]]
        best.update(n for _, n in sorted(known)[:LEAST])
    return table_of(caption, cells, sorted(best), f"the {LEAST} least of each column")


def _all_rows(rows: Sequence[Row]) -> Section:
    """Return everything measured, a folded table a structure and quantity."""
    tables = []
    for structure, members, quantity in dict.fromkeys(
        (row.structure, row.members, row.quantity) for row in rows
    ):
        chosen = [row for row in rows if (row.structure, row.quantity) == (structure, quantity)]
        base = next((row.baseline for row in chosen if row.baseline), "")
        title = f"{structure}, {members:,} members: {quantity}"
        table = table_of(
            f"Times against {base}" if base else "Times",
            [HEADINGS, *(row_cells(row) for row in gather_untimed(chosen))],
        )
        tables.append(replace(table, folded=title))
    untimed = sum(row.ns is None for row in rows)
    result = f"{len(rows):,} functions and other ways, {untimed:,} of which were not timed"
    return Section("all-rows", "all", "Everything measured", "plain", result, tuple(tables))


def _machine(machine: Mapping[str, str], floor: Floor | None) -> Iterator[Section]:
    if floor is not None:
        table = table_of("Nanoseconds of one operation, a lane", floor_cells(floor))
        yield _section("floor", "core", "Floor of this core", table, (table,))
    if machine:
        table = table_of("Compilers and packages", [["what", "value"], *([k, v] for k, v in machine.items())])
        yield Section("versions", "machine", "Machine", "plain", machine.get("CPU", ""), (table,))


def _scripts(scripts: Mapping[str, str]) -> Iterator[Section]:
    for number, (title, text) in enumerate(scripts.items()):
        lines = text.strip().splitlines()
        failed = "failed; " if text.startswith("failed:") else ""
        result = f"{failed}{len(lines):,} lines"
        yield Section(
            f"script-{number}", "script", title, "plain", result, (Command(text.strip(), folded="Output"),)
        )


def _section(anchor: str, source: str, title: str, table: Table, blocks: Iterable[Block]) -> Section:
    return Section(anchor, source, title, "plain", table.row_count, tuple(blocks))


def _figures(draw: Callable[[], Iterable[Drawing]]) -> Iterator[Figure]:
    """Yield drawings as figures of the page, none without matplotlib."""
    if can_draw():
        for drawing in draw():
            picture = draw_picture(drawing.figure, drawing.name.replace("_", "-"))
            yield Figure(picture, f"{drawing.caption}.", drawing.caption)
