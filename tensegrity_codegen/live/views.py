"""From where a structure is looked at first: space from above one corner, a plane along its normal."""

import math
from collections.abc import Sequence
from typing import Any

from tensegrity_codegen.report.pictures.choices import NAMED_VIEWS, Direction
from tensegrity_codegen.report.pictures.view import check_planar_direction

SPACE = (1.0, -1.6, 0.62)
GROUND_GAP = 0.06  # of the size, between supported nodes and the grid


def choose_view(
    axes: Sequence[int], *, is_supported: bool, direction: Direction | None = None
) -> dict[str, Any]:
    """Return direction to the observer, upward axis, the two axes of the grid, and its distance below.

    Named views (top, iso ...) and those of planar scenes are parallel projections (is_flat), as in pictures.

    axes: modelled axes; is_supported: whether supports are drawn below nodes; direction: chosen by a reader.
    Raises InvalidValueError for a planar scene that is seen from elsewhere than along its normal.
    """
    found = tuple(axes)
    if len(found) >= 3:
        gap = GROUND_GAP if is_supported else 0.0
        eye = SPACE if direction is None else _find_eye(direction)
        is_flat = direction is not None and direction.name in NAMED_VIEWS
        return _describe(eye, 2, (0, 1), is_planar=False, gap=gap) | {"is_flat": is_flat}
    if direction is not None:
        check_planar_direction(found, direction)
    if found == (0, 1):
        return _describe((0.0, 0.0, 1.0), 1, (0, 1), is_planar=True)
    if 1 in found:
        return _describe((1.0, 0.0, 0.0), 2, (1, 2), is_planar=True)
    return _describe((0.0, -1.0, 0.0), 2, (0, 2), is_planar=True)


def _find_eye(direction: Direction) -> tuple[float, float, float]:
    """Return the direction to the observer; one along the upward axis leans back a little."""
    azimuth, elevation = math.radians(direction.azimuth), math.radians(direction.elevation)
    flat = max(math.cos(elevation), 1e-4)
    return flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)


def _describe(
    view: tuple[float, float, float], up: int, ground: tuple[int, int], *, is_planar: bool, gap: float = 0.0
) -> dict[str, Any]:
    upward = [float(axis == up) for axis in range(3)]
    return {
        "view": view, "up": upward, "ground": ground, "ground_gap": gap,
        "is_planar": is_planar, "is_flat": is_planar, "space": SPACE,
    }  # fmt: skip
