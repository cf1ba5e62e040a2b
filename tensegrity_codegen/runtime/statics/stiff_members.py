"""Members that are much stiffer than the others: steps keep to the lengths that their tensions ask for.

A straight step s stretches a turning bar of length l by s^2 / 2 l, which a stiff bar answers with a huge force;
steps along the tangent are therefore tiny, or fail. Here a step leads to the nearest configuration in which each
stiff member has the length l + J s of its linear prediction, J = dl/dq. Along such a curve the energy is, to second
order, that of the Hessian in which the tensions of stiff members are those that balance the other forces best,

    t* = t + argmin |f - J^T dt|,     K* = K + sum_b (t*_b - t_b) d2l_b/dq2

so that neither step lengths nor the number of steps depend on how stiff these members are. In equilibrium K* = K.
(Forces of stiff members as unknowns: D. Magisano, L. Leonetti, G. Garcea, "How to improve efficiency and robustness of
the Newton method in geometrically non-linear structural problem discretized via displacement-based finite elements",
Computer Methods in Applied Mechanics and Engineering 313, 2017; steps along curves: P.-A. Absil, C. G. Baker,
K. A. Gallivan, "Trust-region methods on Riemannian manifolds", Foundations of Computational Mathematics 7, 2007.)

Tensions k (l - l0) of stiff members are only known to k times the rounding of l; within that, those count that
balance the other forces.
"""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.rigid_bars import EPSILON, RigidBars
from tensegrity_codegen.system.arrays import FloatArray, IntArray

LEAST_RATIO = 10.0  # between the stiffness of stiff members and that of the next softer one
PROBE = 1e-6  # of the longest member: displacement that shows how stiff members are
MAX_CORRECTION_RATIO = 1.0  # largest correction of a step, as part of the step


def find_spring_constants(problem: Any, coordinate: FloatArray) -> FloatArray:
    """Return dt/dl of each member at `coordinate` by a small displacement, (n_members,) [N/m]."""
    tension, length = (problem.compute(name, coordinate) for name in ("member_tension", "member_length"))
    tension, length = np.array(tension), np.array(length)
    direction = np.random.default_rng(0).uniform(-1.0, 1.0, len(coordinate))
    beside = coordinate + PROBE * float(length.max(initial=0.0)) * direction
    change = np.asarray(problem.compute("member_length", beside)) - length
    force = np.asarray(problem.compute("member_tension", beside)) - tension
    moved = np.abs(change) > 1e-3 * PROBE * length.max(initial=0.0)
    return np.where(moved, np.abs(force) / np.where(moved, np.abs(change), 1.0), 0.0)


def choose_stiff(spring_constant: FloatArray) -> IntArray:
    """Return the numbers of the members above the widest gap between spring constants, none if it is narrow."""
    order = np.argsort(spring_constant)
    order = order[spring_constant[order] > 0.0]
    if len(order) < 2:
        return np.zeros(0, dtype=np.int64)
    ratio = spring_constant[order[1:]] / spring_constant[order[:-1]]
    widest = int(ratio.argmax())
    return np.sort(order[widest + 1 :]) if ratio[widest] >= LEAST_RATIO else np.zeros(0, dtype=np.int64)


class StiffMembers:
    """The stiff members of a static problem; row: their numbers, spring_constant: (n_members,) [N/m]."""

    def __init__(self, problem: Any, row: IntArray, spring_constant: FloatArray) -> None:
        self.problem, self.row = problem, row
        self.spring_constant = spring_constant
        self.lengths = RigidBars(problem.model.manifest, np.zeros(len(row)), row)

    def balance(self, coordinate: FloatArray, residual: FloatArray, tension: FloatArray) -> FloatArray:
        """Change tensions within rounding so that they balance the residual, and the residual with them."""
        position = self.problem.node_position(coordinate)
        jacobian = self.lengths.jacobian(position)
        reach = np.abs(position).max(initial=0.0)
        longest = np.linalg.norm(self.lengths.vectors(position), axis=1) + reach / 16
        noise = 512 * EPSILON * self.spring_constant[self.row] * longest
        change = np.clip(self.lengths.find_tension(jacobian, residual), -noise, noise)
        tension[self.row] += change
        return residual - jacobian.T @ change

    def correct_stiffness(self, stiffness: Any, coordinate: FloatArray, residual: FloatArray) -> Any:
        """Return the Hessian K* along curves."""
        position = self.problem.node_position(coordinate)
        jacobian = self.lengths.jacobian(position)
        length = np.linalg.norm(self.lengths.vectors(position), axis=1)
        density = self.lengths.find_tension(jacobian, residual) / length
        along = jacobian.T @ scipy.sparse.diags_array(density) @ jacobian
        return scipy.sparse.csc_array(stiffness + self.lengths.stiffness(density) - along)

    def follow(self, coordinate: FloatArray, step: FloatArray) -> FloatArray | None:
        """Return the coordinates nearest to the end of a step at which stiff members have their lengths."""
        position = self.problem.node_position(coordinate)
        length = np.linalg.norm(self.lengths.vectors(position), axis=1)
        self.lengths.length = length + self.lengths.jacobian(position) @ step
        ahead = coordinate + step
        placed = self.lengths.place(self.problem.node_position, ahead)
        if placed is None or np.linalg.norm(placed - ahead) > MAX_CORRECTION_RATIO * np.linalg.norm(step):
            return None
        return placed
