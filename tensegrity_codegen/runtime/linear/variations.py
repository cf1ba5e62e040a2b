"""Which variations of a state the constraints between its coordinates allow."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.model.rigid_bars import RigidBars

# What a model in redundant coordinates is asked for: its columns span the variations that can happen.
SPANNING_QUANTITY = "distance_inertia_inverse"
RANK_TOLERANCE = 1e-10  # of the largest eigenvalue


@dataclass(frozen=True)
class Variations:
    """T = [Z 0; W Z] (n_states, n_variations) with Z^T Z = 1, Z^T W = 0: variations T p that can happen.

    T moves with the state. With Z' = W (the frame that turns least) and L = [Z^T 0; 0 Z^T], L T = 1, the
    linear model of p is p' = (L A T - L T') p, L T' = [0 0; -W^T W 0].
    """

    along: Any  # Z
    turning: Any  # W

    @property
    def basis(self) -> Any:
        """Return T, sparse."""
        empty = scipy.sparse.csc_array(self.along.shape)
        return scipy.sparse.block_array([[self.along, empty], [self.turning, self.along]], format="csc")

    def reduce(self, state_matrix: Any) -> Any:
        """Return L A T - L T', sparse (n_variations, n_variations), of A (n_states, n_states)."""
        left = scipy.sparse.csc_array(scipy.sparse.block_diag([self.along, self.along])).T
        empty = scipy.sparse.csc_array((self.along.shape[1],) * 2)
        frame = scipy.sparse.block_array([[empty, empty], [self.turning.T @ self.turning, empty]])
        return scipy.sparse.csc_array(left @ state_matrix @ self.basis + frame)


def find_variations(model: Model, at: Mapping[str, Any]) -> Variations | None:
    """Return the variations of a state x = (q, q') that can happen, None where all can.

    Rigid bars allow those with d_b . d(dq) = 0 and d_b . d(dq') + d_b' . d(dq) = 0, where d(.) is the
    difference of both ends. at: all arguments of the model, with coordinate and velocity.
    """
    if model.manifest.rigid_bar:
        return _along_bars(model, at)
    if model.has(SPANNING_QUANTITY):
        size, direction = np.linalg.eigh(model.compute(SPANNING_QUANTITY, **at).toarray())
        along = scipy.sparse.csc_array(direction[:, size > RANK_TOLERANCE * size.max()])
        return Variations(along, scipy.sparse.csc_array(along.shape))
    return None


def _along_bars(model: Model, at: Mapping[str, Any]) -> Variations:
    """Return the variations that rigid bars of constant lengths allow."""
    bars = RigidBars(model.manifest, np.zeros(len(model.manifest.rigid_bar)))
    position = place_nodes(model, at["coordinate"], at.get("anchor_position"))
    along = bars.find_directions(bars.jacobian(position))
    if not np.any(at["velocity"]):
        return Variations(along, scipy.sparse.csc_array(along.shape))
    rate = bars.rows(bars.vectors(place_velocities(model, at["coordinate"], at["velocity"])))
    rows = bars.rows(bars.vectors(position)).toarray()
    turning = np.linalg.lstsq(rows, -(rate @ along).toarray(), rcond=None)[0]
    return Variations(along, scipy.sparse.csc_array(turning))
