"""What the lines and colours of a drawn structure mean, and the names of its nodes and members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pictures.drawing import BAR_WIDTH, CABLE_WIDTH, DASHES
from tensegrity_codegen.report.pictures.palette import BAR, CABLE, GRID, INK, MUTED, PAPER, SLACK, UNKNOWN
from tensegrity_codegen.report.pictures.view import View
from tensegrity_codegen.structure.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure, SubFigure

__all__ = ["add_color_bar", "add_legend", "describe_size", "write_names"]

TEXT_SIZE = 9.0
# Names of members are left out of structures with more than this many.
MOST_MEMBER_NAMES = 30


def describe_size(structure: Structure) -> str:
    """Return the numbers of nodes, bars and cables in words."""
    bars = int(structure.is_bar.sum())
    counts = ((structure.n_nodes, "node"), (bars, "bar"), (structure.n_members - bars, "cable"))
    return ", ".join(f"{count} {word}{'' if count == 1 else 's'}" for count, word in counts if count)


def add_legend(
    figure: Figure | SubFigure, structure: Structure, *, slack: bool, colored: bool, unknown: bool = False
) -> None:
    """Explain below the panels the kinds of lines and marks that occur; `colored`: colour means tension.

    unknown: some members' tensions are not known.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import Normal, Stroke

    def line(color: str, width: float, name: str, **more: Any) -> Line2D:
        return Line2D([], [], color=color, linewidth=width, label=name, **more)

    handles = []
    if structure.is_bar.any():
        handles.append(line(MUTED if colored else BAR, BAR_WIDTH, "bar", solid_capstyle="round"))
    if not structure.is_bar.all():
        handles.append(line(MUTED if colored else CABLE, CABLE_WIDTH, "cable"))
    if slack:
        handles.append(line(SLACK, CABLE_WIDTH, "slack cable", linestyle=DASHES))
    if unknown and colored:
        rim = [Stroke(linewidth=BAR_WIDTH + 1.5, foreground=MUTED), Normal()]
        handles.append(line(UNKNOWN, BAR_WIDTH, "tension unknown", path_effects=rim))
    held = structure.node_anchored[:, list(structure.axes)]
    fully, partly = held.all(axis=1), held.any(axis=1) & ~held.all(axis=1)
    for chosen, fill, name in ((fully, INK, "anchor"), (partly, PAPER, "anchor on some axes")):
        if chosen.any():
            mark = {"marker": "^", "markerfacecolor": fill, "markeredgecolor": INK, "markersize": 7.5}
            handles.append(line("none", 0.0, name, **mark))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 5), frameon=False,
        fontsize=TEXT_SIZE, labelcolor=INK, handlelength=2.2, columnspacing=1.8,
    )  # fmt: skip


def add_color_bar(
    figure: Figure | SubFigure,
    panels: Axes | Sequence[Axes],
    mappable: ScalarMappable,
    *,
    below: bool = False,
    name: str = "member tension [N]",
) -> None:
    """Add the scale of member tensions, with their name, beside the panels or below them."""
    bar = figure.colorbar(
        mappable, ax=panels, location="bottom" if below else "right", shrink=0.7,
        aspect=30 if below else 26, pad=0.03, panchor=False,
    )  # fmt: skip
    bar.set_label(f"{name}  (compression < 0 < tension)", fontsize=TEXT_SIZE, color=INK)
    bar.ax.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=2)
    bar.outline.set_edgecolor(GRID)


def write_names(axes: Axes, structure: Structure, view: View, node_position: NDArray[np.float64]) -> None:
    """Write node names beside the nodes (n_nodes, 3) and, where they are few, member names on the members."""
    from matplotlib.patheffects import withStroke

    rim = [withStroke(linewidth=2.5, foreground=PAPER)]
    place, _ = view.project(node_position)
    middle = place.mean(axis=0)
    for name, point in zip(structure.node_name, place, strict=True):
        side = 1.0 if point[0] >= middle[0] else -1.0
        axes.annotate(
            name, (float(point[0]), float(point[1])), xytext=(7.0 * side, 4.0), textcoords="offset points",
            ha="left" if side > 0 else "right", va="bottom", fontsize=TEXT_SIZE, fontweight="bold",
            color=INK, path_effects=rim, zorder=6, annotation_clip=False,
        )  # fmt: skip
    if structure.n_members > MOST_MEMBER_NAMES:
        return
    for name, (i, j) in zip(structure.member_name, structure.connectivity, strict=True):
        # Off the middle, where bars of one module often cross.
        spot = 0.58 * place[i] + 0.42 * place[j]
        axes.annotate(
            name, (float(spot[0]), float(spot[1])), ha="center", va="center", fontsize=TEXT_SIZE - 2,
            color=MUTED, path_effects=rim, zorder=5, annotation_clip=False,
        )  # fmt: skip
