"""Pictures of a run: time a member over size, code and compile time over size, rates of many states."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from harness.ensemble import MANY
from harness.floor import Floor
from harness.session import Row
from tensegrity_codegen.report.pages.diagram import TEXT_SIZE, Diagram, draw_diagram, dress_axes
from tensegrity_codegen.report.pages.method_style import (
    MethodStyle,
    choose_styles,
    find_style,
    method_series,
)
from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.palette import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Value = Callable[[Row], float | None]
WIDTH, HEIGHT = 5.4, 4.4  # in
BAR = 0.24  # height of a bar [in]


@dataclass(frozen=True)
class Drawing:
    """A figure with the name of its file and its caption."""

    name: str
    figure: "Figure"
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
        ("code_bytes", _code, "bytes of instructions"),
        ("compile_seconds", _seconds, "s to compile"),
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


def _code(row: Row) -> float | None:
    return row.code_bytes


def _seconds(row: Row) -> float | None:
    return row.compile_seconds


def _lines(rows: Sequence[Row], value: Value) -> dict[str, list[tuple[int, float]]]:
    lines: dict[str, list[tuple[int, float]]] = {}
    for row in rows:
        known = value(row)
        if known is not None:
            lines.setdefault(row.name, []).append((row.members, known))
    return {name: sorted(points) for name, points in lines.items()}


def _over_members(
    lines: Mapping[str, Sequence[tuple[int, float]]], unit: str, marks: Sequence[tuple[float, str]] = ()
) -> "Figure":
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
