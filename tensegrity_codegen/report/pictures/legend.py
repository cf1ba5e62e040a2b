"""What the lines, colours and arrows of a drawn structure mean."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.pictures.arrows import describe_arrows
from tensegrity_codegen.report.pictures.drawing import BAR_WIDTH, CABLE_WIDTH, DASHES, BodyParts
from tensegrity_codegen.report.pictures.palette import (
    BAR,
    BODY,
    CABLE,
    GRID,
    INK,
    MUTED,
    PAPER,
    SLACK,
    UNKNOWN,
)
from tensegrity_codegen.report.pictures.panel import Setting
from tensegrity_codegen.report.pictures.shown import COLOR_NAMES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.summaries import describe_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure, SubFigure


TEXT_SIZE = 9.0
ROOM = 0.8  # part of a figure's height that a scale may have beside it
UNKNOWN_NAMES = {color: unknown for color, (_, unknown) in COLOR_NAMES.items()}
ARROW = {"marker": ">", "markersize": 6.0, "markevery": [1]}


def describe_size(structure: Structure, parts: BodyParts | None = None) -> str:
    """Return the numbers of nodes, rigid bodies, bars and cables in words."""
    parts = BodyParts.none(structure) if parts is None else parts
    bars = int((structure.is_bar & ~parts.edge).sum())
    cables = int((~structure.is_bar).sum())
    words = {"node": structure.n_nodes, "rigid body": parts.count, "bar": bars, "cable": cables}
    plural = {"rigid body": "rigid bodies"}
    counts = {word: count for word, count in words.items() if count}
    return ", ".join(describe_count(count, word, plural.get(word, "")) for word, count in counts.items())


def add_key(figure: "Figure | SubFigure", setting: Setting, *, slack: bool) -> None:
    """Explain below the panels what a picture shows; slack: whether a cable is slack."""
    add_legend(
        figure,
        setting.shown.structure,
        slack=slack,
        colored=setting.limit is not None,
        unknown=UNKNOWN_NAMES.get(setting.choices.color, "") if setting.has_unknown else "",
        parts=setting.shown.parts,
        arrows=describe_arrows(setting.arrows),
    )


def add_legend(
    figure: "Figure | SubFigure",
    structure: Structure,
    *,
    slack: bool,
    colored: bool,
    unknown: str = "",
    parts: BodyParts | None = None,
    arrows: Sequence[tuple[str, str]] = (),
) -> None:
    """Explain below the panels the kinds of lines and marks that occur.

    colored: colour means a value; unknown: what members of the colour UNKNOWN are called, if there are any;
    arrows: colour and text of each line on arrows, with the colour "none" text alone.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import Normal, Stroke

    def line(color: str, width: float, name: str, **more: Any) -> Line2D:
        return Line2D([], [], color=color, linewidth=width, label=name, **more)

    parts = BodyParts.none(structure) if parts is None else parts
    handles = []
    if (structure.is_bar & ~parts.edge).any():
        handles.append(line(MUTED if colored else BAR, BAR_WIDTH, "bar", solid_capstyle="round"))
    if not structure.is_bar.all():
        handles.append(line(MUTED if colored else CABLE, CABLE_WIDTH, "cable"))
    if parts.edge.any():
        handles.append(line(BODY, BAR_WIDTH, "rigid body", solid_capstyle="round"))
    if slack:
        handles.append(line(SLACK, CABLE_WIDTH, "slack cable", linestyle=DASHES))
    if unknown and colored:
        rim = [Stroke(linewidth=BAR_WIDTH + 1.5, foreground=MUTED), Normal()]
        handles.append(line(UNKNOWN, BAR_WIDTH, unknown, path_effects=rim))
    held = structure.node_anchored[:, list(structure.axes)]
    fully, partly = held.all(axis=1), held.any(axis=1) & ~held.all(axis=1)
    for chosen, fill, name in ((fully, INK, "anchor"), (partly, PAPER, "anchor on some axes")):
        if chosen.any():
            mark = {"marker": "^", "markerfacecolor": fill, "markeredgecolor": INK, "markersize": 7.5}
            handles.append(line("none", 0.0, name, **mark))
    handles += [line(color, 1.9, text, **(ARROW if color != "none" else {})) for color, text in arrows]
    _write_legend(figure, handles)


def _write_legend(figure: "Figure | SubFigure", handles: list[Any]) -> None:
    """Write the legend below the panels, in as many columns as fit side by side."""
    # A column is as wide as its longest text; a figure has about 13 letters an inch.
    longest = max((len(item.get_label()) for item in handles), default=1) + 7
    figure.legend(
        handles=handles, loc="outside lower center", ncols=int(np.clip(_letters(figure) // longest, 1, 5)),
        frameon=False, fontsize=TEXT_SIZE, labelcolor=INK, handlelength=2.2, columnspacing=1.8,
    )  # fmt: skip


def _letters(figure: "Figure | SubFigure") -> int:
    """Return about how many letters of the legend fit side by side."""
    return int(13.0 * figure.bbox.width / figure.dpi)


def add_color_bar(
    figure: "Figure | SubFigure",
    panels: "Axes | Sequence[Axes]",
    mappable: "ScalarMappable",
    *,
    below: bool = False,
    name: str = "member tension [N]",
) -> None:
    """Add the scale of member tensions, with their name, beside the panels or below them."""
    bar = figure.colorbar(
        mappable, ax=panels, location="bottom" if below else "right", shrink=0.7,
        aspect=30 if below else 26, pad=0.03, panchor=False,
    )  # fmt: skip
    text = f"{name}  (compression < 0 < tension)"
    length = (figure.bbox.width if below else ROOM * figure.bbox.height) / figure.dpi
    fits = 0.6 * TEXT_SIZE * len(text) / 72 < length
    bar.set_label(text if fits else name, fontsize=TEXT_SIZE, color=INK)
    bar.ax.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=2)
    bar.outline.set_edgecolor(GRID)
