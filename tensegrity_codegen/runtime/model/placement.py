"""Positions and velocities of all nodes of a state, and the poles of bodies' angles."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest

# What a model must compute whose coordinates are no node coordinates, so that its nodes can be placed.
NODE_QUANTITIES = ("node_position", "node_velocity")
# Sine of the angle to the pole of its chart below which a body's angles are not to be trusted.
NEAR_POLE = 1e-3
# The same, below which a configuration is not looked at.
NEAREST_POLE = 1e-6


def build_node_matrix(manifest: Manifest) -> Any:
    """Return how nodes move with coordinates that are theirs, sparse (3 n_nodes, n_coordinates)."""
    import scipy  # which motions do not need

    row, column, value = manifest.node_motions
    shape = (3 * len(manifest.node_name), len(manifest.coordinate_node_axis))
    return scipy.sparse.csr_array((value, (row, column)), shape=shape)


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
        values = {**(arguments or {}), "coordinate": coordinate}
        result[:, list(manifest.axes)] = model.compute("node_position", **values)
        return result
    changeable = manifest.find_argument("anchor_position")
    if anchor_position is not None and changeable is not None:
        rows = [manifest.node_name.index(name) for name in changeable.over]
        result[np.ix_(rows, list(manifest.axes))] = np.reshape(anchor_position, changeable.shape)
    node_axis = manifest.coordinate_place
    result[node_axis[:, 0], node_axis[:, 1]] = coordinate
    for body in manifest.body_places:
        body.attach(result)
    return result


def place_velocities(
    model: Model, coordinate: FloatArray, velocity: FloatArray, *, arguments: Mapping[str, Any] | None = None
) -> FloatArray:
    """Return node velocities (n_nodes, 3) [m/s] of a state; zero on anchored and dropped axes."""
    manifest = model.manifest
    result = np.zeros((len(manifest.node_name), 3))
    if not manifest.coordinate_node_axis:
        values = {**(arguments or {}), "coordinate": coordinate, "velocity": velocity}
        result[:, list(manifest.axes)] = model.compute("node_velocity", **values)
        return result
    node_axis = manifest.coordinate_place
    result[node_axis[:, 0], node_axis[:, 1]] = velocity
    for body in manifest.body_places:
        body.attach(result)
    return result


def name_charts(manifest: Manifest) -> list[str]:
    """Return the names of the bodies that have angles, in the order of `chart_margin`."""
    names = (name.rpartition("_") for name in manifest.coordinate_name)
    return list(dict.fromkeys(body for body, _, _ in names))


def judge_charts(
    model: Model, time: FloatArray, coordinate: FloatArray, status: str, message: str
) -> tuple[str, str]:
    """Return "at_pole" where a body is near the pole of its angles or passes it, else status and message."""
    margin = np.array([model.compute("chart_margin", coordinate=row) for row in coordinate])
    bad = (np.abs(margin) < NEAR_POLE) | (np.sign(margin) != np.sign(margin[0]))
    if not bad.any():
        return status, message
    row = int(np.argmax(bad.any(axis=1)))
    chart = int(np.argmax(bad[row]))
    angles = name_charts(model.manifest)[chart]
    event = f"by t = {time[row]:.6g} s the body {angles!r} has reached the pole of its angles"
    return "at_pole", f"{event} (margin {margin[row, chart]:.3g}): give it another polar_axis"
