"""Still pictures: a structure, and a simulated motion on one page."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.report.pictures.canvas import (
    GRID,
    INK,
    MUTED,
    PICTURE_SUFFIXES,
    SEQUENCE,
    add_heading,
    check_suffix,
    new_figure,
    save_figure,
)
from tensegrity_codegen.report.pictures.drawing import panel_ratio
from tensegrity_codegen.report.pictures.panel import (
    Panel,
    Setting,
    add_color_bar,
    add_key,
    describe_size,
    fit_size,
    set_up,
)
from tensegrity_codegen.report.pictures.shown import Shown, show_motion
from tensegrity_codegen.report.pictures.view import PictureChoices, check_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.summaries import describe_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

TEXT_SIZE = 9.0
# Groups of at most this many members are drawn line by line, larger ones as a band around their median.
MAX_LINES = 6
# With more classes than colours, members are grouped by kind alone.
MAX_GROUPS = len(SEQUENCE)


def draw_energies(axes: "Axes", trajectory: Trajectory) -> None:
    """Draw kinetic, potential and total energy [J] over time [s]."""
    kinetic = trajectory.kinetic_energy
    lowest = float(np.min(trajectory.total_energy - kinetic))
    total = trajectory.total_energy - lowest
    rows = (
        ("total", total, INK, "solid", 2.0),
        ("potential", total - kinetic, SEQUENCE[0], "solid", 1.4),
        ("kinetic", kinetic, SEQUENCE[1], (0.0, (5.0, 1.6)), 1.4),
    )
    for name, values, color, style, width in rows:
        axes.plot(
            trajectory.time, values, label=name, color=color, linestyle=style, linewidth=width,
            marker=_marker(trajectory), zorder=2 if name == "total" else 3,
        )  # fmt: skip
    _dress(axes, "energy [J]", legend=3)
    axes.set_title(
        f"potential above {lowest:.4g} J", loc="left", fontsize=TEXT_SIZE - 1, color=MUTED, pad=5.0
    )


def draw_tensions(axes: "Axes", structure: Structure, trajectory: Trajectory) -> None:
    """Draw the member tensions [N] over time [s], one colour a group of `group_members`."""
    groups = group_members(structure)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    for (name, members), color in zip(groups.items(), SEQUENCE, strict=False):
        tension = trajectory.member_tension[:, members]
        is_complete = [not np.isnan(tension[:, k]).any() for k in range(len(members))]
        if not any(is_complete):
            continue
        tension, members = (
            tension[:, is_complete],
            [e for e, good in zip(members, is_complete, strict=True) if good],
        )
        label = f"{name} ({len(members)})"
        if len(members) <= MAX_LINES:
            lines = axes.plot(
                trajectory.time, tension, color=color, linewidth=1.1, marker=_marker(trajectory), zorder=3
            )
            lines[0].set_label(label)
            continue
        low, high = tension.min(axis=1), tension.max(axis=1)
        axes.fill_between(trajectory.time, low, high, color=color, alpha=0.22, linewidth=0.0, zorder=2)
        axes.plot(
            trajectory.time, np.median(tension, axis=1), color=color, linewidth=1.6, label=f"{label}, median",
            marker=_marker(trajectory), zorder=3,
        )  # fmt: skip
    _dress(axes, "member tension [N]", legend=3)


def draw_drift(axes: "Axes", structure: Structure, trajectory: Trajectory) -> None:
    """Draw the change of the total energy over the largest kinetic energy, over time [s].

    If nothing moves, the scale is the rounding of the potential energy, as in Trajectory.energy_drift.
    """
    change = trajectory.total_energy - trajectory.total_energy[0]
    potential = float(np.max(np.abs(trajectory.total_energy - trajectory.kinetic_energy)))
    drift = change / (max(float(np.max(trajectory.kinetic_energy)), 1e-9 * potential) or 1.0)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    axes.plot(trajectory.time, drift, color=SEQUENCE[2], linewidth=1.4, marker=_marker(trajectory), zorder=3)
    _dress(axes, "energy change [1]")
    axes.set_xlabel("time [s]", fontsize=TEXT_SIZE, color=INK)
    text = "change of total energy / largest kinetic energy"
    if trajectory.energy_drift is not None:
        text += f"; drift {trajectory.energy_drift:.2g}"
    elif structure.damping.any():
        text += "; damping takes energy away"
    axes.set_title(text, loc="right", fontsize=TEXT_SIZE - 1, color=MUTED, pad=3.0)


def group_members(structure: Structure) -> dict[str, list[int]]:
    """Return the members, bars first, by class and kind; by kind alone where the classes are many."""
    kinds = ["bar" if is_bar else "cable" for is_bar in structure.is_bar]
    order = sorted(range(structure.n_members), key=lambda e: kinds[e])
    fine: dict[str, list[int]] = {}
    coarse: dict[str, list[int]] = {}
    for e in order:
        name = structure.member_class[e]
        fine.setdefault(kinds[e] if name in ("", kinds[e]) else f"{kinds[e]} {name}", []).append(e)
        coarse.setdefault(f"{kinds[e]}s", []).append(e)
    return fine if len(fine) <= MAX_GROUPS else coarse


def _marker(trajectory: Trajectory) -> str:
    """Return the marker that makes short runs visible."""
    return "o" if len(trajectory.time) < 3 else ""


def _dress(axes: "Axes", name: str, *, legend: int = 0) -> None:
    """Give a diagram its grid, its name and, above it, a legend of so many columns."""
    axes.set_ylabel(name, fontsize=TEXT_SIZE, color=INK)
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)
    axes.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=0)
    axes.yaxis.get_offset_text().set(fontsize=TEXT_SIZE - 1, color=MUTED)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(GRID)
    if legend:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=legend, frameon=False,
            fontsize=TEXT_SIZE - 1, labelcolor=INK, borderaxespad=0.2, handlelength=1.8,
        )  # fmt: skip


# Paths of more nodes than this hide the structure.
MAX_PATHS = 40
# Width of a trajectory page, the least and the largest height [in].
PAGE_WIDTH, PAGE_LEAST, PAGE_MOST = 13.0, 6.3, 7.6
# Wider panels than this (width / height) stand one above the other.
WIDE = 1.3
AREA = 26.0  # of the panel of a picture [in2]
PICTURE_DPI = 150
USUAL_ROOM = 2.6  # inches of a panel's shorter side below which lines get thinner
VECTOR = (".svg", ".pdf")
DEFAULT = PictureChoices()


def draw_shown(setting: Setting, sample: int, title: str, note: str, *, is_vector: bool = False) -> "Figure":
    """Return a figure of one sample; setting: axes, view and colours; is_vector: for a file of lines."""
    width, height, dpi = fit_size(setting, area=AREA, dpi=PICTURE_DPI, is_vector=is_vector)
    figure = new_figure(width, height, dpi, compress=setting.choices.size is not None)
    room = (width - 1.6, height - 1.6)
    thin = float(np.clip(min(room) / USUAL_ROOM, 0.4, 1.0))
    panel = Panel(figure.add_subplot(), setting, room, line_scale=thin, start=sample)
    panel.show(sample)
    if panel.drawing.mappable is not None:
        add_color_bar(figure, panel.axes, panel.drawing.mappable, **setting.scale)
    add_key(figure, setting, slack=bool(panel.drawing.slack.any()))
    add_heading(figure, title, note)
    return figure


def plot_trajectory(
    structure: Structure,
    trajectory: Trajectory,
    path: str | Path,
    *,
    choices: PictureChoices = DEFAULT,
    subject: Structure | BodySystem | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a motion into a PNG, SVG or PDF file and return its path.

    Left: the first and the last shape with the paths of the nodes; right: energies, member tensions and
    energy drift over time. subject: the source of the outline.
    """
    target = Path(path)
    suffix = check_suffix(target, PICTURE_SUFFIXES)
    check_trajectory(structure, trajectory)
    shown = show_motion(structure, trajectory, subject)
    setting = set_up(shown, choices)
    figure = new_figure(*_page_size(setting, is_vector=suffix in VECTOR))
    picture, right = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))  # type: ignore[misc]
    _draw_shapes(picture, setting, trajectory)
    panels = right.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.3, 0.7))
    draw_energies(panels[0], trajectory)
    draw_tensions(panels[1], structure, trajectory)
    draw_drift(panels[2], structure, trajectory)
    samples = describe_count(len(trajectory.time), "sample")
    note = f"{describe_size(structure, shown.parts)}; {trajectory.method}, {samples}"
    if trajectory.status != "ok":
        note = f"{trajectory.status}: {trajectory.message}; {note}"
    add_heading(figure, structure.name, note)
    save_figure(figure, target, overwrite=overwrite)
    return target


def _page_size(setting: Setting, *, is_vector: bool) -> tuple[float, float, float]:
    """Return width and height of a page [in] and its dots an inch.

    Two panels of about 2.7 in width shall leave little paper empty.
    """
    ratio = panel_ratio(setting.view, setting.box)
    height = PAGE_MOST if ratio > WIDE else round(min(max(2.7 / ratio + 2.9, PAGE_LEAST), PAGE_MOST), 2)
    size = setting.choices.size
    if size is None:
        return PAGE_WIDTH, height, PICTURE_DPI
    dots = PICTURE_DPI if is_vector else float(np.sqrt(size[0] * size[1] / (PAGE_WIDTH * height)))
    if not is_vector:
        dots = min(dots, size[0] / (0.6 * PAGE_WIDTH), size[1] / (0.7 * PAGE_LEAST))
    return size[0] / dots, size[1] / dots, dots


def _draw_shapes(figure: "SubFigure", setting: Setting, trajectory: Trajectory) -> None:
    """Draw the first and the last shape side by side, wide ones one above the other."""
    is_wide = panel_ratio(setting.view, setting.box) > WIDE
    slack = False
    end = len(trajectory.time) - 1
    for axes, sample in zip(
        figure.subplots(2, 1) if is_wide else figure.subplots(1, 2), (0, end), strict=True
    ):
        panel = Panel(axes, setting, (2.7, 2.7), line_scale=0.8, start=sample)
        panel.show(sample)
        slack = slack or bool(panel.drawing.slack.any())
        axes.set_title(f"t = {trajectory.time[sample]:.4g} s", fontsize=10, color=INK, pad=14.0)
    _draw_paths(panel, setting.shown)
    if panel.drawing.mappable is not None:
        add_color_bar(figure, figure.axes, panel.drawing.mappable, below=True, **setting.scale)
    add_key(figure, setting, slack=slack)


def _draw_paths(panel: Panel, shown: Shown) -> None:
    """Draw the paths of the nodes that are free to move, of evenly picked ones if they are many."""
    from matplotlib.collections import LineCollection

    structure = shown.structure
    held = structure.node_anchored[:, list(structure.axes)].all(axis=1)
    free = np.flatnonzero(~held & ~structure.is_corner)
    picked = free[:: 1 + len(free) // MAX_PATHS]
    projected, _ = panel.drawing.view.project(shown.position[:, picked])
    lines = LineCollection(
        list(projected.transpose(1, 0, 2)),
        colors=SEQUENCE[3],
        linewidths=0.9,
        alpha=0.8,
        zorder=3.5,
        clip_on=panel.is_moving,
    )
    panel.axes.add_collection(lines, autolim=False)
