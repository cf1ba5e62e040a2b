"""The tolerance that a result must meet: of the vector of each node, wherever the axes point."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import Manifest

BLOCK_SIZE = 2**20  # numbers compared at a time


@dataclass(frozen=True)
class Tolerance:
    """How far a state may be off: atol + rtol |x| for the position, and the velocity, of each node.

    |x| and the error are lengths of the node's vectors. atol [m], atol_speed [m/s]; first (n_groups,): index
    of the first coordinate of each node; name (n_groups,): what to call it; length [m]: of the structure.
    Coordinates that are not positions of nodes are groups of their own.
    """

    rtol: float
    atol: float
    atol_speed: float
    first: IntArray
    name: tuple[str, ...]
    length: float = 1.0

    def lengths(self, states: FloatArray) -> FloatArray:
        """Return the lengths of the vectors in states (n_t, n_states): (n_t, 2 n_groups), positions first."""
        n = states.shape[1] // 2
        first = np.concatenate([self.first, n + self.first])
        return np.asarray(np.sqrt(np.add.reduceat(states**2, first, axis=1)))

    def allowed(self, states: FloatArray) -> FloatArray:
        """Return the error that is allowed of each vector of states (n_t, n_states): (n_t, 2 n_groups)."""
        atol = np.repeat([self.atol, self.atol_speed], len(self.first))
        return np.asarray(atol + self.rtol * self.lengths(states))

    def place(self, time: float, group: int) -> str:
        """Return the words for a vector at a time [s]."""
        kind = "position" if group < len(self.first) else "velocity"
        return f"in the {kind} of {self.name[group % len(self.first)]} at t = {time:.4g} s"


class Comparison(NamedTuple):
    """How far two runs are apart, over the tolerance.

    error: the part that counts as the error of the tighter run; whole: all of it; reducible: the error beyond
    rounding; speed [m/s]: the largest difference of a velocity; where: the words for the worst vector;
    end: the error at the last time.
    """

    error: float
    whole: float
    reducible: float
    speed: float
    where: str
    end: float = np.inf


NOT_COMPARABLE = Comparison(np.inf, np.inf, np.inf, np.inf, "")  # where a run ended early


def tolerance_for(
    manifest: Manifest, rtol: float, atol: float, atol_speed: float | None = None, length: float = 1.0
) -> Tolerance:
    """Return the tolerance of a model's states; atol_speed: the same number as atol if not given."""
    place, names = manifest.coordinate_place, manifest.coordinate_name
    if find_formulation(manifest.formulation).in_nodes and len(place) == len(names):
        first = np.flatnonzero(np.diff(place[:, 0], prepend=-1))
        groups = tuple(f"node {manifest.node_name[node]}" for node in place[first, 0])
    else:
        first, groups = np.arange(len(names)), tuple(f"coordinate {name}" for name in names)
    return Tolerance(rtol, atol, atol if atol_speed is None else atol_speed, first, groups, length)


def compare_runs(
    loose: RawTrajectory,
    tight: RawTrajectory,
    tolerance: Tolerance,
    *,
    part: float = 1.0,
    more: FloatArray | None = None,
    noise: FloatArray | None = None,
) -> Comparison:
    """Return how far two runs are apart.

    part: of a difference that counts as the error of the tight run; noise (2,): differences of positions [m]
    and velocities [m/s] that rounding causes, which count in full; more (2,): allowed beyond the tolerance.
    """
    if loose.status != "ok" or loose.state.shape != tight.state.shape:
        return NOT_COMPARABLE
    count, width = tight.state.shape
    rows = max(1, BLOCK_SIZE // max(width, 1))
    found = Comparison(0.0, 0.0, 0.0, 0.0, "", 0.0)
    n_groups = len(tolerance.first)
    extra, by_rounding = (
        np.repeat(np.zeros(2) if pair is None else pair, n_groups) for pair in (more, noise)
    )
    for start in range(0, count, rows):
        block = slice(start, start + rows)
        apart = tolerance.lengths(tight.state[block] - loose.state[block])
        if not np.isfinite(apart).all():
            return NOT_COMPARABLE
        allowed = extra + tolerance.allowed(tight.state[block])
        beyond = part * np.maximum(apart - by_rounding, 0.0)
        error = (np.minimum(apart, by_rounding) + beyond) / allowed
        row, group = np.unravel_index(int(np.argmax(error)), error.shape)
        worst = float(error[row, group])
        found = Comparison(
            max(found.error, worst),
            max(found.whole, float(np.max(apart / allowed))),
            max(found.reducible, float(np.max(beyond / allowed))),
            max(found.speed, float(apart[:, n_groups:].max(initial=0.0))),
            tolerance.place(float(tight.time[start + row]), int(group))
            if worst > found.error
            else found.where,
            float(error[-1].max()),
        )
    return found
