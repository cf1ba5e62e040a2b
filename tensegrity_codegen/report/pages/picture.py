"""Pictures as text that stands inside a page: SVG if it is small, a PNG in base64 else; small films."""

import base64
import io
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.number_text import lower_indices
from tensegrity_codegen.report.pictures.animate import write_gif
from tensegrity_codegen.report.pictures.canvas import (
    BAR,
    GRID,
    INK,
    MUTED,
    PAPER,
    PICTURE_DPI,
    SEQUENCE,
    UNKNOWN,
    new_figure,
)
from tensegrity_codegen.report.pictures.drawing import (
    StructureDrawing,
    draw_frame,
    find_tension_limit,
    picture_size,
)
from tensegrity_codegen.report.pictures.marks import choose_unit
from tensegrity_codegen.report.pictures.panel import add_color_bar, add_key, name_scale, set_up
from tensegrity_codegen.report.pictures.shown import show_structure
from tensegrity_codegen.report.pictures.view import PictureChoices, View, find_box, fit_view
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# The colours of a page in light and in dark: each colour of the palette under a name of its own.
#
# Pictures are drawn in the light colours; in a page these become CSS variables, so that a picture follows
# the reader's choice of light or dark with everything else.


@dataclass(frozen=True)
class ThemeColor:
    """A colour: its CSS name, and its value on a light and on a dark page."""

    name: str
    light: str
    dark: str


# The lines of diagrams on dark, in the hues of SEQUENCE.
_SEQUENCE_DARK = ("#56b0ea", "#f28e45", "#34c99c", "#9560ff", "#b0603a", "#dfe5ea")

THEME = (
    ThemeColor("ink", INK, "#e6eaee"),
    ThemeColor("muted", MUTED, "#a3adb8"),
    ThemeColor("grid", GRID, "#38424d"),
    ThemeColor("paper", PAPER, "#14181d"),
    ThemeColor("bar", BAR, "#a9bfd6"),
    ThemeColor("unknown", UNKNOWN, "#d8c67c"),
    *(
        ThemeColor(f"line-{index}", light, dark)
        for index, (light, dark) in enumerate(zip(SEQUENCE, _SEQUENCE_DARK, strict=True))
    ),
    # Of words and boxes.
    ThemeColor("card", "#f5f7f9", "#1c2228"),
    ThemeColor("good", "#00694c", "#4fd3aa"),
    ThemeColor("bad", "#a84300", "#ff9d5c"),
    ThemeColor("new", "#00578a", "#7cc4f5"),
)

_STYLE = re.compile(r'style="[^"]*"')
_HEX = re.compile(r"#[0-9a-f]{6}\b")
# Of colours turned to their opposite: white becomes almost the paper of a dark page.
_INVERTED = 0.92


def use_variables(svg: str) -> str:
    """Return SVG text whose colours follow the page: variables of the theme, or a pair for light and dark."""
    for color in THEME:
        svg = svg.replace(color.light, f"var(--{color.name})")
    return _STYLE.sub(lambda style: _HEX.sub(_pair, style[0]), svg)


def find_dark_color(color: str) -> str:
    """Return a colour #rrggbb of a scale as it is shown on dark: of the same hue, dark made light.

    The same as `filter: invert(0.92) hue-rotate(180deg)` of CSS, by which the page shows rasters on dark.
    """
    channels = [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    turned = [_INVERTED + (1.0 - 2.0 * _INVERTED) * value for value in channels]
    grey = 0.213 * turned[0] + 0.715 * turned[1] + 0.072 * turned[2]
    # Half a turn of the hue at the same grey: the matrix of hue-rotate for 180 degrees.
    rotated = [2.0 * grey - value for value in turned]
    return "#" + "".join(f"{round(255 * min(max(value, 0.0), 1.0)):02x}" for value in rotated)


def _pair(match: re.Match[str]) -> str:
    return f"light-dark({match[0]}, {find_dark_color(match[0])})"


# Bytes of SVG above which a picture becomes a PNG.
MAX_SVG = 200_000
# Pixels a CSS inch, and pixels of a PNG for each of them, for screens of high resolution.
CSS_DPI, PNG_SCALE = 96, 2


@dataclass(frozen=True)
class Picture:
    """A picture without anything outside it: exactly one of svg and png (a data URL) is not empty.

    width, height: the size it was drawn for [px of CSS].
    """

    width: int
    height: int
    svg: str = ""
    png: str = ""


def draw_picture(figure: "Figure", name: str, *, most_svg: int = MAX_SVG) -> Picture:
    """Return a figure as a picture; `name` starts every id in it, so that two pictures share a page.

    SVG text stays text and colours of the palette become CSS variables; above most_svg bytes it is a PNG.
    """
    inches = figure.get_size_inches()
    width, height = (round(float(size) * CSS_DPI) for size in inches)
    svg = _inline_svg(_save(figure, "svg"), name)
    if len(svg) <= most_svg:
        return Picture(width, height, svg=svg)
    figure.set_facecolor(PAPER)
    png = base64.b64encode(_save(figure, "png")).decode("ascii")
    return Picture(width, height, png=f"data:image/png;base64,{png}")


def _save(figure: "Figure", kind: str) -> bytes:
    """Return the file of the figure; the same figure gives the same bytes."""
    matplotlib = import_extra("matplotlib")
    buffer = io.BytesIO()
    vector = kind == "svg"
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}):
        figure.savefig(
            buffer,
            format=kind,
            dpi=CSS_DPI * PNG_SCALE,
            facecolor="none" if vector else PAPER,
            metadata={"Date": None, "Creator": None} if vector else None,
        )
    return buffer.getvalue()


def _inline_svg(content: bytes, name: str) -> str:
    """Return the <svg> element alone: no prologue, no fixed size, own ids, theme colours, page fonts."""
    svg = content.decode("utf-8")
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    head, end, body = svg.partition(">")
    head = re.sub(r'\s(?:width|height|version)="[^"]*"', "", head)
    svg = f'{head} aria-hidden="true"{end}{body}'
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    svg = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font: \1 var(--font)", svg)
    svg = re.sub(r"(?<=>)[^<>]+_[^<>]+(?=</text>)", _lower, svg)
    return use_variables(svg)


def _lower(match: re.Match[str]) -> str:
    return lower_indices(match[0], '<tspan baseline-shift="sub" font-size="75%">', "</tspan>")


SHOWN = 0.16  # largest displacement in a picture, over the longest side of the structure
AREA = 11.0  # of a picture's panel [in2]


def draw_tensions(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray,
    name: str,
    *,
    among: tuple[FloatArray, FloatArray] | None = None,
    shadow: FloatArray | None = None,
) -> "Figure":
    """Return a picture of the structure at position (n_nodes, 3) [m], coloured by tensions (n_members,).

    name: of the tensions, with their unit; among: positions (n, n_nodes, 3) and tensions (n, n_members) that
    pictures of the same view and colours show; shadow (n_nodes, 3) [m]: drawn dotted.
    """
    positions, tensions = (position, tension) if among is None else among
    limit = find_tension_limit(tensions)
    frame = positions.reshape(-1, *position.shape)[0]
    figure, axes, view = _new_panel(structure, positions, frame, with_bar=limit is not None)
    if shadow is not None:
        _add_shadow(axes, view.project(shadow)[0][structure.strands.ends])
    drawing = StructureDrawing(axes, structure, view, tension_limit=limit)
    drawing.show(position, tension)
    if drawing.mappable is not None:
        add_color_bar(figure, axes, drawing.mappable, **name_scale(name, choose_unit(limit or 0.0)))
    _explain(figure, structure, position, tension, drawing)
    return figure


def draw_motion(
    structure: Structure, position: FloatArray, motion: FloatArray, among: FloatArray | None = None
) -> "Figure":
    """Return a picture of the structure moved along displacements (n_nodes, 3), enlarged to be seen.

    among (n_nodes, 3, n): displacements that pictures of the same view and scale show.
    """
    motions = np.moveaxis(motion[..., None] if among is None else among, -1, 0)
    moved, *shifted = (position + _enlarge(shown, position) for shown in (motion, *motions))
    figure, axes, view = _new_panel(structure, np.stack([position, *shifted]), position, with_bar=False)
    _add_shadow(axes, view.project(position)[0][structure.strands.ends])
    drawing = StructureDrawing(axes, structure, view)
    drawing.show(moved, np.ones(structure.n_members))  # no cable is shown as slack
    _explain(figure, structure, moved, None, drawing)
    return figure


def _enlarge(motion: FloatArray, position: FloatArray) -> FloatArray:
    """Return displacements (n_nodes, 3) [m] whose largest is seen."""
    largest = float(np.linalg.norm(motion, axis=1).max(initial=0.0))
    side = float(np.ptp(position, axis=0).max(initial=0.0))
    return motion * (SHOWN * side / largest if largest else 0.0)


def _explain(
    figure: "Figure",
    structure: Structure,
    position: FloatArray,
    tension: FloatArray | None,
    drawing: StructureDrawing,
) -> None:
    """Add the legend of pictures of `show`, without forces."""
    shown = show_structure(structure, position, tension, load=np.zeros((structure.n_nodes, 3)))
    setting = set_up(shown, PictureChoices(forces=False))
    add_key(figure, setting, slack=bool(drawing.slack.any()))


def _new_panel(
    structure: Structure,
    positions: FloatArray,
    frame: FloatArray,
    *,
    with_bar: bool,
    dpi: float = PICTURE_DPI,
) -> "tuple[Figure, Any, View]":
    """Return a new figure with axes that hold all places (..., 3) [m], and the view that suits `first`."""
    box = find_box(positions, structure.axes)
    view = fit_view(structure, box, frame)
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
    positions = np.concatenate([position, planned])
    figure, axes, view = _new_panel(
        structure, positions, position[0], with_bar=limit is not None, dpi=CSS_DPI
    )
    shadow = _add_shadow(axes, [])
    clock = axes.text(0.98, 0.98, "", transform=axes.transAxes, ha="right", va="top", fontsize=10, color=INK)
    drawing = StructureDrawing(axes, structure, view, tension_limit=limit)
    if drawing.mappable is not None:
        add_color_bar(
            figure, axes, drawing.mappable, **name_scale("member tension [N]", choose_unit(limit or 0.0))
        )
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # one layout for all pictures; to find it takes longer than to draw

    def paint() -> Iterator[NDArray[np.uint8]]:
        canvas: Any = figure.canvas
        for k in range(len(time)):
            drawing.show(position[k], tension[k])
            projected, _ = view.project(planned[k])
            shadow.set_segments(list(projected[structure.strands.ends]))
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


def _add_shadow(axes: Any, segments: Any) -> Any:
    """Add dotted lines."""
    from matplotlib.collections import LineCollection

    shadow = LineCollection(list(segments), colors=MUTED, linewidths=0.9, linestyles="dotted", zorder=2)
    axes.add_collection(shadow, autolim=False)
    return shadow
