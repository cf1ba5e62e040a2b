"""What a reader may choose of a picture: direction, size, names, colours, axes that follow."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from tensegrity_codegen.system.errors import InvalidValueError, check_choice

LABELS = ("nodes", "members")
COLORS = ("tension", "force_density", "stress", "kind")
NAMED_VIEWS = ("iso", "front", "side", "top")
VIEW_TEXT = "iso, front, side, top, or AZIMUTH,ELEVATION in degrees, elevation from -90 to 90"
SMALLEST, LARGEST = 200, 10_000  # pixels of a side

Size: TypeAlias = tuple[int, int]
Labels: TypeAlias = bool | str | Iterable[str]


@dataclass(frozen=True)
class Direction:
    """From where a structure is seen.

    Attributes
    ----------
    name : str
        ``"iso"``, ``"front"``, ``"side"``, ``"top"``, or the text that was given.
    azimuth, elevation : float [deg]
        Of the eye: about +z from +x, and above the ground.
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

    Attributes
    ----------
    view : Direction or None
        None: the direction from which the fewest members hide nodes.
    size : tuple of int or None
        Width and height in pixels; None: what suits the structure.
    labels : tuple of str
        What has its names written: ``"nodes"``, ``"members"``.
    color : str
        One of COLORS.
    follow : bool
        Whether the axes move with the centroid of the nodes.
    forces : bool
        Whether loads and reactions are drawn.
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

    Parameters
    ----------
    text : str, pair of float or None
        ``"iso"``, ``"front"`` (along y), ``"side"`` (along x), ``"top"`` (along z), ``"AZIMUTH,ELEVATION"``
        or these two numbers [deg].

    Returns
    -------
    Direction or None
        None for None.

    Raises
    ------
    InvalidValueError
        No such view.
    """
    if text is None:
        return None
    if isinstance(text, str) and text.strip().lower() in _NAMED:
        return _NAMED[text.strip().lower()]
    try:
        parts = text.split(",") if isinstance(text, str) else text
        azimuth, elevation = (float(part) for part in parts)
    except (TypeError, ValueError):
        azimuth = elevation = math.nan
    if not (math.isfinite(azimuth) and -90.0 <= elevation <= 90.0):
        raise InvalidValueError(
            "unknown view", where="view", given=text, allowed=VIEW_TEXT, hint="for example -60,16"
        )
    return Direction(f"{azimuth:g},{elevation:g}", azimuth, elevation)


def read_size(text: str | tuple[int, int] | None) -> Size | None:
    """Return width and height in pixels of ``"1200x900"`` or (1200, 900); None for None.

    Raises InvalidValueError for another text, or a side out of range.
    """
    if text is None:
        return None
    if isinstance(text, str):
        found = re.fullmatch(r"\s*(\d{1,9})\s*[x×X]\s*(\d{1,9})\s*", text)
        sides = tuple(int(side) for side in found.groups()) if found else ()
    else:
        try:
            sides = tuple(int(side) for side in text if float(side).is_integer())
        except (TypeError, ValueError):
            sides = ()
    if len(sides) != 2 or not all(SMALLEST <= side <= LARGEST for side in sides):
        raise InvalidValueError(
            "not a size",
            where="size",
            given=text,
            allowed=f"WIDTHxHEIGHT in pixels, each from {SMALLEST} to {LARGEST}",
            hint="for example 1200x900",
        )
    return sides[0], sides[1]


def read_labels(given: Labels) -> tuple[str, ...]:
    """Return which names are written, of LABELS.

    Parameters
    ----------
    given : bool, str or sequence of str
        True: both; False or ``"none"``: no names; ``"nodes"``, ``"members"``, several separated by commas.

    Returns
    -------
    tuple of str
        ``"nodes"``, ``"members"`` or both.

    Raises
    ------
    InvalidValueError
        Another word, or ``"none"`` with others.
    """
    if isinstance(given, bool):
        return LABELS if given else ()
    try:
        items = given.split(",") if isinstance(given, str) else [str(item) for item in given]
    except TypeError:
        items = [str(given)]
    words = [word.strip().lower() for item in items for word in item.split(",") if word.strip()]
    known = set(words) <= {*LABELS, "none"}
    if not known or ("none" in words and len(set(words)) > 1) or (items and not words):
        raise InvalidValueError(
            "unknown labels", where="labels", given=given if isinstance(given, str) else ",".join(items),
            allowed="nodes, members, both separated by a comma, or none",
        )  # fmt: skip
    return tuple(word for word in LABELS if word in words)
