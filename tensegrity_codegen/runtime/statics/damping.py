"""Damping of the members in a search for an equilibrium, each as much as its energy departs from its model.

A step s solves (K* + D^T S D + mu I) s = f. D gives the difference s_i - s_j of each member, S its damping sigma_m
[N/m] along all axes, so that motions as a rigid body cost little, however large they are, and a member that turns
too far is held without slowing down the others. With elongation e and difference d along a step the energy of a
member is t e + k e^2 / 2 + t (d^2 - e^2) / 2 l to second order; where the true one is larger by r, a damping of
2 r / d^2 would have covered it. Such bounds for every member make the energy fall (methods that minimise a
majorant: K. Lange, D. R. Hunter, I. Yang, "Optimization transfer using surrogate objective functions", Journal of
Computational and Graphical Statistics 9, 2000). Where the matrix is not positive definite, members in compression
are damped by a common part of |t| / l, their destabilising geometric stiffness.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, Factoriser, Solve
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

MOST_TURN = 1.0  # largest difference of the ends of a member in one step, as part of its length
LEAST_LENGTH = 0.1  # of the longest member: shorter ones count as so long where turns are measured
SMALL_TURN = 0.02  # below it, rounding and not the model decides about the energy of a member
LEAST_PART = 0.125  # smallest part of the compression that is damped
FIRST_DAMPING = 0.1  # of the largest force over the length: damping of members that were not damped before
FORGOTTEN = 1e-6  # of the largest force over the length: smaller damping counts as none
MOST_FACTORS = 60  # factorisations until the matrix has to be positive definite


@dataclass(frozen=True)
class Members:
    """Members at one configuration: vectors (n_members, 3) [m] and lengths (n_members,) [m] between their nodes."""

    vector: FloatArray
    length: FloatArray


class MemberDamping:
    """The damping of members through one search; sigma: (n_members,) [N/m]."""

    def __init__(self, problem: StaticProblem) -> None:
        self.problem = problem
        self.factoriser = Factoriser()
        count = len(problem.ends)
        self.sigma = np.zeros(count)
        self.compression_part = 0.0
        self.shift = 0.0
        self.spring_constant = np.zeros(count)  # last known, of taut members

    def locate(self, point: Point) -> Members:
        """Return the members at a point."""
        position = self.problem.node_position(point.coordinate)
        vector = position[self.problem.ends[:, 0]] - position[self.problem.ends[:, 1]]
        return Members(vector, np.linalg.norm(vector, axis=1))

    def find_turn(
        self, difference: Any, step: FloatArray, members: Members, point: Point, trial: Point | None
    ) -> FloatArray:
        """Return by how much of its length the ends of each member part along a step, (n_members,).

        That of cables that are slack before and after does not matter.
        """
        moved = np.linalg.norm((difference @ step).reshape(-1, 3), axis=1)
        if trial is not None:
            moved[(point.tension == 0.0) & (trial.tension == 0.0)] = 0.0
        return np.asarray(moved / np.maximum(members.length, LEAST_LENGTH * point.longest))

    def find_lengthening(self, trial: Point, difference: Any, step: FloatArray, here: Members) -> FloatArray:
        """Return the forces, (n_directions,) [N], of what taut members are longer than along the tangent."""
        there = self.locate(trial)
        unit = here.vector / here.length[:, None]
        along = (unit * (difference @ step).reshape(-1, 3)).sum(axis=1)
        gap = np.where(trial.tension != 0.0, there.length - here.length - along, 0.0)
        pull = (self.spring_constant * gap)[:, None] * unit
        return np.asarray(difference.T @ pull.ravel())

    def factorise(self, stiffness: Any, difference: Any, point: Point, members: Members) -> Solve | None:
        """Return the solution with the damped stiffness; more damping where it is not positive definite.

        None where even MOST_FACTORS factorisations do not find one.
        """
        matrix = stiffness.toarray() if stiffness.shape[0] <= DENSE_LIMIT else stiffness
        force = max(point.largest_force, point.node_force)
        least = 2 * self.problem.bound_rounding(stiffness, point.coordinate) + 1e-12 * force / max(
            point.longest, 1e-300
        )
        compression = np.maximum(-self.problem.find_stiff_tension(point), 0.0) / members.length
        for _ in range(MOST_FACTORS):
            weight = self.sigma + self.compression_part * compression
            solve = self.factoriser.factorise(_add(matrix, difference, weight, self.shift + least))
            if solve is not None:
                return solve
            if self.compression_part < 1.0:
                self.compression_part = max(2 * self.compression_part, LEAST_PART)
            else:
                self.shift = max(4 * self.shift, 1e-3 * force / max(point.longest, 1e-300), 10 * least)
        return None

    def hold(self, turn: FloatArray, point: Point, members: Members) -> None:
        """Damp the members that turn most, after a step whose end has no energy, or too far to be trusted."""
        far = turn > 0.5 * min(MOST_TURN, float(turn.max(initial=0.0)))
        force = max(point.largest_force, point.node_force)
        first = FIRST_DAMPING * force / members.length
        self.sigma = np.where(far, np.maximum(4 * self.sigma, first), self.sigma)

    def refuse(self, need: FloatArray, point: Point, members: Members, attempt: int) -> None:
        """Damp more after a step that did not lower the energy as it should have."""
        between = need ** (1 / 3) * np.maximum(self.sigma, need / 30) ** (2 / 3)
        self.sigma = np.maximum(2 * self.sigma, between)
        if attempt >= 8:
            force = max(point.largest_force, point.node_force)
            self.sigma = 4 * self.sigma + FIRST_DAMPING * force / members.length
            self.shift = max(4 * self.shift, 1e-3 * force / max(point.longest, 1e-300))

    def relax(self, need: FloatArray, turn: FloatArray, ratio: float, is_first: bool) -> None:
        """Damp less after a step that lowered the energy by `ratio` of what the undamped model says."""
        largest = float(turn.max(initial=0.0))
        self.sigma = self.sigma / (np.clip(0.2 / max(largest, 1e-300), 4.0, 100.0) if is_first else 2.0)
        self.shift = self.shift / 4 if self.shift > 0 else 0.0
        if ratio < 0.75:
            self.sigma = np.maximum(self.sigma, np.where(turn > SMALL_TURN, 0.5 * need, 0.0))
        if is_first:
            self.compression_part = self.compression_part / 2 if self.compression_part > 0.1 else 0.0

    def forget_small(self, point: Point, members: Members) -> None:
        """Drop damping that is too small to matter."""
        least = FORGOTTEN * max(point.largest_force, point.node_force) / members.length
        self.sigma[self.sigma < least] = 0.0

    def find_need(
        self, point: Point, trial: Point, difference: Any, step: FloatArray, here: Members, there: Members
    ) -> FloatArray:
        """Return the damping that would have covered the true energy of each member, (n_members,) [N/m]."""
        tension, after = point.tension, trial.tension
        moved = (difference @ step).reshape(-1, 3)
        unit = here.vector / here.length[:, None]
        elongation = (unit * moved).sum(axis=1)
        square = (moved**2).sum(axis=1)
        change = there.length - here.length
        taut, stays = tension != 0.0, after != 0.0
        self._note_spring_constants(after - tension, change, taut & stays, here.length)
        known = np.where(taut, self.spring_constant, 0.0)
        whole = (unit * (there.vector - here.vector)).sum(axis=1)  # corrections of the step included
        model = (
            tension * whole + known * elongation**2 / 2 + tension / here.length * (square - elongation**2) / 2
        )
        energy = (tension + after) * change / 2
        k = np.maximum(self.spring_constant, 1e-300)
        snapped = ~taut & stays & (self.spring_constant > 0)
        energy = np.where(snapped, np.minimum(energy, after**2 / (2 * k)), energy)
        loosened = taut & ~stays & (self.spring_constant > 0)
        energy = np.where(loosened, np.maximum(energy, -(tension**2) / (2 * k)), energy)
        need = 2 * np.maximum(energy - model, 0.0) / np.maximum(square, 1e-300)
        need[self.problem.kept_members] = 0.0
        need[square <= (1e-9 * here.length) ** 2] = 0.0
        return np.asarray(np.nan_to_num(need, nan=0.0, posinf=0.0))

    def _note_spring_constants(
        self, force: FloatArray, change: FloatArray, taut: BoolArray, length: FloatArray
    ) -> None:
        good = taut & (np.abs(change) > 1e-7 * length)
        self.spring_constant = np.where(
            good, np.abs(force) / np.where(good, np.abs(change), 1.0), self.spring_constant
        )


def _add(matrix: Any, difference: Any, weight: FloatArray, shift: float) -> Any:
    """Return matrix + D^T diag(weight) D + shift I, dense or sparse as the matrix."""
    each = np.repeat(weight, 3)
    if scipy.sparse.issparse(matrix):
        whole = matrix + shift * scipy.sparse.eye_array(matrix.shape[0], format="csc")
        return whole + difference.T @ (scipy.sparse.diags_array(each) @ difference) if weight.any() else whole
    whole = matrix + shift * np.eye(len(matrix))
    return whole + difference.T @ (each[:, None] * difference) if weight.any() else whole
