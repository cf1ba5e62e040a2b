"""Linear programs of forces in balance and of masses above lines, with bounds that are proved.

Unknown are the tension of each member in each load case and the mass of each member. Their optimum is a
number from a solver with tolerances; what proves something is the bound that its multipliers give: for any
multipliers y, w >= 0 of A x = b, C x <= d and limits of x, c x >= b y - d w + min over the limits of
(c - A'y + C'w) x, whatever the solver's tolerances are (A. Neumaier and O. Shcherbina, "Safe bounds in
linear and mixed-integer linear programming", Mathematical Programming 99, 2004).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.pipeline.sizing.member_mass import MassLaw
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError

# Tolerance of HiGHS and whether it presolves: each where the one before ends without a solution. Presolve
# calls programs infeasible whose matrix is nearly singular.
SETTINGS = ((1e-9, True), (1e-9, False), (1e-7, False))
INFEASIBLE = 2  # status of scipy.optimize.linprog
ROUNDING = 1e-9  # of tensions, and of reduced costs of tensions without a limit, that count as zero
LARGEST_RESIDUAL = 1e-8  # of forces that balance, of the largest load
MOST_FORCE = 1e6  # times the largest load: forces beyond it do not count as balance


@dataclass(frozen=True)
class Optimum:
    """A solution of a linear program.

    bound: no solution costs less. tension (n_cases, n_members), and its reduced cost: what one more unit
    of it costs at least.
    """

    bound: float
    tension: FloatArray
    reduced: FloatArray


@dataclass(frozen=True)
class Unbalanced:
    """Forces out of balance at best, and a proof where there are none that balance.

    motion: (n_cases, n_coordinates) a motion, at most 1 at each coordinate, in which loads do more work
    than members can take.
    """

    motion: FloatArray
    excess: float  # that work: the sum of forces out of balance is proved to be no less; 0 without a proof
    residual: FloatArray  # (n_cases, n_coordinates) forces out of balance at best

    @property
    def is_proved(self) -> bool:
        """Whether more is out of balance than rounding."""
        return self.excess > LARGEST_RESIDUAL


class ForceProgram:
    """Tensions within limits that balance loads, and masses above lines over them.

    matrix (n_coordinates, n_members): equilibrium matrix A; load (n_cases, n_coordinates): A t = load.
    lower, upper (n_cases, n_members): limits of tensions. All are multiples of a force and a mass.
    """

    def __init__(
        self, matrix: FloatArray, load: FloatArray, law: MassLaw, lower: FloatArray, upper: FloatArray
    ) -> None:
        self.matrix, self.load, self.law, self.lower, self.upper = matrix, load, law, lower, upper
        cases, members = lower.shape
        self.count, self.is_curved = 0, np.broadcast_to((law.root > 0) & (lower < 0), lower.shape)
        column = np.arange(cases * members).reshape(lower.shape)
        owner = np.broadcast_to(np.arange(members), lower.shape)
        # Lines: along tension, along compression where a bar yields, and the chord of a bar that buckles.
        direct = np.broadcast_to(law.direct, lower.shape)
        pulls, yields = upper > 0, (lower < 0) & np.isfinite(law.kink)
        self.straight = np.concatenate([direct[pulls], -direct[yields]])
        self.columns = np.concatenate([column[used] for used in (pulls, yields, self.is_curved)])
        self.owners = np.concatenate([owner[used] for used in (pulls, yields, self.is_curved)])
        # Coordinates whose balance follows from that of others up to rounding mislead the solver.
        upper_part, order = scipy.linalg.qr(matrix.T, mode="r", pivoting=True)
        size = np.abs(np.diag(upper_part))
        self.row = np.sort(order[: int((size > ROUNDING * size.max(initial=0.0)).sum())])
        self.balance = scipy.sparse.block_diag([scipy.sparse.csr_array(matrix)] * cases, format="csr")
        blocks = scipy.sparse.block_diag([scipy.sparse.csr_array(matrix[self.row])] * cases)
        empty = scipy.sparse.csr_array((len(self.row) * cases, members))
        self.equal = scipy.sparse.csr_array(scipy.sparse.hstack([blocks, empty]))

    def solve(
        self,
        line: tuple[FloatArray, FloatArray],
        lower: FloatArray,
        upper: FloatArray,
        most_mass: float = np.inf,
        weight: FloatArray | None = None,
        cost: FloatArray | None = None,
    ) -> Optimum | None:
        """Return the least total of masses; None where there are no such forces.

        line: slope and intercept over the compression of each curved member in each case. most_mass: largest
        total of masses. weight (n_members,): cost of masses, 1 where not given; cost (n_cases, n_members): of
        tensions, in its place.
        """
        cases, members = lower.shape
        slope, intercept = (np.broadcast_to(coefficient, lower.shape)[self.is_curved] for coefficient in line)
        # Masses above lines over tensions, then their total below its limit.
        values = np.concatenate([self.straight, -slope])
        rows, n = np.arange(len(values)), cases * members
        total = (np.full(members, len(rows)), n + np.arange(members))
        above = scipy.sparse.csr_array(
            (
                np.concatenate([values, np.full(len(rows), -1.0), np.ones(members)]),
                (
                    np.concatenate([rows, rows, total[0]]),
                    np.concatenate([self.columns, n + self.owners, total[1]]),
                ),
            ),
            shape=(len(rows) + 1, n + members),
        )
        limit = np.concatenate([np.zeros(len(rows) - len(slope)), -intercept, [min(most_mass, 1e30)]])
        if cost is None:
            price = np.concatenate([np.zeros(n), np.ones(members) if weight is None else weight])
        else:
            price = np.concatenate([cost.ravel(), np.zeros(members)])
        lowest = np.concatenate([lower.ravel(), np.zeros(members)])
        highest = np.concatenate([upper.ravel(), np.full(members, most_mass)])
        load = self.load[:, self.row].ravel()
        solution = self._call(price, self.equal, load, above, limit, lowest, highest)
        if solution is None:
            return None
        # The proved bound: b y - d w + min over the limits of (c - A'y + C'w) x.
        point, y, w = solution
        reduced = price - self.equal.T @ y - above.T @ w
        bound = float(load @ y + limit @ w + _find_least(reduced, lowest, highest))
        tension = np.where(np.abs(point[:n]) <= ROUNDING, 0.0, point[:n])
        tension = np.clip(tension, lowest[:n], highest[:n]).reshape(lower.shape)
        return Optimum(bound, tension, reduced[:n].reshape(lower.shape))

    def find_unbalanced(self, lower: FloatArray, upper: FloatArray) -> Unbalanced:
        """Return the least imbalance with tensions within limits."""
        rows, n = self.load.size, lower.size
        unit = scipy.sparse.eye_array(rows)
        equal = scipy.sparse.csr_array(scipy.sparse.hstack([self.balance, unit, -unit]))
        price = np.concatenate([np.zeros(n), np.ones(2 * rows)])
        lowest = np.concatenate([lower.ravel(), np.zeros(2 * rows)])
        highest = np.concatenate([upper.ravel(), np.full(2 * rows, np.inf)])
        solution = self._call(price, equal, self.load.ravel(), None, None, lowest, highest)
        if solution is None:  # cannot be: the forces out of balance take whatever is left
            raise ConvergenceError("the linear program of unbalanced forces was not solved", where="HiGHS")
        point, y, _ = solution
        y = np.clip(y, -1.0, 1.0)
        lowest_force, highest_force = lower.ravel(), upper.ravel()
        reduced = np.asarray(-(self.balance.T @ y))
        absorbed = _find_least(reduced, lowest_force, highest_force)
        if absorbed == -np.inf:  # nearly a motion without strain
            limits = np.maximum(lowest_force, -MOST_FORCE), np.minimum(highest_force, MOST_FORCE)
            absorbed = _find_least(reduced, *limits)
        excess = max(float(self.load.ravel() @ y) + absorbed, 0.0)
        residual = point[n : n + rows] - point[n + rows :]
        return Unbalanced(y.reshape(self.load.shape), excess, residual.reshape(self.load.shape))

    def _call(
        self, price: FloatArray, equal: Any, load: FloatArray, above: Any, limit: Any, least: Any, most: Any
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return solution and multipliers; None where there is none; raises ConvergenceError."""
        bounds: Any = np.stack([least, most], axis=1)
        is_infeasible = False
        for tolerance, presolve in SETTINGS:
            options: Any = {
                "presolve": presolve,
                "primal_feasibility_tolerance": tolerance,
                "dual_feasibility_tolerance": tolerance,
            }
            solution = scipy.optimize.linprog(
                price, above, limit, equal, load, bounds, method="highs", options=options
            )
            self.count += 1
            if solution.status == 0:
                w = np.minimum(solution.ineqlin.marginals, 0.0)
                return np.asarray(solution.x), np.asarray(solution.eqlin.marginals), np.asarray(w)
            is_infeasible = is_infeasible or solution.status == INFEASIBLE
            if solution.status == INFEASIBLE and not presolve:
                break
        if is_infeasible:
            return None
        problem = f"a linear program was not solved: {solution.message}"
        hint = "check that positions, loads and materials are of sensible size"
        raise ConvergenceError(problem, evidence={"status": int(solution.status)}, where="HiGHS", hint=hint)


def _find_least(reduced: FloatArray, least: FloatArray, most: FloatArray) -> float:
    """Return the least of reduced . x for x within limits; -inf where there is none."""
    end = np.where(reduced > 0, least, most)
    is_finite = np.isfinite(end)
    term = np.where(is_finite, reduced * np.where(is_finite, end, 0.0), -np.inf)
    return float(np.where(~is_finite & (np.abs(reduced) <= ROUNDING), 0.0, term).sum())
