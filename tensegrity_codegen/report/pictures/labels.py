"""Names of nodes and members on a picture, each where it covers least."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.pictures.palette import INK, MUTED, PAPER
from tensegrity_codegen.report.pictures.view import View
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_NAMES = {"nodes": 100, "members": 30}  # of pictures; more run together
NODE_SIZE, MEMBER_SIZE = 9.0, 7.5
OFFSET = 6.0  # between a node and its name, in points
WIDE, TALL = 0.62, 1.25  # of a letter, over the size of the text
# Where a node's name may stand, in multiples of OFFSET, and where on a member its name may.
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
    structure: Structure, labels: Sequence[str], most: int | None = None
) -> tuple[tuple[str, ...], list[LeftOut]]:
    """Return which of the labels are written, and which are left out since there are more than `most`."""
    limits = MOST_NAMES if most is None else dict.fromkeys(MOST_NAMES, most)
    counts = {"nodes": structure.n_nodes, "members": structure.n_members}
    left = [LeftOut(kind, counts[kind], limits[kind]) for kind in labels if counts[kind] > limits[kind]]
    missing = {item.kind for item in left}
    return tuple(kind for kind in labels if kind not in missing), left


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
        self._standing = [_find_standing(item, point_size) for item in texts]
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
        place, _ = self.view.project(node_position)
        spots = self._choose(place) if self._spots is None else self._spots
        self._spots = spots
        pair = self._structure.strands.first_ends
        for (kind, number, spot), text in zip(spots, self._texts, strict=True):
            if kind == "nodes":
                text.xy, text.xyann = tuple(place[number]), tuple(spot)
            else:
                start, end = place[pair[number]]
                text.xy = tuple(start + spot * (end - start))

    def _choose(self, place: FloatArray) -> list[tuple[str, int, Any]]:
        """Return for each text its offset in points, or the part of its member at which it stands."""
        points = place / self._point
        ends = points[self._structure.strands.first_ends]
        segments = [points[self._structure.strands.ends]]
        for start, end in self._obstacles:
            known = np.isfinite(start).all(axis=1)
            pair = [self.view.project(item[known])[0] / self._point for item in (start, end)]
            segments.append(np.stack(pair, axis=1))
        strokes = np.concatenate(segments)
        part = np.linspace(0.1, 0.9, SAMPLES)[:, None, None]
        lines = (strokes[None, :, 0] + part * (strokes[:, 1] - strokes[:, 0])[None]).reshape(-1, 2)
        middle = points.mean(axis=0)
        taken = list(self._standing)
        spots: list[tuple[str, int, Any]] = []
        for kind, number, name in self._rows:
            if kind == "nodes":
                box = _half_box(name, NODE_SIZE)
                offsets = np.array([_beside(around, box) for around in AROUND])
                outward = offsets @ (points[number] - middle)
                found = _cheapest(points[number] + offsets, box, taken, points, lines, -1e-6 * outward)
                spots.append((kind, number, offsets[found]))
                taken.append(np.concatenate([points[number] + offsets[found], box]))
            else:
                box = _half_box(name, MEMBER_SIZE)
                start, end = ends[number]
                centers = start + np.array(ALONG)[:, None] * (end - start)
                found = _cheapest(centers, box, taken, points, lines, 1e-3 * np.arange(float(len(ALONG))))
                spots.append((kind, number, ALONG[found]))
                taken.append(np.concatenate([centers[found], box]))
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
    taken: list[FloatArray],
    nodes: FloatArray,
    lines: FloatArray,
    preference: FloatArray,
) -> int:
    """Return which of the centers (n, 2) covers least: other texts, nodes, members."""
    cost = np.array(preference, dtype=float)
    if taken:
        others = np.array(taken)
        apart = np.abs(centers[:, None] - others[None, :, :2])
        reach = box + others[:, 2:]
        overlap = np.clip(reach - apart, 0.0, None).prod(axis=2) / np.prod(2 * box)
        cost += 4.0 * overlap.sum(axis=1) + (overlap > 0).sum(axis=1)
    cost += NODE_COST * _count_inside(centers, box + 2.0, nodes)
    cost += LINE_COST * _count_inside(centers, box, lines)
    return int(cost.argmin())


def _count_inside(centers: FloatArray, box: FloatArray, points: FloatArray) -> FloatArray:
    inside: FloatArray = (np.abs(centers[:, None] - points[None]) < box).all(axis=2).sum(axis=1).astype(float)
    return inside
