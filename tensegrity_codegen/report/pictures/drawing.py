"""A structure as lines on paper: bars thick, cables thin, near members over far ones."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pictures.canvas import (
    BAR,
    BODY,
    CABLE,
    INK,
    NODE,
    PAPER,
    SLACK,
    UNKNOWN,
    build_tension_colormap,
)
from tensegrity_codegen.report.pictures.view import View
from tensegrity_codegen.structure.bodies import BodySystem, RigidBody
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
ANCHOR_SIZE = 21.0
# The white rim that parts a member from those behind it: its width, and how far it stops before the ends.
RIM = 2.2
RIM_GAP = 0.1
# How strongly line widths follow the perspective.
WIDTH_DEPTH = 2.0
DASHES = (0.0, (2.2, 2.6))
# A dark outline: the fill colour times this.
OUTLINE = 0.55
FACE_ALPHA = 0.13  # of the faces of rigid bodies


@dataclass(frozen=True)
class BodyParts:
    """The members and nodes of an outline that belong to rigid bodies.

    edge (n_members,): their edges; faces (n_faces, 3): triangles of nodes; count: number of rigid bodies;
    joints: nodes that hold bars, whose forces are unknown.
    """

    edge: BoolArray
    faces: NDArray[np.int64]
    count: int = 0
    joints: NDArray[np.int64] | None = None

    @classmethod
    def none(cls, structure: Structure) -> "BodyParts":
        """Return the parts of a structure of nodes and members."""
        return cls(np.zeros(structure.n_members, dtype=bool), np.zeros((0, 3), dtype=np.int64))

    @classmethod
    def of(cls, subject: Structure | BodySystem) -> "BodyParts":
        """Return the parts of the outline of a structure or of bodies."""
        bodies = () if isinstance(subject, Structure) else subject.bodies
        faces = np.array(find_faces(subject), dtype=np.int64).reshape(-1, 3)
        count = sum(isinstance(body, RigidBody) for body in bodies)
        return cls(is_edge(subject), faces, count, find_joints(subject))


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


def find_tension_limit(tension: FloatArray | None) -> float | None:
    """Return the largest known |tension| [N] of (..., n_members), None where there is none."""
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
        self._parts = BodyParts.none(structure) if parts is None else parts
        # Members of large structures get thinner, so that they do not run together.
        self._scale = line_scale * float(np.clip((45 / max(structure.n_members, 1)) ** 0.4, 0.18, 1.0))
        self.mappable = None if tension_limit is None else _scale_of(tension_limit)
        self.slack = np.zeros(structure.n_members, dtype=bool)
        self._anchors = [
            (chosen, _anchor_marks(axes, fill, hangs, self._scale))
            for chosen, fill, hangs in _group_anchors(structure, view)
        ]
        self._lines = LineCollection([], zorder=3, capstyle="round", clip_on=False)
        axes.add_collection(self._lines, autolim=False)
        self._faces = PolyCollection(
            [], facecolors=BODY, alpha=FACE_ALPHA, linewidths=0, zorder=2.8, clip_on=False
        )
        axes.add_collection(self._faces, autolim=False)
        self._nodes = axes.scatter(
            [], [], facecolor=NODE, edgecolor=INK, linewidth=1.1 * self._scale, zorder=4, clip_on=False
        )

    @property
    def artists(self) -> tuple[Any, ...]:
        """Everything that `show` changes, in painting order."""
        return (*(marks for _, marks in self._anchors), self._faces, self._lines, self._nodes)

    def show(
        self, node_position: FloatArray, tension: FloatArray | None = None, color: FloatArray | None = None
    ) -> None:
        """Draw the structure at node_position (n_nodes, 3) [m] with member tensions (n_members,) [N].

        color (n_members,): what the colours show, by default the tensions; NaN is drawn as unknown.
        """
        color = tension if color is None else color
        self.slack = find_slack(self._structure, node_position, tension)
        projected, depth = self.view.project(node_position)
        pair, member = self._structure.strands.ends, self._structure.strands.member
        order = np.argsort(depth[pair].mean(axis=1), kind="stable")
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
        order = np.argsort(depth, kind="stable")
        self._nodes.set_offsets(projected[order])
        self._nodes.set_sizes((self._scale * NODE_WIDTH * nearness[order]) ** 2)
        for chosen, marks in self._anchors:
            marks.set_data(*projected[chosen].T)

    def _strokes(
        self, ends: FloatArray, nearness: FloatArray, color: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return rim, outline and fill of each strand of members.

        Segments (n_strands, 3, 2, 2), widths (n_strands, 3) and colours (n_strands, 3, 4).
        """
        member = self._structure.strands.member
        bar = self._structure.is_bar[member]
        width = self._scale * nearness * np.where(bar, BAR_WIDTH, CABLE_WIDTH)
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


def _group_anchors(structure: Structure, view: View) -> list[tuple[BoolArray, str, bool]]:
    """Return the anchored nodes by look: which nodes (n_nodes,), the fill, whether they hang from above.

    Nodes that are held on all modelled axes are filled; a node whose members lead down hangs.
    """
    projected, _ = view.project(structure.node_position)
    i, j = structure.strands.ends.T
    lead = np.zeros(structure.n_nodes)
    np.add.at(lead, i, projected[j, 1] - projected[i, 1])
    np.add.at(lead, j, projected[i, 1] - projected[j, 1])
    hangs = lead < -1e-9 * float(np.max(np.abs(lead), initial=0.0))
    held = structure.node_anchored[:, list(structure.axes)]
    fully, partly = held.all(axis=1), held.any(axis=1) & ~held.all(axis=1)
    looks = [
        (chosen & (hangs == down), fill, down)
        for chosen, fill in ((fully, INK), (partly, PAPER))
        for down in (False, True)
    ]
    return [look for look in looks if look[0].any()]


def _anchor_marks(axes: "Axes", fill: str, hangs: bool, scale: float) -> Any:
    """Return marks in the form of a support: a triangle whose tip is the node, above it if the node hangs."""
    from matplotlib.markers import MarkerStyle
    from matplotlib.path import Path

    side = 1.0 if hangs else -1.0
    triangle = Path([(0.0, 0.0), (-0.6, side), (0.6, side), (0.0, 0.0)], closed=True)
    (marks,) = axes.plot(
        [], [], linestyle="none", marker=MarkerStyle(triangle), markersize=ANCHOR_SIZE * max(scale, 0.4),
        markerfacecolor=fill, markeredgecolor=INK, markeredgewidth=1.0, zorder=2.5, clip_on=False,
    )  # fmt: skip
    return marks


def _scale_of(limit: float) -> "ScalarMappable":
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-limit, limit), build_tension_colormap())


def _rgba(color: str) -> FloatArray:
    from matplotlib.colors import to_rgba

    return np.array(to_rgba(color))
