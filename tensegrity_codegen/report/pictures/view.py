"""Choices of a reader for a picture, and views: a light perspective, or two axes as they are."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, check_choice

LABELS = ("nodes", "members")
COLORS = ("tension", "force_density", "stress", "kind")
NAMED_VIEWS = ("iso", "front", "side", "top")
VIEW_TEXT = "iso, front, side, top, or AZIMUTH,ELEVATION in degrees, elevation from -90 to 90"
SMALLEST_SIDE, LARGEST_SIDE = 200, 10_000  # pixels of a side

Size: TypeAlias = tuple[int, int]
Labels: TypeAlias = bool | str | Iterable[str]


@dataclass(frozen=True)
class Direction:
    """The direction from which a structure is seen.

    name: ``"iso"``, ``"front"``, ``"side"``, ``"top"``, or the text that was given; azimuth, elevation [deg]:
    of the eye: about +z from +x, and above the ground.
    """

    name: str
    azimuth: float
    elevation: float

    @property
    def is_along_axis(self) -> bool:
        """Whether two axes are seen without perspective, as they are."""
        return self.name in ("front", "side", "top")


# In an isometric view all three axes have one scale.
ISOMETRIC = math.degrees(math.atan(math.sqrt(0.5)))
_NAMED = {
    "iso": Direction("iso", -45.0, ISOMETRIC),
    "front": Direction("front", -90.0, 0.0),
    "side": Direction("side", 0.0, 0.0),
    "top": Direction("top", -90.0, 90.0),
}


@dataclass(frozen=True)
class PictureChoices:
    """Choices for one picture or film; the defaults are those of pictures without options.

    view: none: the direction from which the fewest members hide nodes.
    size: width and height in pixels; None: a size that suits the structure.
    labels: the things with their names written: ``"nodes"``, ``"members"``.
    color: one of COLORS.
    follow: whether the axes move with the centroid of the nodes.
    forces: whether loads and reactions are drawn.
    """

    view: Direction | None = None
    size: Size | None = None
    labels: tuple[str, ...] = ()
    color: str = "tension"
    follow: bool = False
    forces: bool = True

    def __post_init__(self) -> None:
        check_choice(self.color, COLORS, "colour", "color")


def read_view(text: str | tuple[float, float] | None) -> Direction | None:
    """Return the direction of a view.

    text: ``"iso"``, ``"front"`` (along y), ``"side"`` (along x), ``"top"`` (along z), ``"AZIMUTH,ELEVATION"``
    or these two numbers [deg].
    """
    if text is None:
        return None
    if isinstance(text, str) and text.strip().lower() in _NAMED:
        return _NAMED[text.strip().lower()]
    try:
        angles = text.split(",") if isinstance(text, str) else text
        azimuth, elevation = (float(angle) for angle in angles)
    except (TypeError, ValueError):
        azimuth = elevation = math.nan
    if not (math.isfinite(azimuth) and -90.0 <= elevation <= 90.0):
        raise InvalidValueError(
            "unknown view", where="view", given=text, allowed=VIEW_TEXT, hint="for example -60,16"
        )
    return Direction(f"{azimuth:g},{elevation:g}", azimuth, elevation)


def read_size(text: str | tuple[int, int] | None) -> Size | None:
    """Return width and height in pixels of ``"1200x900"`` or (1200, 900); None for None."""
    if text is None:
        return None
    if isinstance(text, str):
        match = re.fullmatch(r"\s*(\d{1,9})\s*[x×X]\s*(\d{1,9})\s*", text)
        sides = tuple(int(side) for side in match.groups()) if match else ()
    else:
        try:
            sides = tuple(int(side) for side in text if float(side).is_integer())
        except (TypeError, ValueError):
            sides = ()
    if len(sides) != 2 or not all(SMALLEST_SIDE <= side <= LARGEST_SIDE for side in sides):
        raise InvalidValueError(
            "not a size",
            where="size",
            given=text,
            allowed=f"WIDTHxHEIGHT in pixels, each from {SMALLEST_SIDE} to {LARGEST_SIDE}",
            hint="for example 1200x900",
        )
    return sides[0], sides[1]


def read_labels(labels: Labels) -> tuple[str, ...]:
    """Return which names are written, of LABELS.

    given: true: both; False or ``"none"``: no names; ``"nodes"``, ``"members"``, several separated by commas.
    """
    if isinstance(labels, bool):
        return LABELS if labels else ()
    try:
        entries = labels.split(",") if isinstance(labels, str) else [str(label) for label in labels]
    except TypeError:
        entries = [str(labels)]
    words = [word.strip().lower() for entry in entries for word in entry.split(",") if word.strip()]
    is_valid = set(words) <= {*LABELS, "none"}
    if not is_valid or ("none" in words and len(set(words)) > 1) or (entries and not words):
        raise InvalidValueError(
            "unknown labels", where="labels", given=labels if isinstance(labels, str) else ",".join(entries),
            allowed="nodes, members, both separated by a comma, or none",
        )  # fmt: skip
    return tuple(word for word in LABELS if word in words)


LARGEST = 1e30  # whose squares and cubes are far from overflow, in single precision too


def check_array(name: str, value: ArrayLike, shape: tuple[int, ...], over: str) -> NDArray[np.float64]:
    """Return `value` as numbers of `shape` up to LARGEST; `over` says what it runs over."""
    array: NDArray[Any] = np.array(value, dtype=float)
    if array.shape != shape:
        raise InvalidValueError(
            f"{name} has the wrong shape", where=name, given=array.shape, allowed=f"{shape}: {over}"
        )
    is_good = np.abs(array) <= LARGEST
    if not is_good.all():
        wrong = np.argwhere(~is_good)[0]
        inside = f" in sample {wrong[0]}" if over.startswith("samples") else ""
        problem = "too large for a picture" if np.isfinite(array[tuple(wrong)]) else "not finite"
        raise NonFiniteError(
            f"{name} is {problem}{inside}",
            where=name,
            allowed=f"finite numbers of at most {LARGEST:g}",
            hint="see where it was computed",
        )
    return array


def check_tension(
    value: ArrayLike, shape: tuple[int, ...], structure: Structure, over: str, name: str = "member_tension"
) -> NDArray[np.float64]:
    """Return member tensions [N] of `shape`, members last; NaN, unknown, in bars and rigid members alone."""
    array: NDArray[np.float64] = np.array(value, dtype=float)
    unknown = (
        np.isnan(array) & (structure.is_rigid | structure.is_bar)
        if array.shape == shape
        else np.zeros(1, dtype=bool)
    )
    values = np.where(unknown, 0.0, array) if unknown.any() else array
    check_array(name, values, shape, over)
    return array


def check_trajectory(structure: Structure, trajectory: Trajectory) -> None:
    """Raise InvalidValueError for the trajectory of another structure, NonFiniteError for NaN or Inf."""
    if (trajectory.node_name, trajectory.member_name) != (structure.node_name, structure.member_name):
        raise InvalidValueError(
            "the trajectory belongs to another structure",
            where=structure.name,
            given=f"{len(trajectory.node_name)} nodes and {len(trajectory.member_name)} members",
            allowed=f"the {structure.n_nodes} nodes and {structure.n_members} members of this structure",
            hint="simulate the structure that is shown",
        )
    samples = len(trajectory.time)
    check_array("time", trajectory.time, (samples,), "samples")
    of_nodes = (samples, structure.n_nodes, 3)
    for name in ("node_position", "node_velocity", "node_load"):
        if getattr(trajectory, name) is not None:
            check_array(name, getattr(trajectory, name), of_nodes, "samples, nodes, axes")
    shape = (samples, structure.n_members)
    check_tension(trajectory.member_tension, shape, structure, "samples, members")
    for name in ("kinetic_energy", "total_energy"):
        check_array(name, getattr(trajectory, name), (samples,), "samples")


# Azimuths of the eye about +z from +x to choose from [deg]; the first is that of large structures.
AZIMUTHS = (-60.0, -66.0, -54.0, -72.0, -48.0, -78.0, -42.0)
ELEVATION = np.radians(16.0)
DISTANCE = 5.0  # of the eye, in half diagonals of the box
PARALLEL_DISTANCE = 1e6  # the same in a view without perspective
ALONG = {"front": (0, 2), "side": (1, 2), "top": (0, 1)}  # axes of views along the third one

# At most this many grid steps span the ground or the height.
STEPS = 5
# This part of a cell is no reason for another one.
OVERHANG = 0.1
# Cells that reach over more than this many times the longest side are too coarse.
WASTE = 1.4
FINER = 0.44  # of a step, from which the next finer one follows
# A side shorter than the longest one over this gets the grid of that length.
SLENDERNESS = 4.0
# Distances on paper below this part of the picture are clutter; more node-member pairs are not compared.
CLUTTER_RATIO = 0.03
MAX_PAIRS = 1_000_000


@dataclass(frozen=True)
class Box:
    """A box along the axes around everything drawn, and the grid steps in it; all in [m]."""

    low: FloatArray  # (3,)
    high: FloatArray  # (3,)
    step: FloatArray  # (3,)
    beyond: FloatArray | None = None  # (n, 3), places outside that are drawn too, such as ends of arrows

    def shown(self) -> FloatArray:
        """Return all that a picture in perspective must show: corners and places outside, (n, 3)."""
        corners = self.corners()
        return corners if self.beyond is None else np.vstack([corners, self.beyond])

    def moved(self, step: FloatArray) -> "Box":
        """Return the box moved by (3,) [m]; the grid stays where it is."""
        beyond = None if self.beyond is None else self.beyond + step
        return Box(self.low + step, self.high + step, self.step, beyond)

    def ticks(self, axis: int) -> FloatArray:
        """Return the multiples of the grid step from face to face, (n,)."""
        lower = np.ceil(self.low[axis] / self.step[axis] - 1e-6)
        upper = np.floor(self.high[axis] / self.step[axis] + 1e-6)
        multiples: FloatArray = np.arange(lower, upper + 1) * self.step[axis]
        return multiples

    def corners(self) -> FloatArray:
        """Return the corners, (8, 3)."""
        sides = np.stack([self.low, self.high])
        picks = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        return np.stack([sides[picks[:, axis], axis] for axis in range(3)], axis=1)


class View(Protocol):
    """How positions become places on paper."""

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) on paper [m] and depths (...): larger is nearer to the eye."""
        ...

    def magnification(self, depth: ArrayLike) -> FloatArray:
        """Return how much larger things at these depths appear than at the centre."""
        ...


@dataclass(frozen=True)
class PerspectiveView:
    """A camera at `distance` [m] from `center` (3,); rows of `rotation` (3, 3): right, up, to the eye.

    A point at depth d from the centre is magnified by distance / (distance - d).
    """

    center: FloatArray
    rotation: FloatArray
    distance: float

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) on paper [m] and depths (...) [m] of points (..., 3)."""
        turned = (np.asarray(points, dtype=float) - self.center) @ self.rotation.T
        depth = turned[..., 2]
        return turned[..., :2] * self.magnification(depth)[..., None], depth

    def magnification(self, depth: ArrayLike) -> FloatArray:
        """Return distance / (distance - depth) for depths (...)."""
        factor: FloatArray = self.distance / (self.distance - np.asarray(depth, dtype=float))
        return factor


@dataclass(frozen=True)
class PlanarView:
    """Two axes, the first to the right and the second up; is_in_space: of a scene of three axes.

    The eye looks against the product of the two axes: along y where these are x and z.
    """

    axes: tuple[int, int]
    is_in_space: bool = False

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return places (..., 2) on paper [m] and depths (...) [m] of points (..., 3), zero in a plane."""
        array = np.asarray(points, dtype=float)
        projected = array[..., list(self.axes)]
        if not self.is_in_space:
            return projected, np.zeros(projected.shape[:-1])
        sign = -1.0 if self.axes == (0, 2) else 1.0
        return projected, sign * array[..., 3 - sum(self.axes)]

    def magnification(self, depth: ArrayLike) -> FloatArray:
        """Return ones for depths (...)."""
        return np.ones_like(np.asarray(depth, dtype=float))


def nice_step(span: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the least such that STEPS of it about reach over `span` > 0."""
    return round_up(span / STEPS, OVERHANG)


def round_up(value: float, tolerance: float = 1e-9) -> float:
    """Return the least of 1, 2 and 5 times a power of ten that is not below `value` > 0, up to a part."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= value * (1 - tolerance)))


def _ground_step(low: FloatArray, high: FloatArray, span: float) -> float:
    """Return the step of a ground between low and high (2,), a finer one if whole cells reach too far."""
    step = nice_step(span)
    reach = step * (np.ceil(high / step - OVERHANG) - np.floor(low / step + OVERHANG))
    return nice_step(FINER * STEPS * step) if float(reach.max()) > WASTE * span else step


def find_box(points: ArrayLike, axes: Sequence[int]) -> Box:
    """Return the box around points (..., 3) of a scene with these axes, its ground on grid lines.

    A side without extent gets two grid steps; a single point counts as large as its distance from the origin.
    """
    flat = np.asarray(points, dtype=float).reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    extent, span = float(np.max(np.abs(flat))), float(np.max(high - low))
    # Rounding noise of points far from the origin is no extent.
    size = span if span > 1e-9 * extent else max(1.0, extent)
    ground = _ground_step(low[:2], high[:2], max(high[0] - low[0], high[1] - low[1], size / SLENDERNESS))
    step = np.array([ground, ground, nice_step(max(high[2] - low[2], size / SLENDERNESS))])
    is_flat = high - low <= 1e-9 * size
    low, high = low - is_flat * step, high + is_flat * step
    if len(axes) == 3:
        # The ground is a whole number of cells, up to a small overhang.
        low = step * np.floor(low / step + OVERHANG)
        high[:2] = step[:2] * np.ceil(high[:2] / step[:2] - OVERHANG)
        is_thin = high <= low  # as a mast, thinner than any overhang
        low, high = low - is_thin * step, high + is_thin * step
    return Box(low, high, step)


def fit_view(structure: Structure, box: Box, node_position: FloatArray) -> View:
    """Return the view of a structure at node_position (n_nodes, 3): planar for one or two axes.

    In perspective the eye stands where the fewest members pass over nodes that they do not end in.
    """
    if len(structure.axes) < 3:
        return PlanarView(_find_plane(structure.axes))
    views = [_perspective(box, float(np.radians(azimuth))) for azimuth in AZIMUTHS]
    if structure.n_nodes * structure.n_members > MAX_PAIRS:
        return views[0]
    return min(views, key=lambda view: _clutter(view, structure, node_position))


def _find_plane(axes: Sequence[int]) -> tuple[int, int]:
    """Return the axes to the right and up in pictures of a scene of one or two axes."""
    if len(axes) == 2:
        return axes[0], axes[1]
    return (0, 2) if axes[0] == 2 else (axes[0], 2)


def check_planar_direction(axes: Sequence[int], direction: Direction) -> None:
    """Raise InvalidValueError for a scene of one or two axes seen from elsewhere than along its normal."""
    plane = _find_plane(axes)
    name = next((word for word, along in ALONG.items() if along == plane), "front")
    if direction.name != name:
        letters = " and ".join("xyz"[axis] for axis in axes)
        raise InvalidValueError(
            f"a scene of {letters} alone is drawn in its plane", where="view", given=direction.name,
            allowed=name,
        )  # fmt: skip


def choose_view(
    structure: Structure, box: Box, node_position: FloatArray, direction: Direction | None
) -> View:
    """Return the view of a structure from a direction, or that of `fit_view`."""
    if direction is None:
        return fit_view(structure, box, node_position)
    if len(structure.axes) < 3:
        check_planar_direction(structure.axes, direction)
        return fit_view(structure, box, node_position)
    if direction.is_along_axis:
        return PlanarView(ALONG[direction.name], is_in_space=True)
    distance = PARALLEL_DISTANCE if direction.name == "iso" else DISTANCE
    return _perspective(box, np.radians(direction.azimuth), np.radians(direction.elevation), distance)


def _perspective(
    box: Box, azimuth: float, elevation: float = ELEVATION, distance: float = DISTANCE
) -> PerspectiveView:
    """Return the view from `azimuth` about +z and `elevation` [rad]; its rotation: right, up, to the eye."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return PerspectiveView(
        center=(box.high + box.low) / 2,
        rotation=np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]]),
        distance=distance * float(np.linalg.norm(box.high - box.low)) / 2,
    )


def _clutter(view: View, structure: Structure, node_position: FloatArray) -> float:
    """Return sum 1 / (1 + (d / near)^2) over the distances d on paper from nodes to members of others."""
    projected, _ = view.project(node_position)
    start_node, second = structure.strands.ends.T
    start, end = projected[start_node], projected[second]
    along, offset = end - start, projected[:, None] - start
    squared = np.maximum(np.sum(along**2, axis=-1), np.finfo(float).tiny)
    fraction = np.clip(np.sum(offset * along, axis=-1) / squared, 0.0, 1.0)
    distance = np.linalg.norm(offset - fraction[..., None] * along, axis=-1)
    nodes = np.arange(structure.n_nodes)[:, None]
    is_end = (nodes == start_node) | (nodes == second)
    near = CLUTTER_RATIO * float(np.max(np.ptp(projected, axis=0), initial=0.0)) or 1.0
    return float(np.sum(1.0 / (1.0 + (distance[~is_end] / near) ** 2)))
