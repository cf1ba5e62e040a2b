"""The tolerance that a result must meet: of the vector of each node, wherever the axes point."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

BLOCK_SIZE = 2**20  # numbers compared at a time


@dataclass(frozen=True)
class Tolerance:
    """How far a state may be off: atol + rtol |x| for the position, and the velocity, of each node.

    |x| and the error are lengths of the node's vectors. atol [m], atol_speed [m/s]; first (n_groups,): index
    of the first coordinate of each node; name (n_groups,): what to call it; length [m]: of the structure.
    Coordinates that are not positions of nodes are groups of their own, points of bodies are groups too.
    speed_share, least_speed [m/s]: where no tolerance of velocities is given, that is this share of the
    largest speed, and at least this.
    """

    rtol: float
    atol: float
    atol_speed: float
    first: IntArray
    name: tuple[str, ...]
    length: float = 1.0
    speed_share: float = 0.0
    least_speed: float = 0.0
    points: FloatArray | None = None  # (3 n_points, n_coordinates): from coordinates to points of bodies

    def measure(self, states: FloatArray) -> "Tolerance":
        """Return the tolerance with that of velocities by the largest speed in states (n_t, n_states)."""
        if not self.speed_share > 0.0:
            return self
        speed = float(self.lengths(states)[:, len(self.first) :].max(initial=0.0))
        return replace(self, atol_speed=max(self.speed_share * speed, self.least_speed))

    def lengths(self, states: FloatArray) -> FloatArray:
        """Return the lengths of the vectors in states (n_t, n_states): (n_t, 2 n_groups), positions first."""
        moving = states.reshape(len(states), 2, -1)
        if self.points is not None:
            moving = np.concatenate([moving, moving @ self.points.T], axis=2)
        squares = np.square(moving)
        return np.asarray(np.sqrt(np.add.reduceat(squares, self.first, axis=2)).reshape(len(states), -1))

    def allowed(self, states: FloatArray) -> FloatArray:
        """Return the error that is allowed of each vector of states (n_t, n_states): (n_t, 2 n_groups)."""
        lengths = self.rtol * self.lengths(states)
        lengths[:, : len(self.first)] += self.atol
        lengths[:, len(self.first) :] += self.atol_speed
        return lengths

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
    first, groups = manifest.vectors
    result = Tolerance(rtol, atol, atol if atol_speed is None else atol_speed, first, groups, length)
    nodes = np.array(manifest.body_points, dtype=np.int64)
    if not nodes.size:
        return result
    count = len(manifest.coordinate_name)
    row, column, value = manifest.node_motions
    points = np.zeros((3 * len(manifest.node_name), count))
    points[row, column] = value
    first = np.concatenate([first, count + 3 * np.arange(len(nodes))])
    names = (*groups, *(f"node {manifest.node_name[node]}" for node in nodes))
    return replace(
        result, first=first, name=names, points=points.reshape(-1, 3, count)[nodes].reshape(-1, count)
    )


def compare_runs(
    loose: RawTrajectory,
    tight: RawTrajectory,
    tolerance: Tolerance,
    *,
    part: float | Callable[[float], float] = 1.0,
    more: FloatArray | None = None,
    noise: FloatArray | None = None,
) -> Comparison:
    """Return how far two runs are apart.

    part: of a difference that counts as the error of the tight run, or the whole difference over the
    tolerance -> this; noise (2,): differences of positions [m] and velocities [m/s] that rounding causes,
    which count in full; more (2,): allowed beyond the tolerance.
    """
    if loose.status != "ok" or loose.state.shape != tight.state.shape:
        return NOT_COMPARABLE
    count, width = tight.state.shape
    rows = max(1, BLOCK_SIZE // max(width, 1))
    n_groups = len(tolerance.first)
    extra, by_rounding = (
        np.zeros(1) if pair is None else np.repeat(pair, n_groups) for pair in (more, noise)
    )

    def compare_block(start: int) -> tuple[FloatArray, FloatArray]:
        block = slice(start, start + rows)
        apart = tolerance.lengths(tight.state[block] - loose.state[block])
        return apart, extra + tolerance.allowed(tight.state[block])

    # The whole difference, and then the part that counts.
    starts = range(0, count, rows)
    blocks = [compare_block(start) for start in starts[:1]]  # the first is kept: mostly the only one
    parts = (blocks[0] if start == 0 else compare_block(start) for start in starts)
    wholes = [float(np.max(apart / allowed)) for apart, allowed in parts]
    if not np.isfinite(wholes).all():
        return NOT_COMPARABLE
    whole = max(wholes, default=0.0)
    counted = part(whole) if callable(part) else part
    found = Comparison(0.0, whole, 0.0, 0.0, "", 0.0)
    for start in starts:
        apart, allowed = blocks[0] if start == 0 else compare_block(start)
        beyond = counted * np.maximum(apart - by_rounding, 0.0)
        error = (np.minimum(apart, by_rounding) + beyond) / allowed
        row, group = divmod(int(np.argmax(error)), error.shape[1])
        worst = float(error[row, group])
        found = Comparison(
            max(found.error, worst),
            whole,
            max(found.reducible, float(np.max(beyond / allowed))),
            max(found.speed, float(apart[:, n_groups:].max(initial=0.0))),
            tolerance.place(float(tight.time[start + row]), int(group))
            if worst > found.error
            else found.where,
            float(error[-1].max()),
        )
    return found
