"""One panel of a picture: axes, structure, arrows and names of a sample; fixed, or moving with the nodes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.pictures.canvas import (
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
from tensegrity_codegen.report.pictures.drawing import (
    BAR_WIDTH,
    CABLE_WIDTH,
    DASHES,
    BodyParts,
    StructureDrawing,
    draw_frame,
    draw_plane,
    find_tension_limit,
    panel_extent,
    picture_size,
)
from tensegrity_codegen.report.pictures.marks import (
    Arrows,
    ForceArrows,
    NameWriter,
    Unit,
    choose_names,
    choose_unit,
    describe_arrows,
    lay_out_arrows,
)
from tensegrity_codegen.report.pictures.shown import COLOR_NAMES, Shown, compute_colors
from tensegrity_codegen.report.pictures.view import (
    Box,
    PerspectiveView,
    PictureChoices,
    View,
    choose_view,
    find_box,
)
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure, SubFigure

PICTURE_DPI = 150
SHAPES = 50  # samples of a motion whose bodies must be in the picture
MIN_WIDTH, MIN_HEIGHT = 3.4, 2.8  # of a figure [in], for its texts


@dataclass(frozen=True)
class Setting:
    """The settings that all samples of a picture share.

    shown: the content.
    choices: how.
    box, view: axes and view of the first sample, or of all where the axes stand still.
    step (n_t, 3) [m]: how far box and view move at each sample.
    arrows: loads and reactions.
    color (n_t, n_members): the values of the colours.
    limit: end of the scale of colours.
    """

    shown: Shown
    choices: PictureChoices
    box: Box
    view: View
    step: FloatArray
    arrows: list[Arrows]
    color: FloatArray | None
    limit: float | None

    @property
    def scale(self) -> dict[str, Any]:
        """Name of the scale of colours and its unit, for `add_color_bar`."""
        return name_scale(COLOR_NAMES.get(self.choices.color, ("", ""))[0], self.unit)

    @property
    def unit(self) -> Unit:
        """Unit of all forces: that of the scale of tensions, else that of the largest arrow."""
        scale = self.limit if self.choices.color == "tension" else None
        return choose_unit(scale or max((arrow_set.largest for arrow_set in self.arrows), default=0.0))

    @property
    def has_unknown(self) -> bool:
        """Whether the colour of a member, edges of bodies aside, is unknown."""
        if self.color is None:
            return False
        return bool((np.isnan(self.color) & ~self.shown.parts.edge).any())


def set_up(shown: Shown, choices: PictureChoices) -> Setting:
    """Return axes, view, arrows and colours of a picture."""
    structure, position = shown.structure, shown.position
    color = compute_colors(shown, choices.color)
    arrows = []
    if choices.forces:
        arrows = lay_out_arrows(
            structure, position, shown.tension, shown.load, shown.parts.joints, shown.contact
        )
    step = np.zeros((len(position), 3))
    if choices.follow:
        center = position.mean(axis=1)
        step = center - center[0]
    relative = position - step[:, None]
    ends = [end - step[:, None] for arrow_set in arrows for end in (arrow_set.tail, arrow_set.tip)]
    beyond = np.concatenate([end.reshape(-1, 3) for end in ends]) if ends else np.zeros((0, 3))
    beyond = beyond[np.isfinite(beyond).all(axis=1)]
    if shown.parts.mesh is not None:
        rows = range(0, len(position), max(1, len(position) // SHAPES))
        surfaces = [shown.parts.mesh.compute_places(position[k]) - step[k] for k in rows]
        relative = np.concatenate([relative.reshape(-1, 3), *surfaces])
    if structure.ground is not None:
        relative = np.concatenate([relative.reshape(-1, 3), _find_footprint(structure.ground, relative)])
    is_flat = len(structure.axes) < 3 or (choices.view is not None and choices.view.is_along_axis)
    if is_flat:
        box = find_box(np.concatenate([relative.reshape(-1, 3), beyond]), structure.axes[:2])
    else:
        box = replace(find_box(relative, structure.axes), beyond=_find_extremes(beyond))
    view = choose_view(structure, box, position[0], choices.view)
    limit = find_tension_limit(color)
    if limit is not None and choices.color == "tension" and limit < _find_rounding(structure):
        limit = None
    return Setting(shown, choices, box, view, step, arrows, color, limit)


def _find_footprint(ground: Ground, positions: FloatArray) -> FloatArray:
    """Return the places (..., 3) along the normal on the plane of a ground, none if that is far below."""
    flat = positions.reshape(-1, 3)
    height = flat @ ground.normal - ground.offset
    is_near = bool(height.min() <= 2.0 * np.ptp(flat, axis=0).max())
    return flat - height[:, None] * ground.normal if is_near else flat[:0]


def _find_rounding(structure: Structure) -> float:
    """Return the tension that rounding of lengths explains [N]."""
    extent = float(np.abs(structure.node_position).max(initial=0.0))
    stiff = float(np.asarray(structure.mu).max(initial=0.0))
    return 8 * float(np.finfo(float).eps) * stiff * (extent + float(structure.rest_length.max(initial=0.0)))


def _find_extremes(points: FloatArray) -> FloatArray | None:
    """Return the points themselves, of very many the corners of their box, (n, 3); None for none."""
    if not len(points):
        return None
    if len(points) <= 1000:
        return points
    low, high = points.min(axis=0), points.max(axis=0)
    return Box(low, high, high - low).corners()


def fit_size(
    setting: Setting, *, area: float, dpi: int, is_vector: bool = False
) -> tuple[float, float, float]:
    """Return width and height [in] and dots an inch of a picture.

    Without a chosen size the panel takes about `area` [in2] at `dpi`. A chosen size in pixels keeps texts in
    proportion to it; files of lines (is_vector) have PICTURE_DPI pixels an inch.
    """
    width, height = picture_size(setting.view, setting.box, with_bar=setting.limit is not None, area=area)
    size = setting.choices.size
    if size is None:
        return width, height, dpi
    if is_vector:
        return size[0] / PICTURE_DPI, size[1] / PICTURE_DPI, PICTURE_DPI
    dots = np.sqrt(size[0] * size[1] / (width * height))
    dots = min(dots, size[0] / MIN_WIDTH, size[1] / MIN_HEIGHT)
    return size[0] / dots, size[1] / dots, float(dots)


class Panel:
    """Axes with a structure; `show` draws a sample. Names stand where they cover least of sample `first`."""

    def __init__(
        self,
        axes: "Axes",
        setting: Setting,
        inches: tuple[float, float],
        *,
        line_scale: float = 1.0,
        start: int = 0,
    ) -> None:
        shown, choices = setting.shown, setting.choices
        self.axes, self.setting = axes, setting
        self._frame: list[Any] = []
        self.is_moving = bool(setting.step.any())
        self._draw_frame(setting.view, setting.box)
        self.drawing = StructureDrawing(
            axes, shown.structure, setting.view, tension_limit=setting.limit, line_scale=line_scale,
            parts=shown.parts,
        )  # fmt: skip
        self.arrows = [
            ForceArrows(axes, setting.view, arrow_set, line_scale=line_scale) for arrow_set in setting.arrows
        ]
        named = hide_bodies(shown.structure)
        written, _ = choose_names(named, choices.labels)
        low, high = panel_extent(setting.view, setting.box)
        point = float(np.max((high - low) / np.maximum(inches, 1.0))) / 72
        self.names = NameWriter(
            axes, named, setting.view, written, point,
            [(arrow_set.tail[start], arrow_set.tip[start]) for arrow_set in setting.arrows],
            [artist for artist in self._frame if hasattr(artist, "xyann") and artist.get_text()],
        )  # fmt: skip

    @property
    def artists(self) -> tuple[Any, ...]:
        """Everything that `show` changes, besides the axes that move."""
        arrows = (artist for arrow_set in self.arrows for artist in arrow_set.artists)
        return (*self.drawing.artists, *arrows, *self.names.artists)

    def show(self, sample: int) -> None:
        """Draw a sample."""
        setting = self.setting
        if self.is_moving:
            self._move(setting.step[sample])
        tension = None if setting.shown.tension is None else setting.shown.tension[sample]
        color = None if setting.color is None else setting.color[sample]
        self.drawing.show(setting.shown.position[sample], tension, color)
        for arrow_set in self.arrows:
            arrow_set.show(sample)
        self.names.show(setting.shown.position[sample])

    def _move(self, step: FloatArray) -> None:
        """Move the axes with the nodes; the grid stays where it is."""
        view = self.setting.view
        if isinstance(view, PerspectiveView):
            view = replace(view, center=view.center + step)
        self.drawing.view = self.names.view = view
        for arrow_set in self.arrows:
            arrow_set.view = view
        self._draw_frame(view, self.setting.box.moved(step))

    def _draw_frame(self, view: View, box: Box) -> None:
        for artist in self._frame:
            artist.remove()
        before = set(self.axes.get_children())
        draw_frame(self.axes, view, box)
        ground = self.setting.shown.structure.ground
        if ground is not None:
            draw_plane(self.axes, view, box, ground)
        self._frame = [artist for artist in self.axes.get_children() if artist not in before]


TEXT_SIZE = 9.0
ROOM = 0.8  # part of a figure's height that a scale may have beside it
ARROW = {"marker": ">", "markersize": 6.0, "markevery": [1]}


def describe_size(structure: Structure, bodies: BodyParts | None = None) -> str:
    """Return the numbers of nodes, rigid bodies, bars and cables in words."""
    bodies = BodyParts.of(structure) if bodies is None else bodies
    bars = int((structure.is_bar & ~bodies.edge).sum())
    cables = int((~structure.is_bar).sum())
    amounts = {
        "node": int((~structure.is_corner).sum()),
        "rigid body": bodies.count,
        "bar": bars,
        "cable": cables,
    }
    plural = {"rigid body": "rigid bodies"}
    counts = {noun: count for noun, count in amounts.items() if count}
    return ", ".join(describe_count(count, noun, plural.get(noun, "")) for noun, count in counts.items())


def add_key(figure: "Figure | SubFigure", setting: Setting, *, slack: bool) -> None:
    """Explain below the panels the kinds of lines and marks that occur; slack: whether a cable is slack."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import Normal, Stroke

    def line(color: str, width: float, name: str, **options: Any) -> Line2D:
        return Line2D([], [], color=color, linewidth=width, label=name, **options)

    structure, bodies, colored = setting.shown.structure, setting.shown.parts, setting.limit is not None
    handles = []
    if (structure.is_bar & ~bodies.edge).any():
        handles.append(line(MUTED if colored else BAR, BAR_WIDTH, "bar", solid_capstyle="round"))
    if not structure.is_bar.all():
        handles.append(line(MUTED if colored else CABLE, CABLE_WIDTH, "cable"))
    if bodies.edge.any():
        handles.append(line(BODY, BAR_WIDTH, "rigid body", solid_capstyle="round"))
    if slack:
        handles.append(line(SLACK, CABLE_WIDTH, "slack cable", linestyle=DASHES))
    if colored and setting.has_unknown:
        unknown = COLOR_NAMES[setting.choices.color][1]
        rim = [Stroke(linewidth=BAR_WIDTH + 1.5, foreground=MUTED), Normal()]
        handles.append(line(UNKNOWN, BAR_WIDTH, unknown, path_effects=rim))
    held = structure.node_anchored[:, list(structure.axes)]
    fully, partly = held.all(axis=1), held.any(axis=1) & ~held.all(axis=1)
    for chosen, fill, name in ((fully, INK, "anchor"), (partly, PAPER, "anchor on some axes")):
        if chosen.any():
            mark = {"marker": "^", "markerfacecolor": fill, "markeredgecolor": INK, "markersize": 7.5}
            handles.append(line("none", 0.0, name, **mark))
    # Lines on arrows; with the colour "none" text alone
    for color, text in describe_arrows(setting.arrows, setting.unit):
        handles.append(line(color, 1.9, text, **(ARROW if color != "none" else {})))
    # As many columns as fit side by side: each is as wide as its longest text, and a figure has about 13
    # letters an inch.
    longest = max((len(str(handle.get_label())) for handle in handles), default=1) + 7
    letters = int(13.0 * figure.bbox.width / figure.dpi)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=int(np.clip(letters // longest, 1, 5)),
        frameon=False, fontsize=TEXT_SIZE, labelcolor=INK, handlelength=2.2, columnspacing=1.8,
    )  # fmt: skip


def name_scale(name: str, unit: Unit) -> dict[str, Any]:
    """Return a name that may end in "[N]" with this unit of forces, and its size, for `add_color_bar`."""
    return {"name": name.replace("[N]", f"[{unit[0]}]"), "unit": unit[1] if name.endswith("[N]") else 1.0}


def add_color_bar(
    figure: "Figure | SubFigure",
    panels: "Axes | Sequence[Axes]",
    mappable: "ScalarMappable",
    *,
    below: bool = False,
    name: str = "member tension [N]",
    unit: float = 1.0,
) -> None:
    """Add the scale of member tensions, with their name, beside the panels or below them; unit [N]."""
    bar = figure.colorbar(
        mappable, ax=panels, location="bottom" if below else "right", shrink=0.7,
        aspect=30 if below else 26, pad=0.03, panchor=False,
        format=None if unit == 1.0 else lambda value, _: f"{value / unit:g}".replace("-", "\N{MINUS SIGN}"),
    )  # fmt: skip
    text = f"{name}  (compression < 0 < tension)"
    length = (figure.bbox.width if below else ROOM * figure.bbox.height) / figure.dpi
    fits = 0.6 * TEXT_SIZE * len(text) / 72 < length
    bar.set_label(text if fits else name, fontsize=TEXT_SIZE, color=INK)
    bar.ax.tick_params(labelsize=TEXT_SIZE - 1, colors=MUTED, length=2)
    bar.outline.set_edgecolor(GRID)
