"""Forces of feet that balance a rigid structure, or a rigid motion that proves that there are none.

Feet at x_i carry f_i = N_i n - F_i with |F_i| <= mu N_i. They balance the wrench W of weights and loads if

    G f + W = 0,  G f = (sum f_i, sum x_i x f_i)

Otherwise (Farkas) there is a rigid motion w with W . w > 0 whose velocities u_i at the feet have
n . u_i >= mu |u_i in the plane|: no force of the ground can take up the energy that the loads give.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

GAP = 1e-9  # of the force on the feet: by how much cones may be violated
CUT_GAP = 1e-12  # the same up to which planes are added, as long as that helps
MOST_CUTS = 30  # rounds of cutting planes
FIRST_CUTS = 8  # planes about each cone to begin with
LARGEST_FRICTION = 1e3  # coefficient from which on friction counts as unlimited
OPTIONS: Any = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True)
class FootProblem:
    """A rigid structure on its feet.

    place: (n_feet, 3) [m], from the centre of the feet. wrench: force [N] and moment [N m] of weights and
    loads about that centre, (6,). frame: rows normal, tangents. moving: which of the six rigid motions the
    modelled axes have. size: largest distance of a foot, or 1 [m].
    """

    place: FloatArray
    wrench: FloatArray
    frame: FloatArray
    moving: BoolArray
    size: float

    @property
    def matrix(self) -> FloatArray:
        """G over the components (N, F) of each foot in `frame`, moments over `size`, (k, n_feet * n)."""
        columns = []
        for x in self.place:
            for axis, sign in zip(self.frame, (1.0, *[-1.0] * (len(self.frame) - 1)), strict=True):
                columns.append(np.concatenate([sign * axis, sign * np.cross(x, axis) / self.size]))
        return np.array(columns).T[self.moving]

    @property
    def load(self) -> FloatArray:
        """W without the motions that there are not, moments over `size`, (k,) [N]."""
        return np.concatenate([self.wrench[:3], self.wrench[3:] / self.size])[self.moving]

    def velocities(self, motion: FloatArray) -> FloatArray:
        """Return the velocities (n_feet, n) of a rigid motion (k,), along `frame`."""
        whole = np.zeros(6)
        whole[self.moving] = motion
        moved = whole[:3] + np.cross(whole[3:] / self.size, self.place)
        return np.asarray(moved @ self.frame.T)


@dataclass(frozen=True)
class FootForces:
    """Whether forces of feet exist at a coefficient of friction.

    force: (n_feet, n) N and F of each, those that violate the cones least. excess: that violation [N], its
    least possible value up to `gap` [N]. motion: (k,) of the certificate, where there are no such forces.
    """

    force: FloatArray
    excess: float
    gap: float
    motion: FloatArray


def find_foot_forces(problem: FootProblem, friction: float) -> FootForces:
    """Return the forces with the least excess tau, |F_i| <= mu N_i + tau, N_i >= 0, by cutting planes.

    The planes lie about the cones, so that the optimum of the linear program is a lower bound of tau, and
    its multipliers are a rigid motion that is exact where tau > 0.
    """
    matrix, load = problem.matrix, problem.load
    width = len(problem.frame)
    count, tangents = len(problem.place), width - 1
    scale = float(np.linalg.norm(load)) or 1.0
    angle = 2 * np.pi * np.arange(FIRST_CUTS) / FIRST_CUTS
    first = np.array([[1.0], [-1.0]]) if tangents == 1 else np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cuts = [(i, direction) for i in range(count) for direction in first]
    equal = np.hstack([matrix, np.zeros((len(matrix), 1))])
    bounds: Any = [(0.0 if k % width == 0 else None, None) for k in range(count * width)] + [(None, None)]
    cost = np.zeros(count * width + 1)
    cost[-1] = 1.0
    last = np.inf
    for _ in range(MOST_CUTS):
        rows = np.zeros((len(cuts), count * width + 1))
        for row, (i, direction) in zip(rows, cuts, strict=True):
            row[i * width] = -friction
            row[i * width + 1 : (i + 1) * width] = direction
            row[-1] = -1.0
        found = scipy.optimize.linprog(
            cost, rows, np.zeros(len(cuts)), equal, -load / scale, bounds, method="highs", options=OPTIONS
        )
        if found.status != 0:
            return FootForces(np.zeros((count, width)), np.inf, 0.0, _find_tip(problem))
        solution = np.asarray(found.x)
        force = solution[:-1].reshape(count, width)
        size = np.linalg.norm(force[:, 1:], axis=1)
        excess = float((size - friction * force[:, 0]).max())
        gap = excess - float(solution[-1])
        if gap <= CUT_GAP or (gap <= GAP and gap > last / 2):
            break
        last = gap
        far = np.flatnonzero(size - friction * force[:, 0] > solution[-1] + gap / 2)
        cuts += [(int(i), force[i, 1:] / size[i]) for i in far]
    return FootForces(force * scale, excess * scale, gap * scale, -found.eqlin.marginals)


def find_least_friction(problem: FootProblem) -> float:
    """Return the least coefficient of friction with which foot forces exist; inf where none is enough."""
    scale = float(np.linalg.norm(problem.load)) or 1.0

    def excess(friction: float) -> float:
        found = find_foot_forces(problem, friction)
        return (found.excess - found.gap) / scale  # the bound of the program is the more exact one

    if excess(0.0) <= GAP:
        return 0.0
    if excess(LARGEST_FRICTION) > 0.0:
        return np.inf
    low, high = 0.0, 1.0
    while excess(high) > 0.0:
        low, high = high, 10 * high
    return float(scipy.optimize.brentq(excess, low, min(high, LARGEST_FRICTION), xtol=1e-13, rtol=1e-12))


def _find_tip(problem: FootProblem) -> FloatArray:
    """Return a rigid motion (k,) that lifts no foot below the plane, along which the loads do most work.

    Where no friction is enough, it moves feet along the normal alone.
    """
    velocity = np.array([problem.velocities(unit) for unit in np.eye(len(problem.load))])  # (k, n_feet, n)
    still = velocity[:, :, 1:].reshape(len(velocity), -1).T
    found = scipy.optimize.linprog(
        -problem.load, -velocity[:, :, 0].T, np.zeros(len(problem.place)), still, np.zeros(len(still)),
        (-1.0, 1.0), method="highs", options=OPTIONS,
    )  # fmt: skip
    if found.status != 0:
        raise ConvergenceError(
            f"the linear program was not solved: {found.message}",
            evidence={"status": int(found.status)},
            where="HiGHS",
            hint="check that all positions and loads are of sensible size",
        )
    return np.asarray(found.x)
