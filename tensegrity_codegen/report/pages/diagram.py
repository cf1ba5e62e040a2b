"""Diagrams of lines and points in the style of a page, small enough to be read on a phone."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal
from zlib import crc32

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.report.number_text import format_number, raise_digits
from tensegrity_codegen.report.pictures.canvas import GRID, INK, MUTED, PAPER, SEQUENCE, new_figure
from tensegrity_codegen.tables.integrators import INTEGRATORS, STIFF_INTEGRATOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.ticker import Formatter

MAX_LINEAR = 0.9  # decades of a logarithmic axis up to which equal steps are numbered
MAX_PARTS = 2.5  # decades up to which 2 and 5 are numbered too
POWER = re.compile(r"e([+-]?\d+)")  # of ten, in the text of matplotlib


def number_axis(axis: "Axis", limits: tuple[float, float], is_log: bool) -> None:
    """Choose ticks and their texts for an axis whose values lie within limits."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    steps = MaxNLocator(nbins=7, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3)
    if not is_log:
        axis.set_major_locator(steps)
        axis.set_major_formatter(_build_formatter())
        axis.get_offset_text().set(fontsize=8.5, color=MUTED)
        return
    low, high = sorted(limits)
    decades = math.log10(high / low) if low > 0.0 else math.inf
    if decades <= MAX_LINEAR:
        axis.set_major_locator(steps)
    elif decades <= MAX_PARTS:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(format_tick))
    axis.set_minor_formatter(NullFormatter())


def format_tick(value: float, _: object = None) -> str:
    """Return a power of ten as 10⁻³, any other tick of a logarithmic axis in short."""
    exponent = round(math.log10(value)) if value > 0 else 0
    if value > 0 and math.isclose(value, 10.0**exponent, rel_tol=1e-9):
        return f"10{raise_digits(exponent)}"
    return format_number(value, "g")


def _build_formatter() -> "Formatter":
    """Return the texts of equal steps: a common power of ten stands at the end of the axis as × 10⁻⁶."""
    from matplotlib.ticker import ScalarFormatter

    class RaisedPower(ScalarFormatter):
        def get_offset(self) -> str:
            text = str(super().get_offset())
            power = POWER.search(text.replace("\N{MINUS SIGN}", "-"))
            return f"× 10{raise_digits(int(power[1]))}" if power else text

    formatter = RaisedPower(useOffset=False)
    formatter.set_powerlimits((-4, 5))
    return formatter


WIDTH, HEIGHT = 4.9, 3.3
TEXT_SIZE = 9.5
# Behind texts that stand among lines.
BEHIND = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.0, "alpha": 0.8}
DASHES = {
    "line": "solid",
    "dashed": (0.0, (5.0, 2.0)),
    "dotted": (0.0, (1.2, 1.8)),
    "dashdot": (0.0, (5.0, 1.6, 1.2, 1.6)),
    "points": "none",
}


@dataclass(frozen=True)
class Series:
    """One line or row of points: name in the legend (none if empty), places, style, number of its colour."""

    name: str
    x: ArrayLike
    y: ArrayLike
    style: Literal["line", "dashed", "dotted", "dashdot", "points"] = "line"
    color: int = 0
    marker: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return name and places in JSON's types, None for values that are not finite."""
        return {"name": self.name, "x": _finite(self.x), "y": _finite(self.y)}


@dataclass(frozen=True)
class Diagram:
    """Series over two named axes, with horizontal and vertical marks (value, text) if wanted."""

    x_label: str
    y_label: str
    series: Sequence[Series]
    log_x: bool = False
    log_y: bool = False
    y_limits: tuple[float, float] | None = None
    horizontal: Sequence[tuple[float, str]] = ()
    vertical: Sequence[tuple[float, str]] = ()
    legend_columns: int = 3

    def as_dict(self) -> dict[str, Any]:
        """Return labels, series and marks in JSON's types."""
        marks = {
            "horizontal": [list(m) for m in self.horizontal],
            "vertical": [list(m) for m in self.vertical],
        }
        return {
            "x_label": self.x_label,
            "y_label": self.y_label,
            "series": [series.as_dict() for series in self.series],
            **{key: rows for key, rows in marks.items() if rows},
        }


def draw_diagram(diagram: Diagram, *, width: float = WIDTH, height: float = HEIGHT) -> "Figure":
    """Return the diagram as a figure of width x height [in]."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = new_figure(width, height)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(h_pad=0.02)
    axes = figure.add_subplot()
    for series in diagram.series:
        points = series.style == "points"
        axes.plot(
            np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float),
            label=series.name or "_", color=SEQUENCE[series.color % len(SEQUENCE)],
            linestyle=DASHES[series.style], linewidth=1.7, marker=series.marker or ("o" if points else ""),
            markersize=4.5, zorder=4 if points else 3,
        )  # fmt: skip
    if diagram.log_x:
        axes.set_xscale("log")
    if diagram.log_y:
        axes.set_yscale("log")
    if diagram.y_limits is not None:
        axes.set_ylim(*diagram.y_limits)
    _draw_marks(axes, diagram)
    dress_axes(axes, diagram.x_label, diagram.y_label, log=(diagram.log_x, diagram.log_y))
    if not diagram.log_x and all(np.asarray(series.x).dtype.kind == "i" for series in diagram.series):
        axes.locator_params(axis="x", integer=True)
    if any(series.name for series in diagram.series):
        # Put the legend in rows of so many columns above the axes
        figure.legend(
            loc="outside upper center", ncols=diagram.legend_columns, frameon=False, fontsize=TEXT_SIZE - 0.5,
            labelcolor=INK, handlelength=1.9, columnspacing=1.4, borderaxespad=0.2,
        )  # fmt: skip
    return figure


def dress_axes(axes: "Axes", x_label: str, y_label: str, *, log: tuple[bool, bool] = (False, False)) -> None:
    """Give axes their names, grid and quiet frame; powers of ten are written without mathematical fonts."""
    axes.set_xlabel(x_label, fontsize=TEXT_SIZE, color=INK)
    axes.set_ylabel(y_label, fontsize=TEXT_SIZE, color=INK)
    axes.grid(True, color=GRID, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=0, which="both")
    number_axis(axes.xaxis, axes.get_xlim(), log[0])
    number_axis(axes.yaxis, axes.get_ylim(), log[1])
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(GRID)


def _finite(values: ArrayLike) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in np.asarray(values, dtype=float).tolist()]


def _draw_marks(axes: "Axes", diagram: Diagram) -> None:
    """Draw a thin line with its text at each marked value."""
    for value, text in diagram.horizontal:
        axes.axhline(value, color=MUTED, linewidth=1.0, linestyle=DASHES["dotted"], zorder=2)
        axes.annotate(
            text, (1.0, value), xycoords=("axes fraction", "data"), xytext=(-3, 3), ha="right", va="bottom",
            textcoords="offset points", fontsize=TEXT_SIZE - 1, color=MUTED, bbox=BEHIND, zorder=5,
        )  # fmt: skip
    for row, (value, text) in enumerate(sorted(diagram.vertical, reverse=True)):
        fraction = (axes.transData - axes.transAxes).transform((value, axes.get_ylim()[0]))[0]
        axes.axvline(value, color=MUTED, linewidth=1.0, linestyle=DASHES["dotted"], zorder=2)
        axes.annotate(
            text, (value, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2 + 11 * row),
            ha="left" if fraction < 0.5 else "right", va="bottom",
            textcoords="offset points", fontsize=TEXT_SIZE - 1, color=MUTED, zorder=5,
        )  # fmt: skip


# How methods look in diagrams: one colour, dash and marker for each, the same on every page.
#
# The colour says which scheme it is, dash and marker whose code runs it and in which variant, so that lines
# are told apart without colours too.


Dash = Literal["line", "dashed", "dotted", "dashdot"]

BLUE, VERMILION, GREEN, VIOLET, BROWN, SLATE = range(6)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p", "h")


@dataclass(frozen=True)
class MethodStyle:
    """Number of a colour of SEQUENCE, dash, and marker of matplotlib."""

    color: int
    dash: Dash = "line"
    marker: str = "o"

    @property
    def light(self) -> str:
        """The colour on white paper, #rrggbb."""
        return SEQUENCE[self.color]


# Methods of integration, formulations, other programs, ways to evaluate; names without upper case.
METHOD_STYLES: dict[str, MethodStyle] = {
    "auto": MethodStyle(SLATE, "line", "*"),
    "rk4": MethodStyle(BROWN, "line", "v"),
    "rk54": MethodStyle(GREEN, "line", "s"),
    "tsit5": MethodStyle(VIOLET, "line", "D"),
    "rk853": MethodStyle(BLUE, "line", "o"),
    **{name: MethodStyle(*row.look) for name, row in INTEGRATORS.items() if row.look is not None},
    "scipy dop853": MethodStyle(BLUE, "dashed", "P"),
    "scipy rk45": MethodStyle(GREEN, "dashed", "X"),
    "scipy lsoda": MethodStyle(SLATE, "dashed", "h"),
    f"scipy {STIFF_INTEGRATOR}": MethodStyle(VERMILION, "dashed", "<"),
    "scipy": MethodStyle(SLATE, "dashed", "h"),
    "ours": MethodStyle(BLUE, "line", "o"),
    "cvodes": MethodStyle(VIOLET, "dotted", ">"),
    "idas": MethodStyle(SLATE, "dotted", "<"),
    "mujoco rk4": MethodStyle(BROWN, "dashdot", "v"),
    "mujoco euler": MethodStyle(BROWN, "dotted", "s"),
    "mujoco implicit": MethodStyle(VERMILION, "dashdot", "D"),
    "mujoco implicitfast": MethodStyle(VERMILION, "dotted", "p"),
    "node_position": MethodStyle(BLUE, "line", "o"),
    "node_position by table": MethodStyle(BLUE, "dashed", "X"),
    "node_distance": MethodStyle(GREEN, "line", "^"),
    "rigid_bar": MethodStyle(VERMILION, "line", "s"),
    "rigid_bar all bars": MethodStyle(VERMILION, "dashed", "D"),
    "rigid_bar corrected": MethodStyle(BROWN, "dotted", "v"),
    "bodies": MethodStyle(VIOLET, "line", "D"),
    "unrolled": MethodStyle(BLUE, "line", "o"),
    "table": MethodStyle(GREEN, "line", "^"),
    "casadi c": MethodStyle(SLATE, "dashed", "D"),
    "casadi vm": MethodStyle(SLATE, "dotted", "v"),
    "numpy": MethodStyle(VIOLET, "dashed", "P"),
    "numba": MethodStyle(VIOLET, "dotted", "X"),
    "jax": MethodStyle(BROWN, "dashed", "<"),
    "mujoco": MethodStyle(BROWN, "dotted", ">"),
}
_WORD = re.compile(r"[a-z0-9_]+")


def find_style(name: str) -> MethodStyle:
    """Return how a method looks: that of the longest name of METHOD_STYLES whose words it has, in order.

    A method without description has a look that depends on its name alone.
    """
    name_words = _WORD.findall(name.lower().replace("scipy_", "scipy "))
    fitting = [key for key in METHOD_STYLES if _has(name_words, _WORD.findall(key))]
    if fitting:
        return METHOD_STYLES[max(fitting, key=lambda key: (len(_WORD.findall(key)), len(key)))]
    number = crc32(name.encode())
    dashes: tuple[Dash, ...] = ("dashed", "dotted", "dashdot")
    return MethodStyle(number % len(SEQUENCE), dashes[number // 7 % 3], MARKERS[number // 31 % len(MARKERS)])


def choose_styles(names: Iterable[str]) -> dict[str, MethodStyle]:
    """Return the looks of methods that one diagram shows: where two are the same, one has another marker.

    The colours are those of `find_style`.
    """
    chosen: dict[str, MethodStyle] = {}
    for name in names:
        style = find_style(name)
        used_styles = set(chosen.values())
        start = MARKERS.index(style.marker)
        for step in range(1, len(MARKERS)):
            if style not in used_styles:
                break
            style = replace(style, marker=MARKERS[(start + step) % len(MARKERS)])
        chosen[name] = style
    return chosen


def method_series(name: str, x: ArrayLike, y: ArrayLike, style: MethodStyle | None = None) -> Series:
    """Return the line of a method for a Diagram; style: of `choose_styles`, else that of its name."""
    style = find_style(name) if style is None else style
    return Series(name, x, y, style.dash, style.color, style.marker)


def _has(name_words: list[str], phrase: list[str]) -> bool:
    """Return whether words have those wanted, in order, others between them or not."""
    remaining = iter(name_words)
    return all(word in remaining for word in phrase)
