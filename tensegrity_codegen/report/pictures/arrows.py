"""Loads and reactions as arrows of one scale, which the legend states."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.loads import compute_reactions
from tensegrity_codegen.report.pictures.palette import GROUND_FORCE, LOAD, REACTION
from tensegrity_codegen.report.pictures.view import View, round_up
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LONGEST = 0.25  # of the structure's size, at most
CROWD = 24  # arrows from which they get shorter and thinner
MIN_FORCE_RATIO = 1e-6  # part of the largest force below which a force is rounding
GAP = 0.012  # between an arrow and its node, of the structure's size
SHAFT = 1.9  # width in points
HEAD = 0.034  # length of a head, of the structure's size; at most half of its arrow
SLIM = 0.38  # half the width of a head over its length


@dataclass(frozen=True)
class Arrows:
    """Arrows of one kind over samples.

    name, color: ``"load"``, ``"reaction"`` or ``"ground"``, and the colour.
    tail, tip (n_t, n_arrows, 3) [m]: where they start and end; NaN where there is none.
    largest [N]: the largest force.
    n_unknown: number of nodes at which the force is unknown in some sample.
    scale [N/m]: force over length of an arrow.
    size [m]: size of the structure.
    """

    name: str
    color: str
    tail: FloatArray
    tip: FloatArray
    largest: float
    n_unknown: int
    scale: float
    size: float


def lay_out_arrows(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray | None,
    load: FloatArray,
    joints: NDArray[np.int64] | None = None,
    contact: FloatArray | None = None,
) -> list[Arrows]:
    """Return the arrows of loads, reactions and forces of the ground; kinds without a force have no arrows.

    position (n_t, n_nodes, 3) [m]: positions.
    tension (n_t, n_members) [N]: tensions, NaN where unknown; without them there are no reactions.
    load (n_t, n_nodes, 3) [N]: loads.
    joints: nodes whose reactions are unknown, see compute_reactions.
    contact (n_t, n_contacts, 3) [N]: forces of the ground.
    Returns all of one scale: 1, 2 or 5 times a power of ten. An arrow ends at its node where it points
    towards the members there, and else starts there.
    """
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
    found = []
    for name, color, nodes, force in rows:
        length = np.linalg.norm(force, axis=2, keepdims=True)
        shown = np.where(length > MIN_FORCE_RATIO * largest, force / scale, np.nan)
        tail = _find_tails(structure, position, nodes, shown, GAP * size)
        unknown = int(np.isnan(force).any(axis=(0, 2)).sum())
        found.append(Arrows(name, color, tail, tail + shown, _largest(force), unknown, scale, size))
    return [item for item in found if item.tail.shape[1]]


def find_crowd(count: int) -> float:
    """Return by which factor so many arrows are shorter than few."""
    return float(np.clip(np.sqrt(CROWD / max(count, 1)), 0.4, 1.0))


def _largest(force: FloatArray) -> float:
    return float(np.nan_to_num(np.linalg.norm(force, axis=-1)).max(initial=0.0))


def _find_tails(
    structure: Structure, position: FloatArray, nodes: NDArray[np.int64], vector: FloatArray, gap: float
) -> FloatArray:
    """Return where arrows (n_t, n, 3) [m] at some nodes start."""
    toward = np.zeros_like(position)
    i, j = structure.strands.ends.T
    along = position[:, j] - position[:, i]
    length = np.linalg.norm(along, axis=2, keepdims=True)
    unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    np.add.at(toward.swapaxes(0, 1), i, unit.swapaxes(0, 1))
    np.add.at(toward.swapaxes(0, 1), j, -unit.swapaxes(0, 1))
    size = np.linalg.norm(vector, axis=2, keepdims=True)
    apart = gap * vector / size
    pushes = np.sum(vector * toward[:, nodes], axis=2, keepdims=True) > 0
    tail: FloatArray = np.where(pushes, position[:, nodes] - vector - apart, position[:, nodes] + apart)
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
        known = np.isfinite(self.arrows.tail[sample]).all(axis=1)
        start, _ = self.view.project(self.arrows.tail[sample][known])
        end, _ = self.view.project(self.arrows.tip[sample][known])
        along = end - start
        length = np.linalg.norm(along, axis=1, keepdims=True)
        unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
        head = np.minimum(HEAD * self.arrows.size * find_crowd(len(known)), 0.5 * length)
        across = SLIM * head * np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        neck = end - head * unit
        self._shafts.set_segments(list(np.stack([start, neck + 0.1 * head * unit], axis=1)))
        self._heads.set_verts(list(np.stack([end, neck + across, neck - across], axis=1)))


def describe_arrows(arrows: list[Arrows]) -> list[tuple[str, str]]:
    """Return colour and text of each line of the legend: largest forces, unknown reactions, the scale."""
    lines = []
    for item in arrows:
        lacking = f", {item.n_unknown} unknown" if item.n_unknown else ""
        if item.largest > 0:
            lines.append((item.color, f"{item.name} (largest {_describe(item.largest)}{lacking})"))
        elif item.n_unknown:
            lines.append(("none", f"{item.name}s unknown ({item.n_unknown})"))
    if any(item.largest > 0 for item in arrows):
        length = 10.0 ** np.floor(np.log10(LONGEST * arrows[0].size))
        lines.append(("none", f"arrow of {length:.3g} m: {_describe(arrows[0].scale * length)}"))
    return lines


def _describe(force: float) -> str:
    """Return a force with a unit that suits it."""
    for unit, factor in (("MN", 1e6), ("kN", 1e3), ("N", 1.0)):
        if force >= factor * (1 if unit == "N" else 9.995):
            return f"{force / factor:.3g} {unit}"
    return f"{force:.3g} N" if force == 0 or force >= 0.01 else f"{force * 1e3:.3g} mN"
