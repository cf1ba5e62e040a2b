"""The page of a run: the comparison with other ways, times, sizes, rates, all rows, machine."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from harness.acceptance import Floor
from harness.ensemble import MANY
from harness.session import Row
from harness.tables import (
    HEADINGS,
    comparison_cells,
    describe_finding,
    describe_rows,
    floor_cells,
    gather_untimed,
    growth_cells,
    large_cells,
    pivot_cells,
    rate_cells,
    row_cells,
)
from tensegrity_codegen.report.pages.diagram import (
    TEXT_SIZE,
    Diagram,
    MethodStyle,
    choose_styles,
    draw_diagram,
    dress_axes,
    find_style,
    method_series,
)
from tensegrity_codegen.report.pages.page import Block, Chapter, Command, Figure, Page, Section
from tensegrity_codegen.report.pages.page_table import Cell, Column, Table
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.canvas import INK, new_figure
from tensegrity_codegen.system.provenance import describe_provenance

if TYPE_CHECKING:
    from matplotlib import figure as plots

Value = Callable[[Row], float | None]
WIDTH, HEIGHT = 5.4, 4.4  # in
BAR = 0.24  # height of a bar [in]


@dataclass(frozen=True)
class Drawing:
    """A figure with the name of its file and its caption."""

    name: str
    figure: "plots.Figure"
    caption: str


def can_draw() -> bool:
    """Return whether matplotlib is installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        return False
    return True


def draw_times(rows: Sequence[Row], quantity: str, floor: Floor | None) -> Iterator[Drawing]:
    """Yield the time a member of one quantity: of our functions, and of the fastest with the other ways."""
    chosen = [row for row in _drawn(rows) if row.quantity == quantity]
    own = [row for row in chosen if row.side == "ours"]
    others = [row for row in chosen if row.side != "ours"]
    marks: list[tuple[float, str]] = []
    if floor is not None and floor.member and quantity == "node_force":
        marks = [(min(floor.member.values()), "floor of this core")]
    if own:
        lines = _lines(own, lambda row: row.ns_member)
        yield Drawing(
            f"time_{quantity}", _over_members(lines, "ns a member", marks), f"{quantity}: our functions"
        )
    if others:
        fastest = {}
        for row in own:
            if "batch" not in row.name and row.ns_member is not None:
                fastest[row.members] = min(fastest.get(row.members, row.ns_member), row.ns_member)
        lines = {"ours, the fastest": sorted(fastest.items())} if fastest else {}
        lines |= _lines(others, lambda row: row.ns_member)
        text = f"{quantity}: the fastest of ours, one state a call, and other ways"
        yield Drawing(f"peers_{quantity}", _over_members(lines, "ns a member", marks), text)


def draw_sizes(rows: Sequence[Row]) -> Iterator[Drawing]:
    """Yield bytes of instructions and seconds to compile of the force."""
    force = [row for row in _drawn(rows) if row.quantity == "node_force" and row.code_bytes]
    for name, value, unit in (
        ("code_bytes", attrgetter("code_bytes"), "bytes of instructions"),
        ("compile_seconds", attrgetter("compile_seconds"), "s to compile"),
    ):
        if force:
            yield Drawing(name, _over_members(_lines(force, value), unit), f"node_force: {unit}")


def draw_rates(rows: Iterable[Row]) -> Iterator[Drawing]:
    """Yield evaluations a second of many states, a picture a quantity, the fastest on top."""
    listed = [row for row in rows if MANY in row.structure and row.ns]
    for quantity in dict.fromkeys(row.quantity for row in listed):
        chosen = sorted((row for row in listed if row.quantity == quantity), key=lambda row: -(row.ns or 0.0))
        figure = new_figure(WIDTH, 0.9 + BAR * len(chosen))
        axes = figure.add_subplot()
        colours = [find_style(row.name).light for row in chosen]
        axes.barh([row.name for row in chosen], [1e9 / (row.ns or 1.0) for row in chosen], color=colours)
        axes.set_xscale("log")
        dress_axes(axes, "states a second and core", "", log=(True, False))
        axes.set_yticks(range(len(chosen)), [row.name for row in chosen], fontsize=TEXT_SIZE - 1, color=INK)
        axes.grid(visible=False, axis="y")
        yield Drawing(f"rates_{quantity}", figure, f"{chosen[0].structure} states: {quantity}")


def style_candidates(names: Iterable[str]) -> dict[str, MethodStyle]:
    """Return the looks of candidates: the colour says what, dashes the compiler, dots a batch."""
    found = choose_styles(names)
    for name, style in found.items():
        if "batch" in name or "clang" in name:
            found[name] = replace(style, dash="dotted" if "batch" in name else "dashed")
    return found


def _drawn(rows: Iterable[Row]) -> list[Row]:
    """Return the rows worth a line: not reference flags, nor our expression compiled by another program."""
    return [
        row for row in rows
        if MANY not in row.structure and row.ns
        and "reference" not in row.name and "our expression" not in row.name
    ]  # fmt: skip


def _lines(rows: Sequence[Row], value: Value) -> dict[str, list[tuple[int, float]]]:
    lines: dict[str, list[tuple[int, float]]] = {}
    for row in rows:
        known = value(row)
        if known is not None:
            lines.setdefault(row.name, []).append((row.members, known))
    return {name: sorted(points) for name, points in lines.items()}


def _over_members(
    lines: Mapping[str, Sequence[tuple[int, float]]], unit: str, marks: Sequence[tuple[float, str]] = ()
) -> "plots.Figure":
    """Return one line a candidate over the number of members, both axes logarithmic."""
    styles = style_candidates(lines)
    series = [
        method_series(name, [x for x, _ in points], [y for _, y in points], styles[name])
        for name, points in lines.items()
    ]
    diagram = Diagram(
        "members", unit, series, log_x=True, log_y=True, horizontal=marks, legend_columns=2
    )  # fmt: skip
    return draw_diagram(diagram, width=WIDTH, height=HEIGHT)


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
        yield Section("fastest", "", "Every comparison", "plain", describe_finding(rows), (table,))
    single = [row for row in rows if MANY not in row.structure]
    for quantity in dict.fromkeys(row.quantity for row in single):
        caption = f"{quantity}: ns a member, by number of members"
        table = _pivot(caption, rows, quantity, lambda row: row.ns_member)
        if table is not None:
            figures = _figures(partial(draw_times, rows, quantity, floor))
            result = describe_finding([row for row in single if row.quantity == quantity])
            blocks = (*figures, table)
            yield Section(f"time-{quantity}", "", quantity, "plain", result, blocks)
    cells = rate_cells(rows)
    if len(cells) > 1:
        table = table_of("States a second and core", cells)
        figures = _figures(partial(draw_rates, rows))
        result = describe_finding([row for row in rows if MANY in row.structure])
        yield Section("rates", "", "States a second", "plain", result, (*figures, table))


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
            yield _section(f"size-{quantity}", quantity, tables[0], (*drawn, *tables))
    cells = growth_cells(rows)
    if len(cells) > 1:
        table = table_of("Exponents of growth with the number of members, over the towers", cells)
        yield _section("growth", "Growth with the number of members", table, (table,))


def _largest(large: Mapping[int, Mapping[str, Any]]) -> Iterator[Section]:
    cells = large_cells(large)
    if len(cells) > 1:
        table = table_of("Towers by `table`, read, generated, compiled and loaded", cells)
        yield _section("largest", "From a scene to a loaded library", table, (table,))


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
    return Section("all-rows", "", "Everything measured", "plain", result, tuple(tables))


def _machine(machine: Mapping[str, str], floor: Floor | None) -> Iterator[Section]:
    if floor is not None:
        table = table_of("Nanoseconds of one operation, a lane", floor_cells(floor))
        yield _section("floor", "Floor of this core", table, (table,))
    if machine:
        table = table_of("Compilers and packages", [["what", "value"], *([k, v] for k, v in machine.items())])
        yield Section("versions", "", "Machine", "plain", machine.get("run", ""), (table,))


def _scripts(scripts: Mapping[str, str]) -> Iterator[Section]:
    for number, (title, text) in enumerate(scripts.items()):
        lines = text.strip().splitlines()
        failed = "failed; " if text.startswith("failed:") else ""
        result = f"{failed}{len(lines):,} lines"
        yield Section(
            f"script-{number}", "", title, "plain", result, (Command(text.strip(), folded="Output"),)
        )


def _section(anchor: str, title: str, table: Table, blocks: Iterable[Block]) -> Section:
    return Section(anchor, "", title, "plain", table.row_count, tuple(blocks))


def _figures(draw: Callable[[], Iterable[Drawing]]) -> Iterator[Figure]:
    """Yield drawings as figures of the page, none without matplotlib."""
    if can_draw():
        for drawing in draw():
            picture = draw_picture(drawing.figure, drawing.name.replace("_", "-"))
            yield Figure(picture, f"{drawing.caption}.", drawing.caption)
