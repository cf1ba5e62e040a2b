"""Whether a structure lies on its side: made for y up, and used with z up."""

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure

MIN_SUPPORT_NODES = 3  # nodes that a structure stands on
# Extent along y over the largest, below which the structure stands upright in a plane.
MAX_FLAT_EXTENT_RATIO = 0.05
HEIGHT_TOLERANCE = 1e-6  # of the structure's size


def warn_of_side(structure: Structure) -> list[str]:
    """Return a warning where gravity acts along z, and the structure stands on y = least, and not on z.

    It stands on y where three nodes or more have the least y and do not lie on a line, all that are anchored
    (if any) are among them, and less than three have the least z.
    """
    if len(structure.axes) < 3 or int(np.argmax(np.abs(structure.gravity))) != 2:
        return []
    if not structure.gravity[2] or not structure.n_nodes:
        return []
    feet_y, feet_z = (_find_feet(structure.node_position, axis) for axis in (1, 2))
    extent = np.ptp(structure.node_position, axis=0)
    if (
        extent[1] < MAX_FLAT_EXTENT_RATIO * extent.max()
        or feet_y.sum() < MIN_SUPPORT_NODES
        or feet_z.sum() >= MIN_SUPPORT_NODES
    ):
        return []
    if _is_line(structure.node_position[feet_y]):
        return []
    held = structure.node_anchored.any(axis=1)
    if held.any() and (held & ~feet_y).any():
        return []
    names = [name for name, foot in zip(structure.node_name, feet_y, strict=True) if foot]
    return [
        f"the structure seems to lie on its side: {len(names)} nodes ({', '.join(names[:3])}, ...) are "
        f"lowest in y and {int(feet_z.sum())} in z, but gravity acts along z; if y is up, use gravity = "
        f"[0, {structure.gravity[2]:g}, 0], or import with --up y, which turns the structure upright"
    ]


def _find_feet(position: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Return which nodes lie lowest along an axis, (n_nodes,)."""
    size = float(np.ptp(position, axis=0).max())
    feet: NDArray[np.bool_] = position[:, axis] <= position[:, axis].min() + HEIGHT_TOLERANCE * size
    return feet


def _is_line(points: NDArray[np.float64]) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= HEIGHT_TOLERANCE * spread[0])
