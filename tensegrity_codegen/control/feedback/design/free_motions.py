"""Rigid motions of a whole structure that its actuators cannot change."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.statics.neutral_motion import NeutralMotions
from tensegrity_codegen.runtime.statics.rigid_motion import build_rigid_motions
from tensegrity_codegen.system.arrays import FloatArray

NOTHING = 1e-9  # of the largest effect of any actuator


def name_free_motions(
    model: CompiledModel, coordinate: FloatArray, gain: FloatArray, arguments: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return the rigid motions that no actuator changes, such as "slide along x".

    Parameters
    ----------
    model : CompiledModel
        With `mass_matrix`; of bodies none are found.
    coordinate : ndarray, shape (n_coordinates,)
        Configuration.
    gain : ndarray, shape (n_coordinates, n_actuators)
        Derivatives of the accelerations by the actuators' inputs.
    arguments : mapping
        Run-time parameters where they differ from the scene.

    Returns
    -------
    tuple of str
        Names; empty where the anchors permit no rigid motion.

    Notes
    -----
    Rigid motions R for which R^T M gain = 0: internal forces change neither momentum.
    """
    manifest = model.manifest
    if not manifest.coordinate_node_axis or not model.has("mass_matrix"):
        return ()
    position = place_nodes(model, coordinate, arguments.get("anchor_position"), arguments=arguments)
    rigid = build_rigid_motions(manifest, position)
    mass = model.compute("mass_matrix", **{**arguments, "coordinate": coordinate})
    effect = rigid.T @ (mass @ gain)
    scale = np.linalg.norm(mass @ gain)
    left, size, _ = np.linalg.svd(effect)
    rank = int((size > NOTHING * scale).sum())
    free = rigid @ left[:, rank:]
    velocity = np.zeros((len(position), 3, free.shape[1]))
    node, axis = manifest.coordinate_place.T
    velocity[node, axis] = free
    local = position - position.mean(axis=0)
    whole = np.array([(np.cross(turn[:3], local) + turn[3:]).ravel() for turn in np.eye(6)]).T
    twist = np.linalg.lstsq(whole, velocity.reshape(-1, free.shape[1]), rcond=None)[0].T
    return NeutralMotions(position.mean(axis=0), twist, np.zeros((len(position), 3, 0))).names
