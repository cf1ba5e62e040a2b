"""Members that are much stiffer than the others: steps keep to the lengths that their tensions ask for.

A straight step s stretches a turning bar of length l by s^2 / 2 l, which a stiff bar answers with a huge
force; steps along the tangent are therefore tiny, or fail. Here a step leads to the nearest configuration
in which each stiff member has the length l + J s of its linear prediction, J = dl/dq. Along such a curve
the energy is, to second order, that of the Hessian in which the tensions of stiff members are those that
balance the other forces best,

    t* = t + argmin |f - J^T dt|,     K* = K + sum_b (t*_b - t_b) d2l_b/dq2

so that neither step lengths nor the number of steps depend on how stiff these members are. In equilibrium
K* = K. (Forces of stiff members as unknowns: D. Magisano, L. Leonetti, G. Garcea, "How to improve
efficiency and robustness of the Newton method in geometrically non-linear structural problem discretized
via displacement-based finite elements", Computer Methods in Applied Mechanics and Engineering 313, 2017;
steps along curves: P.-A. Absil, C. G. Baker, K. A. Gallivan, "Trust-region methods on Riemannian
manifolds", Foundations of Computational Mathematics 7, 2007.)

Tensions k (l - l0) of stiff members are only known to k times the rounding of l; within that, those count
that balance the other forces.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.rigid_bars import EPSILON, RigidBars
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.tables.manifest import Manifest

MIN_RATIO = 10.0  # between the stiffness of stiff members and that of the next softer one
ROUNDING = 512 * EPSILON  # of length and distance from the origin: rounding of the length of a stiff member
PROBE = 1e-6  # of the longest member: displacement that shows how stiff members are
MAX_CORRECTION_RATIO = 1.0  # largest correction of a step, as part of the step


def find_spring_constants(compute: Callable[[str, FloatArray], Any], coordinate: FloatArray) -> FloatArray:
    """Return |dt/dl| of members by a small displacement, (..., n_members) [N/m]; 0 if it moves none."""
    tension, length = (np.array(compute(name, coordinate)) for name in ("member_tension", "member_length"))
    distance = PROBE * length.max(axis=-1, initial=0.0, keepdims=True)
    displaced = coordinate + distance * np.random.default_rng(0).uniform(-1.0, 1.0, coordinate.shape[-1])
    change = np.abs(np.asarray(compute("member_length", displaced)) - length)
    force = np.abs(np.asarray(compute("member_tension", displaced)) - tension)
    moved = change > 1e-3 * distance
    return np.where(moved, force / np.where(moved, change, 1.0), 0.0)


def choose_stiff(spring_constant: FloatArray) -> IntArray:
    """Return the numbers of members above the widest gap of spring constants, none if it is narrow."""
    return np.flatnonzero(are_stiff(spring_constant))


def are_stiff(spring_constant: FloatArray) -> BoolArray:
    """Return which members of each case are above the widest gap between its spring constants."""
    order = np.sort(spring_constant, axis=-1)
    below = order[..., :-1]
    ratio = np.where(below > 0.0, order[..., 1:] / np.where(below > 0.0, below, 1.0), 0.0)
    if not ratio.shape[-1]:
        return np.zeros(spring_constant.shape, dtype=np.bool_)
    widest = ratio.argmax(axis=-1)[..., None]
    is_wide = np.take_along_axis(ratio, widest, axis=-1) >= MIN_RATIO
    return np.asarray(is_wide & (spring_constant >= np.take_along_axis(order, widest + 1, axis=-1)))


class StiffMembers:
    """The stiff members of a static problem; row: their numbers, spring_constant: theirs (n_stiff,) [N/m]."""

    def __init__(self, manifest: Manifest, row: IntArray, spring_constant: FloatArray) -> None:
        self.row, self.spring_constant = row, spring_constant
        self.lengths = RigidBars(manifest, np.zeros(len(row)), row)
        self._at: tuple[FloatArray, Any] | None = None  # where J was last needed, and J

    def _find_jacobian(self, position: FloatArray) -> Any:
        if self._at is None or not np.array_equal(self._at[0], position):
            self._at = position, self.lengths.jacobian(position)
        return self._at[1]

    def balance(
        self, position: FloatArray, residual: FloatArray, tension: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return tensions (n_members,) and residual, tensions changed within rounding to balance it best."""
        jacobian = self._find_jacobian(position)
        reach = (
            np.linalg.norm(self.lengths.vectors(position), axis=1) + np.abs(position).max(initial=0.0) / 16
        )
        noise = ROUNDING * self.spring_constant * reach
        change = np.clip(self.lengths.find_tension(jacobian, residual), -noise, noise)
        changed = tension.copy()
        changed[self.row] += change
        return changed, residual - self.lengths.pull(jacobian, change)

    def balance_tension(self, position: FloatArray, residual: FloatArray, tension: FloatArray) -> FloatArray:
        """Return tensions t* (n_members,) [N], those of stiff members as they balance the residual best."""
        changed = tension.copy()
        changed[self.row] += self.lengths.find_tension(self._find_jacobian(position), residual)
        return changed

    def correct_stiffness(self, stiffness: Any, position: FloatArray, residual: FloatArray) -> Any:
        """Return the Hessian K* along curves, (n_coordinates, n_coordinates) [N/m], dense or sparse."""
        jacobian = self._find_jacobian(position)
        length = np.linalg.norm(self.lengths.vectors(position), axis=1)
        density = self.lengths.find_tension(jacobian, residual) / length
        if isinstance(stiffness, np.ndarray):
            return self.lengths.bend(stiffness, density, jacobian)
        along = jacobian.T @ scipy.sparse.diags_array(density) @ jacobian
        return scipy.sparse.csc_array(stiffness + self.lengths.stiffness(density) - along)

    def sum_columns(self, position: FloatArray) -> FloatArray:
        """Return the column sums of moduli of their part of the stiffness, (n_coordinates,) [N/m]."""
        jacobian = abs(self._find_jacobian(position))
        total = np.bincount(self.lengths.bar, jacobian.data, len(self.row))
        return self.lengths.pull(jacobian, self.spring_constant * total)

    def follow(
        self, coordinate: FloatArray, step: FloatArray, locate: Callable[[FloatArray], FloatArray]
    ) -> FloatArray | None:
        """Return the coordinates nearest to a step's end with the predicted lengths, None without any."""
        position, ahead = locate(coordinate), coordinate + step
        length = np.linalg.norm(self.lengths.vectors(position), axis=1)
        self.lengths.length = length + self._find_jacobian(position) @ step
        placed = self.lengths.place(locate, ahead)
        if placed is None or np.linalg.norm(placed - ahead) > MAX_CORRECTION_RATIO * np.linalg.norm(step):
            return None
        return placed
