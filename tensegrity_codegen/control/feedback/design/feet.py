"""Feet on the ground under feedback: bristles that follow their nodes while feet stick, and how feet slip.

While a contact sticks its bristle moves as its node does: s = F q - p is no state of its own. The point p
where it sticks moves where the contact slips or is open; inner forces do not bring it back.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion, MotionPoint
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError

SLIPPED = 1e-5  # of the size of a structure: motion of the point where a foot sticks that is reported


def find_following(model: Described) -> FloatArray:
    """Return F (n_internal, n_coordinates): derivatives of bristles by coordinates while contacts stick."""
    manifest, structure = model.manifest, model.structure
    if not manifest.internal_name:
        return np.zeros((0, len(manifest.coordinate_name)))
    ground: Any = getattr(structure, "ground", None)
    node, axis = manifest.coordinate_place.T
    tangents = ground.tangents(tuple(manifest.axes))[:, axis]
    rows: FloatArray = tangents * (ground.node[:, None, None] == node)
    return rows.reshape(-1, len(node))


def find_bristles(model: Described, point: MotionPoint, coordinate: FloatArray) -> dict[str, FloatArray]:
    """Return the argument `internal` at coordinates near a point of a motion; {} without friction."""
    following = find_following(model)
    moved = following @ (coordinate - point.coordinate)
    return {"internal": point.internal + moved} if len(following) else {}


def check_still_feet(model: Described, motion: Motion, what: str) -> None:
    """Raise FormulationError for a motion on which contacts do not stay as they are at its start."""
    if (motion.internal != motion.internal[:1]).any():
        raise FormulationError(
            f"{what} needs feet that stick where they stand",
            where=model.manifest.name,
            given=f"a motion of {motion.duration:g} s in which forces of the ground change",
            allowed="an Equilibrium, or a motion away from the ground",
            hint="follow this motion by the gains of design_lqr",
        )


def hold_feet(structure: Subject, model: Described, motion: Motion) -> Subject:
    """Return a structure whose contacts stick where they do at the start of a motion, without bristles."""
    if not model.manifest.internal_name:
        return structure
    start, ground = motion.at(0.0), getattr(structure, "ground", None)
    assert ground is not None
    place = find_following(model) @ start.coordinate - start.internal
    held = replace(ground, stick_point=place.reshape(ground.n_contacts, -1))
    changed: Subject = structure.with_changes(ground=held)
    return changed


def measure_slip(model: CompiledModel, state: FloatArray) -> tuple[FloatArray | None, str]:
    """Return how far the points have moved where feet stick, and a sentence about the feet that did not stay.

    state (n_t, n_states + n_internal): at the samples.
    Returns slip (n_t, n_contacts) [m], zero for contacts that are open at the first sample, None without
        friction; the sentence is empty where all others stick.
    """
    following, n = find_following(model), len(model.manifest.coordinate_name)
    if not len(following):
        return None, ""
    structure: Any = model.structure
    depth = np.array([structure.ground.compute_depth(place_nodes(model, q)) for q in state[:, :n]])
    stuck = state[:, :n] @ following.T - state[:, 2 * n :]
    moved = np.linalg.norm((stuck - stuck[0]).reshape(*depth.shape, -1), axis=2) * (depth[0] > 0.0)
    least = SLIPPED * float(np.ptp(place_nodes(model, state[0, :n]), axis=0).max())
    names, words = model.manifest.contact_name, []
    for c in np.flatnonzero((moved > least).any(axis=0)).tolist():
        verb = "lifts" if (depth[:, c] <= 0.0).any() else "slips"
        words.append(f"{names[c]} {verb}, {1000 * moved[-1, c]:.3g} mm at the end")
    return moved, f"feet do not stay where they stick: {'; '.join(words)}" if words else ""
