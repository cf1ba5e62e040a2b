"""Vibrations of stiff members that damped cables excite: their force jumps where they go taut."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.accuracy.vibrations.kinks import RESOLVED, SPREAD
from tensegrity_codegen.runtime.integrate.event_log import choose_watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.system.arrays import FloatArray


def bound_jumps(motion: Motion, raw: RawTrajectory, stiff: tuple[int, ...], frequency: float) -> FloatArray:
    """Return bounds of amplitudes [m], speeds [m/s], tensions [N]: sums of c |l'| at a member, over its mu.

    Of the cables that the run pulls taut, and those whose events it does not watch; |l'| is the largest at
    any sample. Vibrations that the steps resolve do not count. stiff: the members; frequency [rad/s]: the
    fastest of their vibrations.
    """
    model = motion.model
    law = np.asarray(model.compute("member_law", **motion.arguments))
    mu, c = law[:, 1], law[:, 2] * _may_jump(motion, raw)
    c[list(stiff)] = 0.0
    if not c.any() or frequency * SPREAD * float(raw.time[-1]) < RESOLVED * raw.n_steps:
        return np.zeros(3)
    ends = np.array(model.manifest.connectivity, dtype=np.int64)
    force = np.zeros(len(model.manifest.node_name))
    jump = c * _fastest(model, raw, ends, motion.arguments)
    for end in (0, 1):
        np.add.at(force, ends[:, end], jump)
    chosen = np.array([e for e in stiff if mu[e] > 0], dtype=np.int64)
    pull = force[ends[chosen, 0]] + force[ends[chosen, 1]]
    largest = float((pull / mu[chosen]).max(initial=0.0))
    return np.array([largest, largest * frequency, float(pull.max(initial=0.0))])


def _may_jump(motion: Motion, raw: RawTrajectory) -> NDArray[np.bool_]:
    """Return which members go taut in a run, or may have done so unseen, (n_members,)."""
    manifest = motion.model.manifest
    spec = next(item for item in manifest.integrators if item.name == "radau")
    if "cable" not in choose_watch(spec, manifest, motion.watch).kinds or raw.log.count > len(raw.log.time):
        return np.ones(len(manifest.member_name), dtype=np.bool_)
    taut = {name for name, direction in zip(raw.log.name, raw.log.direction, strict=True) if direction > 0}
    watched = {manifest.member_name[member] for member in spec.cables}
    return np.array([name in taut or name not in watched for name in manifest.member_name])


def _fastest(
    model: CompiledModel, raw: RawTrajectory, ends: NDArray[np.int64], arguments: Mapping[str, Any]
) -> FloatArray:
    """Return the largest rate of each member's length at any sample, (n_members,) [m/s]."""
    n, fastest = raw.state.shape[1] // 2, np.zeros(len(ends))
    anchors = arguments.get("anchor_position")
    for state in raw.state:
        position = place_nodes(model, state[:n], anchors, arguments=arguments)
        velocity = place_velocities(model, state[:n], state[n:], arguments=arguments)
        vector = position[ends[:, 0]] - position[ends[:, 1]]
        moving = velocity[ends[:, 0]] - velocity[ends[:, 1]]
        length = np.maximum(np.linalg.norm(vector, axis=1), 1e-300)
        fastest = np.maximum(fastest, np.abs(np.sum(vector * moving, axis=1)) / length)
    return fastest
