"""Newton's method on the bordered system of a path, tangents, and the eigenvalues of the stiffness.

Unknowns are scaled: z = (q / q_scale, lambda / lambda_scale). A point of the path is where

    g(q, lambda) = 0,   n . z = level

and its corrections solve  [K  -f; n] dz = [g; level - n . z], which is regular at limit points too. Neutral
motions N, along which K vanishes, are held by N^T dq = 0.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.paths.load_path import NeutralMotions, PathProblem
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT, find_lowest_curvature
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

MAX_ITERATIONS = 15
CORRECTION_TOLERANCE = 1e-9  # correction in units of z; the error left is of the order of its square
ROUNDING_TOLERANCE = 1e-6  # largest correction that counts as rounding where it no longer shrinks
MAX_EIGENVALUES = 8
SINGULAR_TOLERANCE = 1e-13  # part of the largest singular value, or of the norm, that counts as zero
START_OFFSET_RATIO = 1e-7  # part of the largest coordinate by which the load is taken to push at the start
BALANCE_TOLERANCE = 1e-6  # residual, as part of the largest load, above which a point is none
SMALLEST_SCALE = 1e-6  # of the largest coordinate: motions that are much smaller cannot be told from rounding
EPSILON = float(np.finfo(float).eps)
NEUTRAL_LOAD_TOLERANCE = 1e-9  # part of the load along neutral motions that counts as rounding


@dataclass(frozen=True)
class PathState:
    """A point of the path: scaled unknowns, residual, Newton iterations; the rest is made when asked for."""

    solver: "PathSolver"
    z: FloatArray
    residual: float
    iterations: int

    @property
    def coordinate(self) -> FloatArray:
        """Coordinates q, (n,)."""
        return self.solver.split(self.z)[0]

    @property
    def load_factor(self) -> float:
        """Load factor lambda."""
        return self.solver.split(self.z)[1]

    @cached_property
    def stiffness(self) -> Any:
        """Stiffness K, (n, n)."""
        return self.solver.problem.stiffness(*self.solver.split(self.z))

    @cached_property
    def neutral(self) -> FloatArray:
        """Neutral motions, (n, k)."""
        return self.solver.neutral(self.coordinate, self.stiffness)

    @cached_property
    def eigen(self) -> tuple[FloatArray, FloatArray]:
        """The smallest eigenvalues of K, one above 200 coordinates, and vectors, neutral ones left out."""
        size = self.stiffness.shape[0]
        if size > DENSE_LIMIT:
            value, vector = find_lowest_curvature(scipy.sparse.csc_array(self.stiffness), self.neutral)
            return np.array([value]), vector[:, None]
        matrix, basis = _dense(self.stiffness), np.eye(size)
        if self.neutral.shape[1]:
            basis = np.linalg.qr(self.neutral, mode="complete")[0][:, self.neutral.shape[1] :]
            matrix = basis.T @ matrix @ basis
        values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
        return values[:MAX_EIGENVALUES], basis @ vectors[:, :MAX_EIGENVALUES]

    @property
    def smallest_eigenvalue(self) -> float:
        """Smallest eigenvalue of K, infinite if nothing can move."""
        values = self.eigen[0]
        return float(values[0]) if len(values) else float("inf")


class PathSolver:
    """Solves for points and tangents of one path, with scales of q and lambda; counts its iterations."""

    def __init__(
        self, problem: PathProblem, scales: tuple[float, float], neutral: NeutralMotions | None = None
    ) -> None:
        self.problem = problem
        self.coordinate_scale, self.load_scale = scales
        self._neutral = neutral
        self.n_iterations = 0

    def join(self, coordinate: FloatArray, load_factor: float) -> FloatArray:
        """Return z of q and lambda."""
        return np.append(coordinate / self.coordinate_scale, load_factor / self.load_scale)

    def split(self, z: FloatArray) -> tuple[FloatArray, float]:
        """Return q and lambda of z."""
        return z[:-1] * self.coordinate_scale, float(z[-1]) * self.load_scale

    def neutral(self, coordinate: FloatArray, stiffness: Any) -> FloatArray:
        """Return the neutral motions, (n, k)."""
        if self._neutral is None:
            return np.zeros((len(coordinate), 0))
        return self._neutral(coordinate, stiffness)

    def solve(self, guess: FloatArray, normal: FloatArray, level: float) -> PathState | None:
        """Return the point of the path on the plane normal . z = level, None if Newton finds none."""
        z, before = np.array(guess), np.inf
        for iteration in range(1, MAX_ITERATIONS + 1):
            step = self._correction(z, normal, level)
            self.n_iterations += 1
            if step is None:
                return None
            size = float(np.linalg.norm(step))
            z = z + step
            if size <= CORRECTION_TOLERANCE or (size >= before / 4 and size <= ROUNDING_TOLERANCE):
                return self.find_state(z, iteration)
            if size > 2 * before:
                return None
            before = size
        return None

    def tangent(self, state: PathState, along: FloatArray, stiffness: Any | None = None) -> FloatArray | None:
        """Return the unit tangent with tangent . along > 0, or None; stiffness: in place of the state's."""
        right = np.zeros(len(state.z))
        right[-1] = 1.0
        matrix = state.stiffness if stiffness is None else stiffness
        coordinate, load_factor = self.split(state.z)
        try:
            load = self.problem.load_vector(coordinate, load_factor)
        except NonFiniteError:
            return None
        solution = self._solve(matrix, load, self.neutral(coordinate, matrix), along, right)
        return None if solution is None else solution / np.linalg.norm(solution)

    def begin(
        self, coordinate: FloatArray, load_factor: float, upward: FloatArray
    ) -> "tuple[PathSolver, PathState, FloatArray] | str":
        """Return a solver scaled so that coordinates move like the load, point and tangent, or a reason."""
        state = self.solve(
            self.join(coordinate, load_factor), upward, upward[-1] * load_factor / self.load_scale
        )
        if state is None:
            return f"no equilibrium was found at load factor {load_factor:.10g}, near the start"
        load = self.problem.load_vector(state.coordinate, load_factor)
        if float(np.linalg.norm(state.neutral.T @ load)) > NEUTRAL_LOAD_TOLERANCE * float(
            np.linalg.norm(load)
        ):
            return "the load acts along a motion without stiffness"
        tangent = self.tangent(state, upward)
        if tangent is None or abs(tangent[-1]) < SINGULAR_TOLERANCE:
            tangent = self._tangent_under_load(state, load, upward)
        if tangent is None or abs(tangent[-1]) < SINGULAR_TOLERANCE:
            return "the stiffness at the start is singular"
        moved = float(np.linalg.norm(tangent[:-1]) / abs(tangent[-1])) * self.coordinate_scale
        moved = max(moved, SMALLEST_SCALE * float(np.abs(state.coordinate).max(initial=0.0))) or 1.0
        solver = PathSolver(self.problem, (moved, self.load_scale), self._neutral)
        solver.n_iterations = self.n_iterations
        z = solver.join(state.coordinate, load_factor)
        # The tangent in the new scale of coordinates.
        tangent = np.append(tangent[:-1] * (self.coordinate_scale / moved), tangent[-1])
        begun = PathState(solver, z, state.residual, state.iterations)
        return solver, begun, tangent / np.linalg.norm(tangent)

    def _tangent_under_load(
        self, state: PathState, load: FloatArray, upward: FloatArray
    ) -> FloatArray | None:
        """Return the tangent with the stiffness just where the load pushes to: the start may be at a kink."""
        size = float(np.abs(state.coordinate).max(initial=0.0)) or 1.0
        push = float(np.abs(load).max(initial=0.0)) or 1.0
        displaced = state.coordinate + upward[-1] * START_OFFSET_RATIO * size / push * load
        try:
            stiffness = self.problem.stiffness(displaced, state.load_factor)
        except NonFiniteError:
            return None
        return self.tangent(state, upward, stiffness)

    def find_state(self, z: FloatArray, iterations: int) -> PathState | None:
        """Return the state at z; None if the forces there are not finite or, after all, do not balance."""
        coordinate, load_factor = self.split(z)
        try:
            residual = self.problem.residual(coordinate, load_factor)
            load = self.problem.load_vector(coordinate, load_factor)
            state = PathState(self, z, float(np.abs(residual).max(initial=0.0)), iterations)
            stiffness = float(np.abs(state.stiffness.diagonal()).max(initial=0.0))
        except NonFiniteError:
            return None
        rounding = 1e3 * EPSILON * stiffness * float(np.abs(coordinate).max(initial=0.0))
        unit = float(np.abs(load).max(initial=0.0)) * self.load_scale
        return state if state.residual <= BALANCE_TOLERANCE * unit + rounding else None

    def _correction(self, z: FloatArray, normal: FloatArray, level: float) -> FloatArray | None:
        coordinate, load_factor = self.split(z)
        try:
            residual = self.problem.residual(coordinate, load_factor)
            stiffness = self.problem.stiffness(coordinate, load_factor)
            load = self.problem.load_vector(coordinate, load_factor)
        except NonFiniteError:
            return None
        right = np.append(residual, level - float(normal @ z))
        return self._solve(stiffness, load, self.neutral(coordinate, stiffness), normal, right)

    def _solve(
        self, stiffness: Any, load: FloatArray, neutral: FloatArray, normal: FloatArray, right: FloatArray
    ) -> FloatArray | None:
        """Return dz of the bordered system, None if it is singular."""
        size, held = len(load), neutral.shape[1]
        unit = float(np.abs(load).max(initial=0.0)) * self.load_scale or 1.0
        column = -load[:, None] * (self.load_scale / unit)
        right = np.concatenate([right[:size] / unit, right[size:], np.zeros(held)])
        factor = self.coordinate_scale / unit
        if size <= DENSE_LIMIT:
            matrix = np.zeros((size + 1 + held, size + 1 + held))
            matrix[:size, :size] = _dense(stiffness) * factor
            matrix[:size, size : size + 1] = column
            matrix[size, : size + 1] = normal
            matrix[:size, size + 1 :], matrix[size + 1 :, :size] = neutral, neutral.T
            solution = _solve_dense(matrix, right)
        else:
            upper: list[Any] = [scipy.sparse.csc_array(stiffness) * factor, column, neutral]
            middle: list[Any] = [normal[None, :-1], normal[None, -1:], None]
            blocks: list[list[Any]] = [upper, middle, [neutral.T, None, None]]
            rows = blocks if held else [row[:2] for row in blocks[:2]]
            solution = _solve_sparse(scipy.sparse.csc_array(scipy.sparse.block_array(rows)), right)
        if solution is None or not np.isfinite(solution).all():
            return None
        return solution[: size + 1]


def _dense(matrix: Any) -> FloatArray:
    plain: FloatArray = np.asarray(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
    return plain


def _solve_dense(matrix: FloatArray, right: FloatArray) -> FloatArray | None:
    """Return the solution, the shortest one of a singular system that has some, as at a bifurcation."""
    solution: FloatArray
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        solution = np.asarray(np.linalg.lstsq(matrix, right, rcond=SINGULAR_TOLERANCE)[0], dtype=np.float64)
    missing = float(np.linalg.norm(matrix @ solution - right))
    return solution if missing <= 1e-9 * float(np.linalg.norm(right)) else None


def _solve_sparse(matrix: Any, right: FloatArray) -> FloatArray | None:
    """Return the solution; an exactly singular matrix is solved with its diagonal moved by rounding."""
    try:
        return np.asarray(scipy.sparse.linalg.splu(matrix).solve(right))
    except RuntimeError:
        size = float(abs(matrix).sum(axis=0).max())
        moved = matrix + scipy.sparse.diags_array(np.full(len(right), SINGULAR_TOLERANCE * size))
    try:
        return np.asarray(scipy.sparse.linalg.splu(scipy.sparse.csc_array(moved)).solve(right))
    except RuntimeError:
        return None
