"""From where a structure is looked at first: space from above one corner, a plane along its normal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["choose_view"]

SPACE = (1.0, -1.6, 0.62)
GROUND_GAP = 0.06  # of the size, between supported nodes and the grid


def choose_view(axes: Sequence[int], *, is_supported: bool) -> dict[str, Any]:
    """Return direction to the observer, upward axis, the two axes of the grid, and its distance below.

    axes: modelled axes; is_supported: whether supports are drawn below nodes.
    """
    found = tuple(axes)
    if len(found) >= 3:
        gap = GROUND_GAP if is_supported else 0.0
        return _describe(SPACE, 2, (0, 1), is_planar=False, gap=gap)
    if found == (0, 1):
        return _describe((0.0, 0.0, 1.0), 1, (0, 1), is_planar=True)
    if 1 in found:
        return _describe((1.0, 0.0, 0.0), 2, (1, 2), is_planar=True)
    return _describe((0.0, -1.0, 0.0), 2, (0, 2), is_planar=True)


def _describe(
    view: tuple[float, float, float], up: int, ground: tuple[int, int], *, is_planar: bool, gap: float = 0.0
) -> dict[str, Any]:
    upward = [float(axis == up) for axis in range(3)]
    return {"view": view, "up": upward, "ground": ground, "is_planar": is_planar, "ground_gap": gap}
