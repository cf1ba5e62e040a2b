"""Marks on a picture: arrows of loads and reactions on one scale, names where they cover least."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.loads import compute_reactions
from tensegrity_codegen.report.pictures.canvas import GROUND_FORCE, INK, LOAD, MUTED, PAPER, REACTION
from tensegrity_codegen.report.pictures.view import PlanarView, View, round_up
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LONGEST = 0.25  # of the structure's size, at most
SHORTEST = 0.05  # the same of a load, however small beside reactions
CROWD = 24  # arrows from which they get shorter and thinner
MIN_FORCE_RATIO = 1e-6  # part of the largest force below which a force is rounding
GAP = 0.012  # between an arrow and its node, of the structure's size
LEVEL = 1e-6  # sine of the rise of a member that counts as level
SUPPORT = 0.04  # the same below or above a support, whose mark is there
UPRIGHT = 0.7  # part of a force along the upward axis from which its arrow passes that mark
SHAFT = 1.9  # width in points
HEAD = 0.034  # length of a head, of the structure's size; at most half of its arrow
SLIM = 0.38  # half the width of a head over its length


@dataclass(frozen=True)
class Arrows:
    """Arrows of one kind over samples.

    name, color: ``"load"``, ``"reaction"`` or ``"ground"``, and the colour.
    tail, tip (n_t, n_arrows, 3) [m]: where they start and end; NaN if there is none.
    largest [N]: the largest force.
    n_unknown: number of nodes at which the force is unknown in some sample.
    scale [N/m]: force over length of an arrow.
    size [m]: size of the structure.
    shortest [m]: length to which loads are lengthened; 0 if none is.
    """

    name: str
    color: str
    tail: FloatArray
    tip: FloatArray
    largest: float
    n_unknown: int
    scale: float
    size: float
    shortest: float = 0.0


def lay_out_arrows(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray | None,
    load: FloatArray,
    joints: NDArray[np.int64] | None = None,
    contact: FloatArray | None = None,
) -> list[Arrows]:
    """Return the arrows of loads, reactions and forces of the ground, of one scale; none without a force."""
    # The scale is 1, 2 or 5 times a power of ten. An arrow ends at its node where it points towards the
    # members there, and else starts there. Loads that would hardly be seen are lengthened.
    axes = list(structure.axes)
    held = np.flatnonzero(structure.node_anchored[:, axes].any(axis=1) & (tension is not None))
    reaction = np.zeros((len(position), 0, 3))
    if tension is not None:
        reaction = compute_reactions(structure, position, tension, held, load, joints)
    loaded = np.flatnonzero(np.any(load != 0.0, axis=(0, 2)))
    rows = [("load", LOAD, loaded, load[:, loaded]), ("reaction", REACTION, held, reaction)]
    if contact is not None and structure.ground is not None:
        rows.append(("ground", GROUND_FORCE, structure.ground.node, contact))
    largest = max(_largest(force) for _, _, _, force in rows)
    size = float(np.linalg.norm(np.ptp(position[0], axis=0))) or 1.0
    count = sum(len(nodes) for _, _, nodes, _ in rows)
    force_per_length = largest / (LONGEST * size * find_crowd(count))
    scale = round_up(force_per_length) if force_per_length > 0 else 1.0
    arrow_sets = []
    for name, color, nodes, force in rows:
        length = np.linalg.norm(force, axis=2, keepdims=True)
        floor = SHORTEST * size * find_crowd(count) if name == "load" else 0.0
        drawn = length > MIN_FORCE_RATIO * largest
        floor *= bool((drawn & (length < floor * scale)).any())
        divisor = np.fmin(np.where(drawn, length, np.inf) / floor, scale) if floor else scale
        shown = np.where(drawn, force / divisor, np.nan)
        tail = _find_tails(structure, position, nodes, shown, size)
        unknown = int(np.isnan(force).any(axis=(0, 2)).sum())
        strongest = _largest(force)
        arrow_sets.append(Arrows(name, color, tail, tail + shown, strongest, unknown, scale, size, floor))
    return [arrow_set for arrow_set in arrow_sets if arrow_set.tail.shape[1]]


def find_crowd(count: int) -> float:
    """Return by which factor so many arrows are shorter than few."""
    return float(np.clip(np.sqrt(CROWD / max(count, 1)), 0.4, 1.0))


def _largest(force: FloatArray) -> float:
    return float(np.nan_to_num(np.linalg.norm(force, axis=-1)).max(initial=0.0))


def _find_tails(
    structure: Structure, position: FloatArray, nodes: NDArray[np.int64], vector: FloatArray, extent: float
) -> FloatArray:
    """Return where arrows (n_t, n, 3) [m] at some nodes start, clear of nodes and marks of supports."""
    toward = np.zeros_like(position)
    i, j = structure.strands.ends.T
    along = position[:, j] - position[:, i]
    length = np.linalg.norm(along, axis=2, keepdims=True)
    unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    np.add.at(toward.swapaxes(0, 1), i, unit.swapaxes(0, 1))
    np.add.at(toward.swapaxes(0, 1), j, -unit.swapaxes(0, 1))
    size = np.linalg.norm(vector, axis=2, keepdims=True)
    up = structure.axes[-1]
    held = structure.node_anchored[nodes][:, list(structure.axes)].any(axis=1, keepdims=True)
    passes = held & (np.abs(vector[:, :, up : up + 1]) > UPRIGHT * size)
    crowd = find_crowd_scale(structure, SMALLEST_ANCHOR)
    clearance = extent * np.where(passes, max(GAP, SUPPORT * crowd), GAP) * vector / size
    pushes = np.sum(vector * toward[:, nodes], axis=2, keepdims=True) > 0
    tail: FloatArray = np.where(
        pushes, position[:, nodes] - vector - clearance, position[:, nodes] + clearance
    )
    return tail


class ForceArrows:
    """Arrows of one kind on one panel; `show` moves them."""

    def __init__(self, axes: "Axes", view: View, arrows: Arrows, *, line_scale: float = 1.0) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self.arrows, self.view = arrows, view
        width = SHAFT * line_scale * find_crowd(arrows.tail.shape[1])
        self._shafts = LineCollection(
            [], colors=arrows.color, linewidths=width, zorder=4.4, clip_on=False, capstyle="butt"
        )
        self._heads = PolyCollection([], facecolors=arrows.color, linewidths=0, zorder=4.5, clip_on=False)
        axes.add_collection(self._shafts, autolim=False)
        axes.add_collection(self._heads, autolim=False)

    @property
    def artists(self) -> tuple[Any, ...]:
        """Everything that `show` changes."""
        return (self._shafts, self._heads)

    def show(self, sample: int) -> None:
        """Draw the forces of a sample."""
        is_finite = np.isfinite(self.arrows.tail[sample]).all(axis=1)
        start, _ = self.view.project(self.arrows.tail[sample][is_finite])
        end, _ = self.view.project(self.arrows.tip[sample][is_finite])
        along = end - start
        length = np.linalg.norm(along, axis=1, keepdims=True)
        unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
        head = np.minimum(HEAD * self.arrows.size * find_crowd(len(is_finite)), 0.5 * length)
        across = SLIM * head * np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        neck = end - head * unit
        self._shafts.set_segments(list(np.stack([start, neck + 0.1 * head * unit], axis=1)))
        self._heads.set_verts(list(np.stack([end, neck + across, neck - across], axis=1)))


Unit: TypeAlias = tuple[str, float]


def choose_unit(force: float) -> Unit:
    """Return the unit that suits a force [N], and its size [N]."""
    for name, size in (("MN", 1e6), ("kN", 1e3)):
        if force >= 9.995 * size:
            return name, size
    return ("N", 1.0) if force == 0 or force >= 0.01 else ("mN", 1e-3)


def describe_arrows(arrows: list[Arrows], unit: Unit | None = None) -> list[tuple[str, str]]:
    """Return colour and text of each line of the legend: largest forces, unknown reactions, the scale."""
    lines = []
    unit = unit or choose_unit(max((arrow_set.largest for arrow_set in arrows), default=0.0))
    for arrow_set in arrows:
        lacking = f", {arrow_set.n_unknown} unknown" if arrow_set.n_unknown else ""
        if arrow_set.largest > 0:
            text = f"{arrow_set.name} (largest {describe_force(arrow_set.largest, unit)}{lacking})"
            lines.append((arrow_set.color, text))
        elif arrow_set.n_unknown:
            lines.append(("none", f"{arrow_set.name}s unknown ({arrow_set.n_unknown})"))
    if any(arrow_set.largest > 0 for arrow_set in arrows):
        length = 10.0 ** np.floor(np.log10(LONGEST * arrows[0].size))
        shortest = max(arrow_set.shortest for arrow_set in arrows)
        floor = f"; of loads at least {shortest:.2g} m" if shortest else ""
        force = describe_force(arrows[0].scale * length, unit)
        lines.append(("none", f"arrow of {length:.3g} m: {force}{floor}"))
    return lines


def describe_force(force: float, unit: Unit) -> str:
    """Return a force [N] in a unit, with three digits."""
    return f"{float(f'{force / unit[1]:.3g}'):g} {unit[0]}"


ANCHOR_SIZE, SMALLEST_ANCHOR = 21.0, 0.4  # [points], and of it in large structures


def find_crowd_scale(structure: Structure, smallest: float) -> float:
    """Return the width of lines over that in structures of a few dozen members: larger ones get thinner."""
    return float(np.clip((45 / max(structure.n_members, 1)) ** 0.4, smallest, 1.0))


def group_anchors(structure: Structure, view: View) -> list[tuple[BoolArray, str, bool]]:
    """Return the anchored nodes by look: which nodes (n_nodes,), the fill, whether they hang from above.

    Nodes that are held on all modelled axes are filled; a node whose members all lead down hangs.
    """
    up = view.axes[1] if isinstance(view, PlanarView) else 2
    strands = structure.strands
    rise = strands.directions(structure.node_position)[0][:, up]
    highest = np.full(structure.n_nodes, -np.inf)
    for end, sign in ((0, -1.0), (1, 1.0)):
        np.maximum.at(highest, strands.ends[:, end], sign * rise)
    hangs = highest < -LEVEL
    held = structure.node_anchored[:, list(structure.axes)]
    fully, partly = held.all(axis=1), held.any(axis=1) & ~held.all(axis=1)
    looks = [
        (chosen & (hangs == down), fill, down)
        for chosen, fill in ((fully, INK), (partly, PAPER))
        for down in (False, True)
    ]
    return [look for look in looks if look[0].any()]


def draw_anchors(axes: "Axes", fill: str, hangs: bool, scale: float) -> Any:
    """Return marks in the form of a support: a triangle whose tip is the node, above it if the node hangs."""
    from matplotlib.markers import MarkerStyle
    from matplotlib.path import Path

    side = 1.0 if hangs else -1.0
    triangle = Path([(0.0, 0.0), (-0.6, side), (0.6, side), (0.0, 0.0)], closed=True)
    (marks,) = axes.plot(
        [], [], linestyle="none", marker=MarkerStyle(triangle),
        markersize=ANCHOR_SIZE * max(scale, SMALLEST_ANCHOR), markerfacecolor=fill,
        markeredgecolor=INK, markeredgewidth=1.0, zorder=2.5, clip_on=False,
    )  # fmt: skip
    return marks


MAX_NAMES = {"nodes": 100, "members": 30}  # of pictures; more run together
NODE_SIZE, MEMBER_SIZE = 9.0, 7.5
OFFSET = 6.0  # between a node and its name, in points
WIDE, TALL = 0.62, 1.25  # of a letter, over the size of the text
# Positions of a node's name, in multiples of OFFSET, and of a member's name along it.
AROUND = ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1.4), (0, -1.4), (1.4, 0), (-1.4, 0))
ALONG = (0.42, 0.58, 0.5, 0.33, 0.67, 0.25, 0.75)
SAMPLES = 9  # points of a member that names keep clear of
NODE_COST, LINE_COST = 1.5, 0.25  # of covering a node or a piece of a member, over that of another name


@dataclass(frozen=True)
class LeftOut:
    """Names that a picture does not write.

    kind: ``"nodes"`` or ``"members"``; count: how many there are; limit: the largest number that is written.
    """

    kind: str
    count: int
    limit: int

    def describe(self) -> str:
        """Return a sentence."""
        return (
            f"the picture has no names of {self.kind}: there are {self.count}, and more than {self.limit} "
            "run together"
        )


def choose_names(
    structure: Structure, labels: Sequence[str], limit: int | None = None
) -> tuple[tuple[str, ...], list[LeftOut]]:
    """Return which of the labels are written, and which are left out since there are more than `most`."""
    limits = MAX_NAMES if limit is None else dict.fromkeys(MAX_NAMES, limit)
    counts = {"nodes": structure.n_nodes, "members": structure.n_members}
    omitted = [LeftOut(kind, counts[kind], limits[kind]) for kind in labels if counts[kind] > limits[kind]]
    missing = {entry.kind for entry in omitted}
    return tuple(kind for kind in labels if kind not in missing), omitted


class NameWriter:
    """Texts on one panel; `show` moves them with the structure, on the sides chosen at first.

    point_size: metres on paper of a point; obstacles: starts and ends (n, 3) [m] of other lines; texts:
    annotations that are there already.
    """

    def __init__(
        self,
        axes: "Axes",
        structure: Structure,
        view: View,
        labels: Sequence[str],
        point_size: float,
        obstacles: Sequence[tuple[FloatArray, FloatArray]] = (),
        texts: Sequence[Any] = (),
    ) -> None:
        from matplotlib.patheffects import withStroke

        self._structure, self.view, self._point = structure, view, point_size
        self._obstacles = list(obstacles)
        self._standing = [_find_standing(label, point_size) for label in texts]
        self._spots: list[tuple[str, int, Any]] | None = None
        rim = [withStroke(linewidth=2.5, foreground=PAPER)]
        self._texts: list[Any] = []
        self._rows: list[tuple[str, int, str]] = []
        for kind, names in (("nodes", structure.node_name), ("members", structure.member_name)):
            if kind not in labels:
                continue
            is_node = kind == "nodes"
            for number, name in enumerate(names):
                self._rows.append((kind, number, name))
                text = axes.annotate(
                    name, (0.0, 0.0), xytext=(0.0, 0.0), textcoords="offset points", ha="center", va="center",
                    fontsize=NODE_SIZE if is_node else MEMBER_SIZE,
                    fontweight="bold" if is_node else "normal", color=INK if is_node else MUTED,
                    path_effects=rim, zorder=6 if is_node else 5,
                    annotation_clip=False,
                )  # fmt: skip
                text.set_parse_math(False)
                self._texts.append(text)

    @property
    def artists(self) -> tuple[Any, ...]:
        """All texts."""
        return tuple(self._texts)

    def show(self, node_position: FloatArray) -> None:
        """Write the names beside nodes at node_position (n_nodes, 3) and on members."""
        if not self._texts:
            return
        projected, _ = self.view.project(node_position[: self._structure.n_nodes])
        spots = self._choose(projected) if self._spots is None else self._spots
        self._spots = spots
        pair = self._structure.strands.first_ends
        for (kind, number, spot), text in zip(spots, self._texts, strict=True):
            if kind == "nodes":
                text.xy, text.xyann = tuple(projected[number]), tuple(spot)
            else:
                start, end = projected[pair[number]]
                text.xy = tuple(start + spot * (end - start))

    def _choose(self, projected: FloatArray) -> list[tuple[str, int, Any]]:
        """Return for each text its offset in points, or the part of its member at which it stands."""
        # Lines that names keep clear of: members and obstacles, as points along them
        points = projected / self._point
        ends = points[self._structure.strands.first_ends]
        segments = [points[self._structure.strands.ends]]
        for start, end in self._obstacles:
            is_finite = np.isfinite(start).all(axis=1)
            pair = [self.view.project(point[is_finite])[0] / self._point for point in (start, end)]
            segments.append(np.stack(pair, axis=1))
        strokes = np.concatenate(segments)
        fraction = np.linspace(0.1, 0.9, SAMPLES)[:, None, None]
        lines = (strokes[None, :, 0] + fraction * (strokes[:, 1] - strokes[:, 0])[None]).reshape(-1, 2)
        # Each name goes where it covers least, nodes outward; what is placed is an obstacle of the next
        middle = points.mean(axis=0)
        boxes = list(self._standing)
        spots: list[tuple[str, int, Any]] = []
        for kind, number, name in self._rows:
            if kind == "nodes":
                box = _half_box(name, NODE_SIZE)
                offsets = np.array([_beside(around, box) for around in AROUND])
                outward = offsets @ (points[number] - middle)
                chosen = _cheapest(points[number] + offsets, box, boxes, points, lines, -1e-6 * outward)
                spots.append((kind, number, offsets[chosen]))
                boxes.append(np.concatenate([points[number] + offsets[chosen], box]))
            else:
                box = _half_box(name, MEMBER_SIZE)
                start, end = ends[number]
                centers = start + np.array(ALONG)[:, None] * (end - start)
                chosen = _cheapest(centers, box, boxes, points, lines, 1e-3 * np.arange(float(len(ALONG))))
                spots.append((kind, number, ALONG[chosen]))
                boxes.append(np.concatenate([centers[chosen], box]))
        return spots


def _find_standing(text: Any, point_size: float) -> FloatArray:
    """Return middle and half box of an annotation, (4,) [points]."""
    box = _half_box(text.get_text(), text.get_fontsize())
    across = {"left": 1.0, "right": -1.0}.get(text.get_ha(), 0.0)
    upward = {"bottom": 1.0, "top": -1.0}.get(text.get_va(), 0.0)
    middle = np.array(text.xy) / point_size + np.array(text.xyann) + box * (across, upward)
    return np.concatenate([middle, box])


def _half_box(name: str, size: float) -> FloatArray:
    """Return half the width and half the height of a text in points."""
    return np.array([WIDE * size * len(name) / 2 + 1.0, TALL * size / 2])


def _beside(around: tuple[float, float], box: FloatArray) -> FloatArray:
    """Return the offset [points] of the middle of a text with this half box from its node."""
    side = np.sign(around)
    diagonal = 0.6 if side.all() else 1.0
    offset: FloatArray = side * (diagonal * OFFSET + box)
    return offset


def _cheapest(
    centers: FloatArray,
    box: FloatArray,
    boxes: list[FloatArray],
    nodes: FloatArray,
    lines: FloatArray,
    preference: FloatArray,
) -> int:
    """Return which of the centers (n, 2) covers least: other texts, nodes, members."""
    cost = np.array(preference, dtype=float)
    if boxes:
        obstacles = np.array(boxes)
        distance = np.abs(centers[:, None] - obstacles[None, :, :2])
        reach = box + obstacles[:, 2:]
        overlap = np.clip(reach - distance, 0.0, None).prod(axis=2) / np.prod(2 * box)
        cost += 4.0 * overlap.sum(axis=1) + (overlap > 0).sum(axis=1)
    cost += NODE_COST * _count_inside(centers, box + 2.0, nodes)
    cost += LINE_COST * _count_inside(centers, box, lines)
    return int(cost.argmin())


def _count_inside(centers: FloatArray, box: FloatArray, points: FloatArray) -> FloatArray:
    inside: FloatArray = (np.abs(centers[:, None] - points[None]) < box).all(axis=2).sum(axis=1).astype(float)
    return inside
