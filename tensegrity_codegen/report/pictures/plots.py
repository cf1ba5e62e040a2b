"""Still pictures: a structure, and a simulated motion on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.report.pictures.canvas import PICTURE_SUFFIXES, check_suffix, new_figure, save_figure
from tensegrity_codegen.report.pictures.checks import check_array, check_tension, check_trajectory
from tensegrity_codegen.report.pictures.drawing import StructureDrawing, find_tension_limit
from tensegrity_codegen.report.pictures.frame import draw_frame, panel_ratio, picture_size
from tensegrity_codegen.report.pictures.heading import add_heading
from tensegrity_codegen.report.pictures.legend import add_color_bar, add_legend, describe_size, write_names
from tensegrity_codegen.report.pictures.palette import INK, SEQUENCE
from tensegrity_codegen.report.pictures.panels import draw_drift, draw_energies, draw_tensions
from tensegrity_codegen.report.pictures.view import Box, View, find_box, fit_view
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

__all__ = ["draw_structure", "plot_structure", "plot_trajectory"]

FloatArray = NDArray[np.float64]

# Paths of more nodes than this hide the structure.
MOST_PATHS = 40
# Width of a trajectory page, the least and the largest height [in].
PAGE_WIDTH, PAGE_LEAST, PAGE_MOST = 13.0, 6.3, 7.6
# Wider panels than this (width / height) stand one above the other.
WIDE = 1.3


def plot_structure(
    structure: Structure,
    path: str | Path,
    *,
    node_position: ArrayLike | None = None,
    member_tension: ArrayLike | None = None,
    title: str | None = None,
    labels: bool = False,
) -> Path:
    """Draw a structure into a PNG, SVG or PDF file and return its path.

    node_position (n_nodes, 3) [m]: the stated positions by default; member_tension (n_members,) [N] gives
    the members' colours, NaN where that of a rigid bar is unknown; labels: with the names of nodes and
    members. Raises InvalidValueError for another suffix or shape, NonFiniteError, OutputError for a file that
    cannot be written, MissingExtraError without matplotlib.
    """
    target = Path(path)
    check_suffix(target, PICTURE_SUFFIXES)
    figure = draw_structure(
        structure, node_position=node_position, member_tension=member_tension, title=title, labels=labels
    )
    save_figure(figure, target)
    return target


def draw_structure(
    structure: Structure,
    *,
    node_position: ArrayLike | None = None,
    member_tension: ArrayLike | None = None,
    title: str | None = None,
    note: str | None = None,
    labels: bool = False,
) -> Figure:
    """Return the figure of `plot_structure`; note: the line below the title, by default the size."""
    position = structure.node_position if node_position is None else node_position
    place = check_array("node_position", position, (structure.n_nodes, 3), "nodes, axes")
    tension = None
    if member_tension is not None:
        tension = check_tension(member_tension, (structure.n_members,), structure, "members")
    box = find_box(place, structure.axes)
    view = fit_view(structure, box, place)
    limit = find_tension_limit(tension)
    figure = new_figure(*picture_size(view, box, with_bar=limit is not None))
    axes = figure.add_subplot()
    draw_frame(axes, view, box)
    drawing = StructureDrawing(axes, structure, view, tension_limit=limit)
    drawing.show(place, tension)
    if labels:
        write_names(axes, structure, view, place)
    if drawing.mappable is not None:
        add_color_bar(figure, axes, drawing.mappable)
    unknown = tension is not None and bool(np.isnan(tension).any())
    colored = drawing.mappable is not None
    add_legend(figure, structure, slack=bool(drawing.slack.any()), colored=colored, unknown=unknown)
    heading = structure.name if title is None else title
    add_heading(figure, heading, describe_size(structure) if note is None else note)
    return figure


def plot_trajectory(structure: Structure, trajectory: Trajectory, path: str | Path) -> Path:
    """Draw a motion into a PNG, SVG or PDF file and return its path.

    Left: the first and the last shape with the paths of the nodes; right: energies, member tensions and
    energy drift over time. Raises what `plot_structure` raises.
    """
    target = Path(path)
    check_suffix(target, PICTURE_SUFFIXES)
    check_trajectory(structure, trajectory)
    box = find_box(trajectory.node_position, structure.axes)
    view = fit_view(structure, box, trajectory.node_position[0])
    figure = new_figure(PAGE_WIDTH, _page_height(view, box))
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))  # type: ignore[misc]
    _draw_shapes(left, structure, trajectory, view, box)
    panels = right.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.3, 0.7))
    draw_energies(panels[0], trajectory)
    draw_tensions(panels[1], structure, trajectory)
    draw_drift(panels[2], structure, trajectory)
    note = f"{describe_size(structure)}; {trajectory.method}, {len(trajectory.time)} samples"
    if trajectory.status != "ok":
        note = f"{trajectory.status}: {trajectory.message}; {note}"
    add_heading(figure, structure.name, note)
    save_figure(figure, target)
    return target


def _page_height(view: View, box: Box) -> float:
    """Return the height of a page [in] on which two panels of about 2.7 in width leave little paper empty."""
    ratio = panel_ratio(view, box)
    return PAGE_MOST if ratio > WIDE else round(min(max(2.7 / ratio + 2.9, PAGE_LEAST), PAGE_MOST), 2)


def _draw_shapes(
    figure: SubFigure, structure: Structure, trajectory: Trajectory, view: View, box: Box
) -> None:
    """Draw the first and the last shape side by side, wide ones one above the other."""
    panels = figure.subplots(2, 1) if panel_ratio(view, box) > WIDE else figure.subplots(1, 2)
    limit = find_tension_limit(trajectory.member_tension)
    slack = False
    for axes, sample in zip(panels, (0, -1), strict=True):
        draw_frame(axes, view, box)
        drawing = StructureDrawing(axes, structure, view, tension_limit=limit, line_scale=0.8)
        drawing.show(trajectory.node_position[sample], trajectory.member_tension[sample])
        slack = slack or bool(drawing.slack.any())
        axes.set_title(f"t = {trajectory.time[sample]:.4g} s", fontsize=10, color=INK, pad=14.0)
    _draw_paths(panels[1], structure, trajectory, view)
    if drawing.mappable is not None:
        add_color_bar(figure, list(panels), drawing.mappable, below=True)
    unknown = bool(np.isnan(trajectory.member_tension).any())
    add_legend(figure, structure, slack=slack, colored=limit is not None, unknown=unknown)


def _draw_paths(axes: Axes, structure: Structure, trajectory: Trajectory, view: View) -> None:
    """Draw the paths of the nodes that are free to move, of evenly picked ones where they are many."""
    from matplotlib.collections import LineCollection

    free = np.unique(structure.coordinate_node_axis[:, 0])
    picked = free[:: 1 + len(free) // MOST_PATHS]
    place, _ = view.project(trajectory.node_position[:, picked])
    lines = LineCollection(
        list(place.transpose(1, 0, 2)),
        colors=SEQUENCE[3],
        linewidths=0.9,
        alpha=0.8,
        zorder=3.5,
        clip_on=False,
    )
    axes.add_collection(lines, autolim=False)
