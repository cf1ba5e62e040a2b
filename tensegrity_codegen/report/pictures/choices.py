"""Choices of a reader for a picture: direction, size, names, colours, axes that follow."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
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
    """From where a structure is seen.

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
    size: width and height in pixels; None: what suits the structure.
    labels: what has its names written: ``"nodes"``, ``"members"``.
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
