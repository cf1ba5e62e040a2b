"""Shapes of a scene to export: positions, tensions and loads at its start, or over a simulated motion."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tensegrity_codegen.export.exporter import ExportSource
from tensegrity_codegen.report.loads import compute_loads, describe_other_loads
from tensegrity_codegen.report.pictures.draw import find_rigid, outline_motion
from tensegrity_codegen.report.pictures.shown import find_rest_tension
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies, outline_tendons, split_at_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray


@dataclass(frozen=True)
class Shapes:
    """One shape, or those of a motion.

    structure: nodes and members, of bodies the tendons, bars, and edges of rigid bodies, of cables through
    rings their strands; time (n_t,) [s]; node_position, node_load (n_t, n_nodes, 3) [m, N]; member_tension
    (n_t, n_members) [N], NaN where unknown; notes: what these arrays do not say.
    """

    structure: Structure
    time: FloatArray
    node_position: FloatArray
    node_load: FloatArray
    member_tension: FloatArray
    notes: tuple[str, ...]


def read_shapes(source: ExportSource, trajectory: Path | None = None) -> Shapes:
    """Return the stated shape of a scene, or those of a result file of the verb `simulate`.

    Raises what `read_trajectory` raises.
    """
    subject = source.structure
    structure, motion, notes = outline_bodies(subject), None, []
    if trajectory is None:
        time, position = np.zeros(1), structure.node_position[None]
        tension = find_rest_tension(subject, find_rigid(subject, source.request))[None]
    else:
        motion = outline_motion(read_trajectory(trajectory, outline_tendons(subject)), structure)
        time, position, tension = motion.time, motion.node_position, motion.member_tension
        if motion.status != "ok":
            notes.append(f"the motion is {motion.headline()}")
    if isinstance(subject, BodySystem):
        notes.append("bodies are drawn: bars and edges of rigid bodies are members without a tension")
    other = describe_other_loads(subject, motion)
    load, tension = compute_loads(subject, motion), structure.strands.spread(tension)
    notes += [other] if other else []
    return Shapes(split_at_rings(structure), time, position, load, tension, tuple(notes))
