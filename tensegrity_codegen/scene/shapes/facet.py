"""Shapes turned so that they stand on a facet."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.system.errors import InvalidValueError, check_choice

FLAT = 1e-9  # of the size: nodes so near to the plane of a facet are in it


def turn_onto_facet(nodes: dict[str, dict[str, Any]], names: Sequence[str], where: str) -> None:
    """Turn the nodes of a document so that three of them lie at z = 0 about the origin, all others above.

    Raises UnknownNameError, or InvalidValueError for nodes that are not a facet of the convex hull.
    """
    for name in names:
        check_choice(name, list(nodes), "node", where)
    position = np.array([item["position"] for item in nodes.values()])
    first, second, third = (np.array(nodes[name]["position"]) for name in names)
    normal, along = np.cross(second - first, third - first), second - first
    size = float(np.ptp(position, axis=0).max())
    area = float(np.linalg.norm(normal))
    height = (position - first) @ normal / max(area, 1e-300)
    if area <= FLAT * size**2 or height.min() < -FLAT * size < FLAT * size < height.max():
        raise InvalidValueError(
            "not a facet of the shape", where=where, given=", ".join(names),
            allowed="three nodes that are not on a line, with all others on one side of their plane",
        )  # fmt: skip
    up = normal / area if height.max() > -height.min() else -normal / area
    x = along / np.linalg.norm(along)
    placed = (position - (first + second + third) / 3) @ np.array([x, np.cross(up, x), up]).T
    for item, point in zip(nodes.values(), placed.tolist(), strict=True):
        item["position"] = point
