"""Between free coordinates and node positions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.interface import Model

__all__ = ["place_nodes"]

FloatArray = NDArray[np.float64]


def place_nodes(model: Model, coordinate: FloatArray, anchor_position: Any = None) -> FloatArray:
    """Return node positions (n_nodes, 3) [m] of free coordinates (n_coordinates,).

    anchor_position: run-time positions (k, n_axes) of the changeable anchored nodes, if any; ignored by a
    model that keeps none changeable.
    """
    manifest = model.manifest
    result = np.array(manifest.node_position, dtype=np.float64)
    changeable = next((item for item in manifest.arguments if item.name == "anchor_position"), None)
    if anchor_position is not None and changeable is not None:
        rows = [manifest.node_name.index(name) for name in changeable.over]
        result[np.ix_(rows, list(manifest.axes))] = np.reshape(anchor_position, changeable.shape)
    places = np.array(manifest.coordinate_node_axis)
    result[places[:, 0], places[:, 1]] = coordinate
    return result
