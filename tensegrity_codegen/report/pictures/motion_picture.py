"""Pictures for pages: a structure coloured by tensions, or moved along a motion over its own shadow."""

from typing import TYPE_CHECKING

import numpy as np

from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.drawing import StructureDrawing, find_tension_limit
from tensegrity_codegen.report.pictures.frame import draw_frame, picture_size
from tensegrity_codegen.report.pictures.legend import add_color_bar
from tensegrity_codegen.report.pictures.palette import MUTED
from tensegrity_codegen.report.pictures.view import find_box, fit_view
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SHOWN = 0.16  # largest displacement in a picture, over the longest side of the structure
AREA = 11.0  # of a picture's panel [in2]


def draw_tensions(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray,
    name: str,
    *,
    among: tuple[FloatArray, FloatArray] | None = None,
) -> "Figure":
    """Return a picture of the structure at position (n_nodes, 3) [m], coloured by tensions (n_members,).

    name: of the tensions, with their unit; among: positions (n, n_nodes, 3) and tensions (n, n_members) that
    pictures of the same view and colours show.
    """
    places, tensions = (position, tension) if among is None else among
    box = find_box(places.reshape(-1, 3), structure.axes)
    view, limit = (
        fit_view(structure, box, places.reshape(-1, *position.shape)[0]),
        find_tension_limit(tensions),
    )
    figure = new_figure(*picture_size(view, box, with_bar=limit is not None, area=AREA))
    axes = figure.add_subplot()
    draw_frame(axes, view, box)
    drawing = StructureDrawing(axes, structure, view, tension_limit=limit)
    drawing.show(position, tension)
    if drawing.mappable is not None:
        add_color_bar(figure, axes, drawing.mappable, name=name)
    return figure


def draw_motion(structure: Structure, position: FloatArray, motion: FloatArray) -> "Figure":
    """Return a picture of the structure moved along displacements (n_nodes, 3), enlarged to be seen."""
    from matplotlib.collections import LineCollection

    largest = float(np.linalg.norm(motion, axis=1).max(initial=0.0))
    side = float(np.ptp(position, axis=0).max(initial=0.0))
    moved = position + motion * (SHOWN * side / largest if largest else 0.0)
    box = find_box(np.vstack([position, moved]), structure.axes)
    view = fit_view(structure, box, position)
    figure = new_figure(*picture_size(view, box, with_bar=False, area=AREA))
    axes = figure.add_subplot()
    draw_frame(axes, view, box)
    place, _ = view.project(position)
    shadow = LineCollection(
        list(place[structure.connectivity]), colors=MUTED, linewidths=0.7, linestyles="dotted", zorder=2
    )
    axes.add_collection(shadow, autolim=False)
    drawing = StructureDrawing(axes, structure, view)
    drawing.show(moved, np.ones(structure.n_members))  # no cable is shown as slack
    return figure
