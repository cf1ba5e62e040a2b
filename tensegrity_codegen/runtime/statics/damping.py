"""Damping of the members in a search for an equilibrium, each as much as its energy departs from its model.

A step s solves (K* + D^T S D + mu I) s = f. D gives the difference s_i - s_j of each member, S its damping
sigma_m [N/m] along all axes, so that motions as a rigid body cost little, however large they are, and a
member that turns too far is held without slowing down the others. With elongation e and difference d along
a step the energy of a member is t e + k e^2 / 2 + t (d^2 - e^2) / 2 l to second order; where the true one
is larger by r, a damping of 2 r / d^2 would have covered it. Such bounds for every member make the energy
fall (methods that minimise a majorant: K. Lange, D. R. Hunter, I. Yang, "Optimization transfer using
surrogate objective functions", Journal of Computational and Graphical Statistics 9, 2000). Where the matrix
is not positive definite, members in compression are damped by a common part of |t| / l, their destabilising
geometric stiffness.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.factors import Factoriser, Solve
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.strands import Strands

MAX_TURN = 1.0  # largest difference of the ends of a member in one step, as part of its length
MIN_LENGTH = 0.1  # of the longest member: shorter ones count as so long where turns are measured
SMALL_TURN = 0.02  # below it, rounding and not the model decides about the energy of a member
MIN_PART = 0.125  # smallest part of the compression that is damped
FIRST_DAMPING = 0.1  # of the largest force over the length: damping of members that were not damped before
FORGOTTEN = 1e-6  # of the largest force over the length: smaller damping counts as none
LATE_ATTEMPT = 8  # from which on all members are damped more
MAX_FACTORS = 60  # factorisations until the matrix has to be positive definite


@dataclass(frozen=True)
class Members:
    """Members at a configuration, or at one of each case; numbers of a case have a last axis of one."""

    vector: FloatArray  # (..., n_members, 3) [m], between their nodes
    length: FloatArray  # (..., n_members) [m]
    tension: FloatArray  # (..., n_members) [N]
    force: FloatArray  # (..., 1) [N], the largest of members and residuals of nodes
    longest: FloatArray  # (..., 1) [m]

    @property
    def unit(self) -> FloatArray:
        """Their directions, (..., n_members, 3)."""
        return self.vector / self.length[..., None]

    @property
    def density(self) -> FloatArray:
        """The largest force over the largest length, (..., 1) [N/m]."""
        return self.force / np.maximum(self.longest, 1e-300)


def locate_members(position: FloatArray, strands: Strands, point: Any) -> Members:
    """Return members of a Point or Points with nodes at position (..., n_nodes, 3), strand by strand."""
    vector = strands.vectors(position)
    force = np.maximum(point.largest_force, point.node_force)[..., None]
    longest = np.asarray(point.longest)[..., None]
    length = np.sqrt((vector**2).sum(axis=-1))
    length = np.where(length > 0.0, length, MIN_LENGTH * longest)
    return Members(vector, length, strands.spread(point.tension), force, longest)


def find_turn(moved: FloatArray, here: Members, there: Members | None) -> FloatArray:
    """Return by how much of its length the ends of each member part in a step, of slack cables 0."""
    difference = np.sqrt((moved**2).sum(axis=-1))
    if there is not None:
        difference[(here.tension == 0.0) & (there.tension == 0.0)] = 0.0
    return np.asarray(difference / np.maximum(here.length, MIN_LENGTH * here.longest))


@dataclass
class Damping:
    """The damping of members through a search, or through those of many cases side by side."""

    sigma: FloatArray  # (..., n_members) [N/m]
    spring_constant: FloatArray  # (..., n_members) [N/m], last known, of taut members
    compression_part: FloatArray  # (..., 1)
    shift: FloatArray  # (..., 1) [N/m]

    @classmethod
    def start(cls, *shape: int) -> "Damping":
        """Return no damping, of shape (..., n_members)."""
        single = (*shape[:-1], 1)
        return cls(np.zeros(shape), np.zeros(shape), np.zeros(single), np.zeros(single))

    def find_weight(self, compression: FloatArray) -> FloatArray:
        """Return the damping of each member, compression (..., n_members) [N/m] included."""
        return self.sigma + self.compression_part * compression

    def harden(self, here: Members, least_shift: FloatArray) -> None:
        """Damp more after the matrix was not positive definite with a shift of at least `least` [N/m]."""
        is_partial = self.compression_part < 1.0
        shift = np.maximum.reduce([4 * self.shift, 1e-3 * here.density, 10 * least_shift])
        self.shift = np.where(is_partial, self.shift, shift)
        fraction = np.maximum(2 * self.compression_part, MIN_PART)
        self.compression_part = np.where(is_partial, fraction, self.compression_part)

    def hold(self, turn: FloatArray, here: Members) -> None:
        """Damp the members that turn most, after a step whose end has no energy, or too far to be trusted."""
        turns_most = turn > 0.5 * np.minimum(MAX_TURN, turn.max(axis=-1, initial=0.0, keepdims=True))
        initial = FIRST_DAMPING * here.force / here.length
        self.sigma = np.where(turns_most, np.maximum(4 * self.sigma, initial), self.sigma)

    def refuse(self, need: FloatArray, here: Members, attempt: Any) -> None:
        """Damp more after a step that did not lower the energy as it should have; attempt: (..., 1)."""
        between = need ** (1 / 3) * np.maximum(self.sigma, need / 30) ** (2 / 3)
        self.sigma = np.maximum(2 * self.sigma, between)
        is_late = np.asarray(attempt) >= LATE_ATTEMPT
        increased = 4 * self.sigma + FIRST_DAMPING * here.force / here.length
        self.sigma = np.where(is_late, increased, self.sigma)
        self.shift = np.where(is_late, np.maximum(4 * self.shift, 1e-3 * here.density), self.shift)

    def relax(self, need: FloatArray, turn: FloatArray, ratio: Any, is_first: Any) -> None:
        """Damp less after a step that saved `ratio` (..., 1) of the energy that the undamped model says."""
        largest = turn.max(axis=-1, initial=0.0, keepdims=True)
        much = np.clip(0.2 / np.maximum(largest, 1e-300), 4.0, 100.0)
        self.sigma = self.sigma / np.where(is_first, much, 2.0)
        self.shift = self.shift / 4
        is_short = (np.asarray(ratio) < 0.75) & (turn > SMALL_TURN)
        self.sigma = np.where(is_short, np.maximum(self.sigma, 0.5 * need), self.sigma)
        less = np.where(self.compression_part > 0.1, self.compression_part / 2, 0.0)
        self.compression_part = np.where(is_first, less, self.compression_part)

    def forget_small(self, here: Members) -> None:
        """Drop damping that is too small to matter."""
        self.sigma = np.where(self.sigma < FORGOTTEN * here.force / here.length, 0.0, self.sigma)

    def find_lengthening(self, moved: FloatArray, here: Members, there: Members) -> FloatArray:
        """Return forces of taut members for being longer than along the tangent, (..., n_members, 3) [N]."""
        along = (here.unit * moved).sum(axis=-1)
        gap = np.where(there.tension != 0.0, there.length - here.length - along, 0.0)
        return np.asarray((self.spring_constant * gap)[..., None] * here.unit)

    def find_need(self, moved: FloatArray, here: Members, there: Members, kept: IntArray) -> FloatArray:
        """Return the damping that would have covered each member's energy [N/m], 0 for members `kept`."""
        tension, after = here.tension, there.tension
        elongation, square = (here.unit * moved).sum(axis=-1), (moved**2).sum(axis=-1)
        change = there.length - here.length
        taut, stays = tension != 0.0, after != 0.0
        size = np.abs(change)
        good = taut & stays & (size > 1e-7 * here.length)
        slope = np.abs(after - tension) / np.where(good, size, 1.0)
        self.spring_constant = np.where(good, slope, self.spring_constant)
        spring_constant = np.where(taut, self.spring_constant, 0.0)
        corrected_elongation = (here.unit * (there.vector - here.vector)).sum(
            axis=-1
        )  # corrections of the step included
        turned = tension / here.length * (square - elongation**2)
        model = tension * corrected_elongation + (spring_constant * elongation**2 + turned) / 2
        energy = (tension + after) * change / 2
        twice = 2 * np.where(self.spring_constant > 0, self.spring_constant, 1.0)
        snapped = ~taut & stays & (self.spring_constant > 0)
        energy = np.where(snapped, np.minimum(energy, after**2 / twice), energy)
        loosened = taut & ~stays & (self.spring_constant > 0)
        energy = np.where(loosened, np.maximum(energy, -(tension**2) / twice), energy)
        need = 2 * np.maximum(energy - model, 0.0) / np.maximum(square, 1e-300)
        need[..., kept] = 0.0
        need[square <= (1e-9 * here.length) ** 2] = 0.0
        return np.asarray(np.nan_to_num(need, nan=0.0, posinf=0.0))


class MemberDamping(Damping):
    """The damping of members through the search for one equilibrium."""

    def __init__(self, problem: StaticProblem) -> None:
        super().__init__(**vars(Damping.start(len(problem.strands.member))))
        self.problem = problem
        self.factoriser = Factoriser()

    def locate(self, point: Point) -> Members:
        """Return the members at a point."""
        return locate_members(self.problem.node_position(point.coordinate), self.problem.strands, point)

    def factorise(self, stiffness: Any, difference: Any, point: Point, here: Members) -> Solve | None:
        """Return the solution with enough damping; None if MAX_FACTORS factorisations do not find one."""
        least_shift = find_least_shift(self.problem.bound_rounding(stiffness, point.coordinate), here)
        tension = self.problem.strands.spread(self.problem.find_stiff_tension(point))
        compression = np.maximum(-tension, 0.0) / here.length
        for _ in range(MAX_FACTORS):
            weight, shift = self.find_weight(compression), float((self.shift + least_shift)[0])
            solve = self.factoriser.factorise(_add(stiffness, difference, weight, shift))
            if solve is not None:
                return solve
            self.harden(here, least_shift)
        return None


def find_least_shift(rounding: Any, here: Members) -> FloatArray:
    """Return the least shift of a stiffness, eigenvalues below `rounding` being rounding, (..., 1) [N/m]."""
    return np.asarray(2 * rounding + 1e-12 * here.density)


def _add(matrix: Any, difference: Any, weight: FloatArray, shift: float) -> Any:
    """Return matrix + D^T diag(weight) D + shift I, dense or sparse as the matrix."""
    diagonal = np.repeat(weight, 3)
    if isinstance(matrix, np.ndarray):
        shifted = matrix + shift * np.eye(len(matrix))
        return shifted + difference.T @ (diagonal[:, None] * difference) if weight.any() else shifted
    shifted = matrix + shift * scipy.sparse.eye_array(matrix.shape[0], format="csc")
    return (
        shifted + difference.T @ (scipy.sparse.diags_array(diagonal) @ difference)
        if weight.any()
        else shifted
    )
