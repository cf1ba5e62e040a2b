"""A small film inside a page: a motion, over the shadow of the motion that was planned."""

import base64
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pages.picture import CSS_DPI, Picture
from tensegrity_codegen.report.pictures.animate import write_gif
from tensegrity_codegen.report.pictures.canvas import PICTURE_DPI, new_figure
from tensegrity_codegen.report.pictures.drawing import StructureDrawing, find_tension_limit
from tensegrity_codegen.report.pictures.frame import draw_frame, picture_size
from tensegrity_codegen.report.pictures.palette import INK, MUTED
from tensegrity_codegen.report.pictures.panel import add_color_bar
from tensegrity_codegen.report.pictures.view import View, find_box, fit_view
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import import_extra

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
    limit = find_tension_limit(tensions)
    first = places.reshape(-1, *position.shape)[0]
    figure, axes, view = _new_panel(structure, places, first, with_bar=limit is not None)
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
    figure, axes, view = _new_panel(structure, np.stack([position, moved]), position, with_bar=False)
    place, _ = view.project(position)
    shadow = LineCollection(
        list(place[structure.strands.ends]), colors=MUTED, linewidths=0.7, linestyles="dotted", zorder=2
    )
    axes.add_collection(shadow, autolim=False)
    drawing = StructureDrawing(axes, structure, view)
    drawing.show(moved, np.ones(structure.n_members))  # no cable is shown as slack
    return figure


def _new_panel(
    structure: Structure, places: FloatArray, first: FloatArray, *, with_bar: bool, dpi: float = PICTURE_DPI
) -> "tuple[Figure, Any, View]":
    """Return a new figure with axes that hold all places (..., 3) [m], and the view that suits `first`."""
    box = find_box(places, structure.axes)
    view = fit_view(structure, box, first)
    figure = new_figure(*picture_size(view, box, with_bar=with_bar, area=AREA), dpi=dpi)
    axes = figure.add_subplot()
    draw_frame(axes, view, box)
    return figure, axes, view


PAUSE = 1.0  # [s], on the last picture


def draw_film(
    structure: Structure,
    time: FloatArray,
    position: FloatArray,
    tension: FloatArray,
    planned: FloatArray,
    *,
    slow_down: float = 1.0,
) -> Picture:
    """Return a film of positions (n_t, n_nodes, 3) [m] coloured by tensions (n_t, n_members) [N].

    time (n_t,) [s], equally spaced; planned (n_t, n_nodes, 3): drawn dotted; slow_down: seconds of film for a
    second of the motion.
    """
    import_extra("PIL.Image")
    limit = find_tension_limit(tension)
    places = np.concatenate([position, planned])
    figure, axes, view = _new_panel(structure, places, position[0], with_bar=limit is not None, dpi=CSS_DPI)
    shadow, clock = _add_shadow(axes)
    drawing = StructureDrawing(axes, structure, view, tension_limit=limit)
    if drawing.mappable is not None:
        add_color_bar(figure, axes, drawing.mappable, name="member tension [N]")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # one layout for all pictures; to find it takes longer than to draw

    def paint() -> Iterator[NDArray[np.uint8]]:
        canvas: Any = figure.canvas
        for k in range(len(time)):
            drawing.show(position[k], tension[k])
            place, _ = view.project(planned[k])
            shadow.set_segments(list(place[structure.strands.ends]))
            clock.set_text(f"{time[k]:.2f} s")
            canvas.draw()
            yield np.array(canvas.buffer_rgba(), dtype=np.uint8)[..., :3]

    fps = min(50.0, (len(time) - 1) / max(float(time[-1] - time[0]) * slow_down, 1e-9))
    counts = [1] * (len(time) - 1) + [max(1, round(PAUSE * fps))]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.gif"
        write_gif(path, paint(), counts, fps)
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    width, height = (round(float(inches) * CSS_DPI) for inches in figure.get_size_inches())
    return Picture(width, height, png=f"data:image/gif;base64,{data}")


def _add_shadow(axes: Any) -> tuple[Any, Any]:
    """Return the lines of the planned shape, and the text of the time."""
    from matplotlib.collections import LineCollection

    shadow = LineCollection([], colors=MUTED, linewidths=0.9, linestyles="dotted", zorder=2)
    axes.add_collection(shadow, autolim=False)
    clock = axes.text(0.02, 0.98, "", transform=axes.transAxes, va="top", fontsize=10, color=INK)
    return shadow, clock
