"""Diagrams of lines and points in the style of a page, small enough to be read on a phone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.report.pages.axis_numbers import number_axis
from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.palette import GRID, INK, MUTED, PAPER, SEQUENCE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        """Return name and places in JSON's types, None for what is not finite."""
        return {"name": self.name, "x": _finite(self.x), "y": _finite(self.y)}


@dataclass(frozen=True)
class Diagram:
    """Series over two named axes, with horizontal and vertical marks (value, text) where wanted."""

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
    if any(series.name for series in diagram.series):
        _add_legend(figure, diagram.legend_columns)
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
    for value, text in diagram.vertical:
        axes.axvline(value, color=MUTED, linewidth=1.0, linestyle=DASHES["dotted"], zorder=2)
        axes.annotate(
            text, (value, 1.0), xycoords=("data", "axes fraction"), xytext=(-3, -3), ha="right", va="top",
            textcoords="offset points", fontsize=TEXT_SIZE - 1, color=MUTED, rotation=90, bbox=BEHIND,
            zorder=5,
        )  # fmt: skip


def _add_legend(figure: "Figure", columns: int) -> None:
    """Put the legend in rows of so many columns above the axes."""
    figure.legend(
        loc="outside upper center", ncols=columns, frameon=False, fontsize=TEXT_SIZE - 0.5,
        labelcolor=INK, handlelength=1.9, columnspacing=1.4, borderaxespad=0.2,
    )  # fmt: skip
