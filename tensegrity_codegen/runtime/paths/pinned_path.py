"""A path along which a structure does not turn or shift as a whole, for loads that only hold its shape."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.statics.rigid_motion import build_rigid_motions
from tensegrity_codegen.system.arrays import FloatArray

TRIAL_MOTION_RATIO = 0.1  # of the structure's size: trial motion, after which forces are computed
ZERO_FORCE_TOLERANCE = 1e-7  # part of the forces along rigid motions that counts as none


class PinnedPath:
    """The equilibria of a path with the rigid motions held that its anchors permit.

    With N an orthonormal basis of these motions at the start and P = 1 - N N^T,

        g_pinned(q, lambda) = P g(q, lambda),   N^T dq = 0

    The pins carry moments of the loads; they carry nothing where all forces are internal, so that the ends
    of the path are equilibria of the structure itself.
    """

    def __init__(self, path: ModelPath, start: FloatArray) -> None:
        self.path, self.start = path, start
        self.basis = build_rigid_motions(path.model.manifest, place_nodes(path.model, start))

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return P g, (n,)."""
        return self._project(self.path.residual(coordinate, load_factor))

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return K of the path itself, (n, n); it is used beside the pinned motions only."""
        return self.path.stiffness(coordinate, load_factor)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return P f, (n,)."""
        return self._project(self.path.load_vector(coordinate, load_factor))

    def motions(self, coordinate: FloatArray, stiffness: Any = None) -> FloatArray:
        """Return the pinned motions N, (n, k), whatever stiffness the loads give them."""
        del coordinate, stiffness
        return self.basis

    def move_to_pins(self, coordinate: FloatArray) -> FloatArray:
        """Return the nearest coordinates that the pins let the structure reach from its start."""
        return np.asarray(coordinate - self.basis @ (self.basis.T @ (coordinate - self.start)))

    def _project(self, force: FloatArray) -> FloatArray:
        return np.asarray(force - self.basis @ (self.basis.T @ force))


def pin_path(path: ModelPath, start: FloatArray) -> PinnedPath | None:
    """Return the path with its rigid motions held; None without such motions, or with forces along them.

    Forces are those at load factor 1, near `start` (n,). Gravity on a structure that hangs from a joint acts
    along a rigid motion; tensions of its own cables do not.
    """
    if not path.model.manifest.coordinate_node_axis:
        return None
    pinned = PinnedPath(path, start)
    rigid_motions = pinned.basis
    if rigid_motions.shape[1] == 0:
        return None
    # Move the structure as a whole, by a trial motion of all rigid motions together.
    position = place_nodes(path.model, start)
    size = float(np.ptp(position, axis=0).max(initial=0.0)) * np.sqrt(len(position))
    moved = start + TRIAL_MOTION_RATIO * size * rigid_motions.sum(axis=1) / rigid_motions.shape[1]
    # Forces between its own members have no component along rigid motions there either.
    force = path.static_force(moved, 1.0)
    force_along = np.linalg.norm(PinnedPath(path, moved).basis.T @ force)
    return pinned if force_along <= ZERO_FORCE_TOLERANCE * np.linalg.norm(force) else None
