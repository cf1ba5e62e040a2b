"""A structure as lines on paper, near members over far ones, and its frame.

The frame is a ground grid with rulers in perspective, or plain axes in a plane.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.report.pictures.canvas import (
    BAR,
    BODY,
    CABLE,
    GRID,
    INK,
    MUTED,
    NODE,
    PAPER,
    SLACK,
    SOIL,
    UNKNOWN,
    build_tension_colormap,
)
from tensegrity_codegen.report.pictures.marks import draw_anchors, find_crowd_scale, group_anchors
from tensegrity_codegen.report.pictures.view import Box, PerspectiveView, PlanarView, View
from tensegrity_codegen.structure.bodies import BodySystem, RigidBody
from tensegrity_codegen.structure.body_meshes import BodyMesh, build_mesh
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.outline import find_faces, find_joints, is_edge
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable


# Line widths in points for a structure of a few dozen members.
BAR_WIDTH = 5.0
CABLE_WIDTH = 1.7
NODE_WIDTH = 5.2
LEAST_PIXELS = 2.0  # of a line, of a bar half as much again
CROWD = 400  # members above which lines may get thinner, so that they do not run together
# How much wider or narrower than usual a member of another class may be.
THICKNESS = (0.7, 1.6)
# The white rim that parts a member from those behind it: its width, and how far it stops before the ends.
RIM = 2.2
RIM_GAP = 0.1
# How strongly line widths follow the perspective.
WIDTH_DEPTH = 2.0
DASHES = (0.0, (2.2, 2.6))
# A dark outline: the fill colour times this.
OUTLINE = 0.55
FACE_ALPHA = 0.13  # of the faces of rigid bodies
LIGHT = np.array([-0.35, 0.6, 0.72])  # unit vector to the light, on paper and towards the eye


@dataclass(frozen=True)
class BodyParts:
    """The members and nodes of an outline that belong to rigid bodies.

    edge (n_members,): their edges; faces (n_faces, 3): triangles of nodes; count: number of rigid bodies;
    joints: nodes that hold bars, whose forces are unknown; mesh: surfaces of bodies beside nodes, whose edges
    and corners are not drawn.
    """

    edge: BoolArray
    faces: NDArray[np.int64]
    count: int = 0
    joints: NDArray[np.int64] | None = None
    mesh: BodyMesh | None = None

    @classmethod
    def of(cls, subject: Structure | BodySystem) -> "BodyParts":
        """Return the parts of the outline of a structure or of bodies."""
        free = subject.bodies if isinstance(subject, Structure) else ()
        bodies = () if isinstance(subject, Structure) else subject.bodies
        faces = np.array(find_faces(subject), dtype=np.int64).reshape(-1, 3)
        count = len(free) + sum(isinstance(body, RigidBody) for body in bodies)
        mesh = build_mesh(free) if free else None
        return cls(is_edge(subject), faces, count, find_joints(subject), mesh)


def find_slack(structure: Structure, node_position: FloatArray, tension: FloatArray | None) -> BoolArray:
    """Return which members (n_members,) are slack: tension-only ones that carry none and are not just taut.

    node_position (n_nodes, 3) [m], tension (n_members,) [N]; without tensions those cables are slack that
    are shorter than their stated rest length.
    """
    length = structure.strands.lengths(node_position)
    excess, noise = length - structure.rest_length, 1e-9 * structure.rest_length
    loose = excess < -noise if tension is None else (tension <= 0) & (np.abs(excess) > noise)
    slack: BoolArray = structure.tension_only & loose
    return slack


def find_thickness(structure: Structure) -> FloatArray:
    """Return the width of each member over the usual one of its kind, (n_members,), from its section."""
    factor = np.ones(structure.n_members)
    for kind in (True, False):
        rows = structure.is_bar == kind
        for size in (structure.section_area, structure.mu * structure.rest_length):
            if rows.any() and (size[rows] > 0).all():
                factor[rows] = np.clip(np.sqrt(size[rows] / np.median(size[rows])), *THICKNESS)
                break
    return factor


def find_tension_limit(tension: FloatArray | None) -> float | None:
    """Return the largest known |tension| [N] of (..., n_members), None if there is none."""
    largest = 0.0 if tension is None else float(np.nanmax(np.abs(tension), initial=0.0))
    return largest if largest > 0 else None


class StructureDrawing:
    """The lines and marks of one structure on one panel; `show` moves and recolours them.

    Members and nodes are painted in the order of their depth, each over a white rim. tension_limit: the
    colour scale runs from -limit to limit, in the unit of the colours that `show` takes; None colours bars
    and cables by kind. line_scale multiplies all widths. parts: which members are edges of rigid bodies, and
    their faces.
    """

    def __init__(
        self,
        axes: "Axes",
        structure: Structure,
        view: View,
        *,
        tension_limit: float | None = None,
        line_scale: float = 1.0,
        parts: BodyParts | None = None,
    ) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self._structure, self.view = structure, view
        self._parts = BodyParts.of(structure) if parts is None else parts
        self._scale = line_scale * find_crowd_scale(structure, 0.18)  # so that members do not run together
        pixel = 72.0 / axes.figure.dpi if structure.n_members <= CROWD else 0.0
        usual = np.where(structure.is_bar, BAR_WIDTH, CABLE_WIDTH) * self._scale
        least = np.where(structure.is_bar, 1.5, 1.0) * LEAST_PIXELS * pixel
        self._width = np.maximum(usual * find_thickness(structure), least)
        self._least = least
        self.mappable = None if tension_limit is None else _scale_of(tension_limit)
        self.slack = np.zeros(structure.n_members, dtype=bool)
        self._anchors = [
            (chosen, draw_anchors(axes, fill, hangs, self._scale))
            for chosen, fill, hangs in group_anchors(structure, view)
        ]
        self._lines = LineCollection([], zorder=3, capstyle="round", clip_on=False)
        axes.add_collection(self._lines, autolim=False)
        self._faces = PolyCollection(
            [], facecolors=BODY, alpha=FACE_ALPHA, linewidths=0, zorder=2.8, clip_on=False
        )
        axes.add_collection(self._faces, autolim=False)
        self._surfaces = PolyCollection([], linewidths=0.4, zorder=2.9, clip_on=False)
        axes.add_collection(self._surfaces, autolim=False)
        self._strands = np.flatnonzero(~structure.is_edge[structure.strands.member])
        self._dots = np.flatnonzero(~structure.is_corner)
        self._nodes = axes.scatter(
            [], [], facecolor=NODE, edgecolor=INK, linewidth=1.1 * self._scale, zorder=4, clip_on=False
        )

    @property
    def artists(self) -> tuple[Any, ...]:
        """Everything that `show` changes, in painting order."""
        return (*(marks for _, marks in self._anchors), self._faces, self._surfaces, self._lines, self._nodes)

    def show(
        self, node_position: FloatArray, tension: FloatArray | None = None, color: FloatArray | None = None
    ) -> None:
        """Draw the structure at node_position (n_nodes, 3) [m] with member tensions (n_members,) [N].

        color (n_members,): the values of the colours, by default the tensions; NaN is drawn as unknown.
        """
        color = tension if color is None else color
        self.slack = find_slack(self._structure, node_position, tension)
        projected, depth = self.view.project(node_position)
        pair, member = self._structure.strands.ends, self._structure.strands.member
        order = self._strands[np.argsort(depth[pair].mean(axis=1)[self._strands], kind="stable")]
        nearness = self.view.magnification(depth) ** WIDTH_DEPTH
        segments, widths, colors = self._strokes(projected[pair], nearness[pair].mean(axis=1), color)
        self._lines.set_segments(list(segments[order].reshape(-1, 2, 2)))
        # The styles of rim, outline and fill in turn; a slack cable has a dashed fill only
        dashed = self.slack[member[order]]
        solid: Any = "solid"
        styles: list[Any] = []
        for is_dashed in dashed:
            styles += [solid, DASHES, DASHES] if is_dashed else [solid, solid, solid]
        self._lines.set(
            linewidths=widths[order].ravel(), linestyles=styles, colors=colors[order].reshape(-1, 4)
        )
        self._faces.set_verts(list(projected[self._parts.faces]))
        if self._parts.mesh is not None:
            self._show_surfaces(self._parts.mesh, node_position)
        order = self._dots[np.argsort(depth[self._dots], kind="stable")]
        self._nodes.set_offsets(projected[order])
        self._nodes.set_sizes((self._scale * NODE_WIDTH * nearness[order]) ** 2)
        for chosen, marks in self._anchors:
            marks.set_data(*projected[chosen].T)

    def _show_surfaces(self, mesh: BodyMesh, node_position: FloatArray) -> None:
        """Draw the surfaces of bodies that face the observer, far ones first, lit from the upper left."""
        projected, depth = self.view.project(mesh.compute_places(node_position))
        spot = np.concatenate([projected, depth[:, None]], axis=1)[mesh.triangle]
        normal = np.cross(spot[:, 1] - spot[:, 0], spot[:, 2] - spot[:, 0])
        order = np.argsort(spot[..., 2].mean(axis=1), kind="stable")
        order = order[normal[order, 2] > 0]
        lit = normal[order] @ LIGHT / np.linalg.norm(normal[order], axis=1)
        fill = np.ones((len(order), 4))
        fill[:, :3] = np.clip(_rgba(BODY)[:3] * (0.75 + 0.55 * np.clip(lit, 0.0, 1.0))[:, None], 0.0, 1.0)
        self._surfaces.set(verts=list(spot[order, :, :2]), facecolors=fill, edgecolors=fill)

    def _strokes(
        self, ends: FloatArray, nearness: FloatArray, color: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rim, outline and fill of each strand of members.

        Segments (n_strands, 3, 2, 2), widths (n_strands, 3) and colours (n_strands, 3, 4).
        """
        member = self._structure.strands.member
        bar = self._structure.is_bar[member]
        width = np.maximum(self._width[member] * nearness, self._least[member])
        inner = np.where(bar, width - 1.5 * self._scale, width)
        along = ends[:, 1] - ends[:, 0]
        rim = np.stack([ends[:, 0] + RIM_GAP * along, ends[:, 1] - RIM_GAP * along], axis=1)
        fill = self._fill(color)[member]
        outline = fill.copy()
        outline[bar, :3] *= OUTLINE
        white = np.broadcast_to(_rgba(PAPER), fill.shape)
        return (
            np.stack([rim, ends, ends], axis=1),
            np.stack([width + RIM * self._scale, width, inner], axis=1),
            np.stack([white, outline, fill], axis=1),
        )

    def _fill(self, color: FloatArray | None) -> FloatArray:
        """Return the colour of each member, (n_members, 4)."""
        if self.mappable is not None and color is not None:
            fill = np.array(self.mappable.to_rgba(np.nan_to_num(color)), dtype=float)
            fill[np.isnan(color)] = _rgba(UNKNOWN)
        else:
            fill = np.where(self._structure.is_bar[:, None], _rgba(BAR), _rgba(CABLE))
        fill[self._parts.edge] = _rgba(BODY)
        fill[self.slack] = _rgba(SLACK)
        return fill


def _scale_of(limit: float) -> "ScalarMappable":
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-limit, limit), build_tension_colormap())


def _rgba(color: str) -> FloatArray:
    from matplotlib.colors import to_rgba

    return np.array(to_rgba(color))


TICK_SIZE = 8.0
NAME_SIZE = 9.0
# Numbers nearer to one another than this part of the panel give way to the first and the last.
LABEL_SPACE = 0.055
LABEL_INCHES = 0.3  # the same in inches, of small panels
LETTERS = 4.5  # of a number that takes this part; longer ones take more
# Rulers shorter than this part of the panel have no numbers.
SHORT = 0.1
# From this part of a unit vector on, what stands off a ruler stands beside it, not below or above.
BESIDE = 0.2


@dataclass(frozen=True)
class _Side:
    """Where texts stand off a ruler: offset of numbers in points, their alignment, the outward sign of x."""

    offset: tuple[float, float]
    align: tuple[str, str]
    sign: float


def panel_extent(view: View, box: Box) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right (2,) [m] of all that the panel must show on paper."""
    projected, _ = view.project(box.shown())
    return projected.min(axis=0), projected.max(axis=0)


def panel_ratio(view: View, box: Box) -> float:
    """Return width / height of the panel, from 1/5 to 5."""
    low, high = panel_extent(view, box)
    wide, tall = high - low
    return float(np.clip(wide / tall, 0.2, 5.0))


def picture_size(view: View, box: Box, *, with_bar: bool, area: float = 26.0) -> tuple[float, float]:
    """Return width and height [in] of a picture in which the panel takes about `area` [in2]."""
    ratio = panel_ratio(view, box)
    width = float(np.clip(np.sqrt(area * ratio), 3.2, 9.0))
    height = float(np.clip(width / ratio, 2.2, 7.0))
    # Room for rulers, colour bar, heading and legend.
    return round(max(min(width, height * ratio) + 1.2, 4.2) + 1.1 * with_bar, 2), round(height + 1.5, 2)


def draw_frame(axes: "Axes", view: View, box: Box) -> None:
    """Draw rulers in metres around the box and fix the limits, equally scaled on all axes."""
    low, high = panel_extent(view, box)
    axes.set_aspect("equal", adjustable="box")
    axes.set_facecolor(PAPER)
    if isinstance(view, PerspectiveView):
        axes.set_axis_off()
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        _draw_ground(axes, view, box)
        _draw_rulers(axes, view, box)
    elif isinstance(view, PlanarView):
        _draw_plane(axes, view, box)


def _draw_plane(axes: "Axes", view: PlanarView, box: Box) -> None:
    horizontal, vertical = view.axes
    margin = 0.3 * float(np.max(box.step[[horizontal, vertical]]))
    axes.set_xlim(box.low[horizontal] - margin, box.high[horizontal] + margin)
    axes.set_ylim(box.low[vertical] - margin, box.high[vertical] + margin)
    axes.set_xticks(box.ticks(horizontal))
    axes.set_yticks(box.ticks(vertical))
    axes.set_xticklabels(_numbers(box.ticks(horizontal), box.step[horizontal]))
    axes.set_yticklabels(_numbers(box.ticks(vertical), box.step[vertical]))
    axes.set_xlabel(f"{'xyz'[horizontal]} [m]", fontsize=NAME_SIZE, color=INK)
    axes.set_ylabel(f"{'xyz'[vertical]} [m]", fontsize=NAME_SIZE, color=INK)
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TICK_SIZE, colors=MUTED, length=0)
    for spine in axes.spines.values():
        spine.set_color(GRID)


def _draw_ground(axes: "Axes", view: View, box: Box) -> None:
    """Draw the grid of the lowest face, one cell a step."""
    from matplotlib.collections import LineCollection

    (x0, y0, z0), (x1, y1, _) = box.low, box.high
    lines = [[(x, y0, z0), (x, y1, z0)] for x in box.ticks(0)]
    lines += [[(x0, y, z0), (x1, y, z0)] for y in box.ticks(1)]
    projected, _ = view.project(lines)
    axes.add_collection(
        LineCollection(list(projected), colors=GRID, linewidths=0.8, zorder=0.5, clip_on=False), autolim=False
    )


def draw_plane(axes: "Axes", view: View, box: Box, ground: Ground) -> None:
    """Draw the plane of a ground above the foot of the box, or beside it where the plane is steep."""
    from matplotlib.patches import Polygon

    up = int(np.abs(ground.normal).argmax())
    sides = [axis for axis in range(3) if axis != up]
    corners = np.zeros((4, 3))
    corners[:, sides[0]] = np.array([box.low, box.high, box.high, box.low])[:, sides[0]]
    corners[:, sides[1]] = np.array([box.low, box.low, box.high, box.high])[:, sides[1]]
    corners[:, up] = (ground.offset - corners @ ground.normal) / ground.normal[up]
    projected, _ = view.project(corners)
    axes.add_patch(Polygon(projected, facecolor=SOIL, edgecolor=MUTED, linewidth=0.8, zorder=0.4))


def _draw_rulers(axes: "Axes", view: PerspectiveView, box: Box) -> None:
    """Label the two near edges of the ground and the left upright."""
    eye = view.rotation[2]
    # From below the far edges are the lower ones on paper.
    corner = np.where((eye > -1e-9) == (eye[2] >= 0), box.high, box.low)
    bottom = float(box.low[2])
    _draw_upright(axes, view, box)
    for axis, start in ((0, [box.low[0], corner[1], bottom]), (1, [corner[0], box.low[1], bottom])):
        ticks = box.ticks(axis)
        positions = _project_ticks(view, start, axis, ticks)
        extent = panel_extent(view, box)
        if not _is_long(view, box, axis, start):
            continue
        side = _find_side(view, box, axis, start)
        texts = _numbers(ticks, box.step[axis])
        stride = _stride(axes, positions, extent, texts)
        for position, text in zip(positions[::stride], texts[::stride], strict=True):
            _write(axes, position, text, side.offset, side.align, size=TICK_SIZE, color=MUTED)
        _name_ground_ruler(axes, axis, positions, texts, side)


def _draw_upright(axes: "Axes", view: PerspectiveView, box: Box) -> None:
    """Draw the upright edge that is farthest to the left, with its numbers and name."""
    ground = [(x, y, box.low[2]) for x in (box.low[0], box.high[0]) for y in (box.low[1], box.high[1])]
    corners, _ = view.project(ground)
    low = np.array(ground[int(corners[:, 0].argmin())])
    if not _is_long(view, box, 2, low):
        return
    high = np.array([low[0], low[1], box.high[2]])
    upright, _ = view.project([low, high])
    axes.plot(upright[:, 0], upright[:, 1], color=GRID, linewidth=0.8, zorder=0.5, clip_on=False)
    ticks = box.ticks(2)
    corners, texts = _project_ticks(view, low, 2, ticks), _numbers(ticks, box.step[2])
    stride = _stride(axes, corners, panel_extent(view, box), ["0"])
    for position, text, tick in zip(corners[::stride], texts[::stride], ticks[::stride], strict=True):
        # The lowest number gives way to the first one of the ground.
        upward = "bottom" if tick - low[2] < 0.1 * box.step[2] else "center"
        _write(axes, position, text, (-6.0, 0.0), ("right", upward), size=TICK_SIZE, color=MUTED)
    _write(axes, upright[1], "z [m]", (0.0, 9.0), ("center", "bottom"), size=NAME_SIZE, color=INK)


def _project_ticks(view: View, start: ArrayLike, axis: int, ticks: FloatArray) -> FloatArray:
    """Return the places (n, 2) of the ticks of a ruler through `start` (3,)."""
    points = np.repeat(np.array([start], dtype=float), len(ticks), axis=0)
    points[:, axis] = ticks
    positions, _ = view.project(points)
    return positions


def _is_long(view: View, box: Box, axis: int, start: ArrayLike) -> bool:
    """Return whether a ruler through `start` (3,) is seen from the side, long enough for numbers."""
    ends = _project_ticks(view, start, axis, np.array([box.low[axis], box.high[axis]]))
    low, high = panel_extent(view, box)
    return float(np.linalg.norm(ends[1] - ends[0])) > SHORT * float(np.max(high - low))


def _find_side(view: View, box: Box, axis: int, start: ArrayLike) -> _Side:
    """Return where texts of a ruler of the ground stand: away from the middle of the ground."""
    ends = _project_ticks(view, start, axis, np.array([box.low[axis], box.high[axis]]))
    along = ends[1] - ends[0]
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    middle, _ = view.project([*(box.low + box.high)[:2] / 2, box.low[2]])
    if across @ (ends.mean(axis=0) - middle) < 0:
        across = -across
    upward = 1.0 if across[1] > 0 else -1.0
    if abs(across[0]) < BESIDE:
        return _Side(
            (25.0 * float(across[0]), 7.0 * upward), ("center", "bottom" if upward > 0 else "top"), 0.0
        )
    sign = 1.0 if across[0] > 0 else -1.0
    return _Side((8.0 * sign, 5.0 * upward), ("left" if sign > 0 else "right", "center"), sign)


def _stride(
    axes: "Axes", positions: FloatArray, extent: tuple[FloatArray, FloatArray], texts: list[str]
) -> int:
    """Return which multiple of the ticks at places (n, 2) gets numbers, so that they do not run together."""
    if len(positions) < 2:
        return 1
    spacing = float(np.linalg.norm(positions[-1] - positions[0])) / (len(positions) - 1)
    letters = max(1.0, max(map(len, texts)) / LETTERS)
    sides = extent[1] - extent[0]
    box = axes.get_window_extent()
    scale = float(np.min(np.array([box.width, box.height]) / sides)) / axes.figure.dpi  # inches of a metre
    min_spacing = letters * max(LABEL_SPACE * float(np.max(sides)), LABEL_INCHES / scale)
    if spacing >= min_spacing:
        return 1
    return 2 if 2 * spacing >= min_spacing and len(positions) % 2 == 1 else len(positions) - 1


def _name_ground_ruler(axes: "Axes", axis: int, positions: FloatArray, texts: list[str], side: _Side) -> None:
    """Write the name of the x or y ruler with ticks at places (n, 2), clear of its numbers."""
    x, y = side.offset
    down = 1.0 if y > 0 else -1.0
    if side.sign:
        widest = 0.6 * TICK_SIZE * max(map(len, texts))
        offset, align = (x + side.sign * (8.0 + widest), y + 5.0 * down), side.align
    else:
        offset, align = (x - 8.0, y + 9.0 * down), ("right", side.align[1])
    middle = positions[[0, -1]].mean(axis=0)
    _write(axes, middle, f"{'xyz'[axis]} [m]", offset, align, size=NAME_SIZE, color=INK)


def _write(
    axes: "Axes", position: FloatArray, text: str, offset: tuple[float, float], align: tuple[str, str], *,
    size: float, color: str,
) -> None:  # fmt: skip
    axes.annotate(
        text, (float(position[0]), float(position[1])), xytext=offset, textcoords="offset points",
        ha=align[0], va=align[1], fontsize=size, color=color, annotation_clip=False,
    )  # fmt: skip


def _numbers(ticks: FloatArray, step: float) -> list[str]:
    """Return the ticks with just the digits that the step needs."""
    if step >= 1e5 or step < 1e-4:
        return [f"{tick:.4g}" for tick in ticks]
    digits = max(0, int(-np.floor(np.log10(step * (1 + 1e-9)))))
    return [f"{tick + 0.0:.{digits}f}" for tick in ticks]
