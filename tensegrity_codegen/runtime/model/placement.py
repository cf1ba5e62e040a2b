"""From coordinates to nodes: placed by the manifest where coordinates are theirs, else by the model."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.arrays import FloatArray

# What a model must compute whose coordinates are no node coordinates, so that its nodes can be placed.
NODE_QUANTITIES = ("node_position", "node_velocity")


def place_nodes(
    model: Model,
    coordinate: FloatArray,
    anchor_position: Any = None,
    *,
    arguments: Mapping[str, Any] | None = None,
) -> FloatArray:
    """Return node positions (n_nodes, 3) [m] of coordinates (n_coordinates,).

    anchor_position: run-time positions (k, n_axes) of the changeable anchored nodes, if any; ignored by a
    model that keeps none changeable. arguments: other run-time arguments, used by a model whose coordinates
    are no node coordinates; it must compute `node_position`, else UnknownNameError.
    """
    manifest = model.manifest
    result = manifest.stated_position.copy()
    if not manifest.coordinate_node_axis:
        given = {**(arguments or {}), "coordinate": coordinate}
        result[:, list(manifest.axes)] = model.compute("node_position", **given)
        return result
    changeable = next((item for item in manifest.arguments if item.name == "anchor_position"), None)
    if anchor_position is not None and changeable is not None:
        rows = [manifest.node_name.index(name) for name in changeable.over]
        result[np.ix_(rows, list(manifest.axes))] = np.reshape(anchor_position, changeable.shape)
    places = manifest.coordinate_place
    result[places[:, 0], places[:, 1]] = coordinate
    return result


def place_velocities(
    model: Model,
    coordinate: FloatArray,
    velocity: FloatArray,
    *,
    arguments: Mapping[str, Any] | None = None,
) -> FloatArray:
    """Return node velocities (n_nodes, 3) [m/s] of a state; zero on anchored and dropped axes.

    arguments: other run-time arguments, used by a model whose coordinates are no node coordinates; it must
    compute `node_velocity`, else UnknownNameError.
    """
    manifest = model.manifest
    result = np.zeros((len(manifest.node_name), 3))
    if not manifest.coordinate_node_axis:
        given = {**(arguments or {}), "coordinate": coordinate, "velocity": velocity}
        result[:, list(manifest.axes)] = model.compute("node_velocity", **given)
        return result
    places = manifest.coordinate_place
    result[places[:, 0], places[:, 1]] = velocity
    return result
