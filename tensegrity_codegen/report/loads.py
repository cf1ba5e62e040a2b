"""Loads on nodes during a motion: of the scene, of run-time arguments, of inputs that are forces."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.bodies import BodyInput, BodySystem
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.arrays import FloatArray


def compute_loads(subject: Structure | BodySystem, motion: Trajectory | None = None) -> FloatArray:
    """Return the loads (n_t, n_nodes, 3) on nodes at each sample, by default one with those of the scene."""
    # Torques, and forces that turn with a body, are not part of them, see `describe_other_loads`.
    own = np.asarray(subject.node_load, dtype=float)
    if motion is None:
        return own[None].copy()
    stated = own if motion.node_load is None else motion.node_load
    load = np.array(np.broadcast_to(stated, (len(motion.time), subject.n_nodes, 3)))
    if motion.input is None:
        return load
    columns = {name: motion.input[:, k] for k, name in enumerate(motion.input_name)}
    for source in subject.inputs:
        if _is_force(source) and source.name in columns:
            pushed = columns[source.name][:, None, None] * np.array(source.direction)
            load[:, list(source.targets)] += pushed
    return load


def compute_static_loads(subject: Structure | BodySystem, equilibrium: Equilibrium) -> FloatArray:
    """Return the loads on nodes at an equilibrium, (n_nodes, 3) [N], as `compute_loads` does for motions."""
    load = np.array(
        subject.node_load if equilibrium.node_load is None else equilibrium.node_load, dtype=float
    )
    inputs: Sequence[ActuatedInput | BodyInput] = subject.inputs
    for source, value in zip(inputs, [] if equilibrium.input is None else equilibrium.input, strict=False):
        if _is_force(source):
            load[list(source.targets)] += float(value) * np.array(source.direction)
    return load


def _is_force(source: ActuatedInput | BodyInput) -> bool:
    """Return whether an input is a force on nodes in a constant direction."""
    return source.kind == "force" and getattr(source, "frame", "inertial") == "inertial"


def describe_other_loads(subject: Structure | BodySystem, motion: Trajectory | None = None) -> str:
    """Return a sentence on loads that compute_loads leaves out, "" if there are none.

    Inputs count where a motion has values of them other than zero.
    """
    if not isinstance(subject, BodySystem):
        return ""
    pushed = (
        set() if motion is None or motion.input is None else set(np.flatnonzero(motion.input.any(axis=0)))
    )
    names = () if motion is None else motion.input_name
    driven = {names[k] for k in pushed}
    turning = [source for source in subject.inputs if source.kind == "torque" or source.frame == "body"]
    count = len(subject.loads) + sum(
        source.name in driven for source in turning if source.kind != "rest_length"
    )
    if not count:
        return ""
    return f"{count} torques, or forces that turn with a body, are not drawn"


def compute_reactions(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray,
    held: NDArray[np.int64],
    load: FloatArray | None = None,
    joints: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Return the forces [N] of supports on nodes along the anchored axes, (n_t, n_held, 3)."""
    # NaN at joints and at nodes with a member of unknown tension; without the inertia of bars.
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    weight = mass[:, None] * structure.gravity
    row = np.full(structure.n_nodes, -1)
    row[held] = np.arange(len(held))
    pushed = np.broadcast_to(structure.node_load if load is None else load, position.shape)
    acting = pushed[:, held] + weight[held]
    strands = structure.strands
    for end, sign in ((0, -1.0), (1, 1.0)):
        chosen = np.flatnonzero(row[strands.ends[:, end]] >= 0)
        if not chosen.size:
            continue
        pair = strands.ends[chosen]
        vector = position[:, pair[:, 0]] - position[:, pair[:, 1]]
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        unit = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
        pull = sign * tension[:, strands.member[chosen], None] * unit
        np.add.at(acting.swapaxes(0, 1), row[pair[:, end]], pull.swapaxes(0, 1))
    if joints is not None:
        acting[:, np.isin(held, joints)] = np.nan
    reaction: FloatArray = np.where(structure.node_anchored[held], -acting, 0.0)
    return reaction
