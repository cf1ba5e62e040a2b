"""Trust-region steps and lowest curvature of a large stiffness, by sparse LU of K + shift I.

Pivots stay on the diagonal, so the signs of U's diagonal count the negative eigenvalues (Sylvester's law
of inertia); a shift is accepted when there are none.
"""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.step import SINGULAR_TOLERANCE, Step
from tensegrity_codegen.system.arrays import FloatArray

MOST_SHIFTS = 60
MIN_RADIUS_RATIO, MAX_RADIUS_RATIO = 0.6, 1.4  # of the radius: how well a cut step has to meet it


class SparseCurvature:
    """K in compressed columns; `shift` [N/m] says where the search for the first shift begins."""

    def __init__(self, stiffness: Any, shift: float = 0.0) -> None:
        self.matrix = scipy.sparse.csc_array(stiffness)
        norm = float(abs(self.matrix).sum(axis=0).max(initial=0.0))
        self.least = SINGULAR_TOLERANCE * norm
        self.shift = shift
        self._eye = scipy.sparse.eye_array(self.matrix.shape[0], format="csc")
        self._factor: Any = None
        self.n_factors = 0

    def find_step(self, gradient: FloatArray, radius: float) -> Step:
        """Return the step that saves most energy within `radius`, met within 40 %."""
        self.least = max(self.least, SINGULAR_TOLERANCE * float(np.linalg.norm(gradient)) / radius)
        start = max(self.shift, 10 * self.least)
        if self.factorise(self.least):
            newton = self.solve_shifted(-gradient)
            if np.linalg.norm(newton) <= radius:
                return self._step(newton, gradient, False)
        lower, upper, shift = self.least, np.inf, start
        for _ in range(MOST_SHIFTS):
            guess = np.inf
            if self.factorise(shift):
                vector = self.solve_shifted(-gradient)
                length = float(np.linalg.norm(vector))
                if MIN_RADIUS_RATIO * radius <= length <= MAX_RADIUS_RATIO * radius:
                    return self._step(vector, gradient, True)
                guess = self._secular(vector, length, radius)
                lower, upper = (lower, shift) if length < radius else (shift, upper)
            else:
                lower = shift
            if upper <= 1.1 * lower:
                break
            shift = _inside(guess, lower, upper)
        return self._step_along_curve(gradient, radius, upper if np.isfinite(upper) else shift)

    def solve_shifted(self, right: FloatArray) -> FloatArray:
        """Return (K + shift I)^-1 right with the shift of the last step."""
        solved: FloatArray = self._factor.solve(right)
        return solved

    def factorise(self, shift: float) -> bool:
        """Factorise K + shift I; return whether it is positive definite, else keep the last factors."""
        self.n_factors += 1
        try:
            factor = scipy.sparse.linalg.splu(
                scipy.sparse.csc_array(self.matrix + shift * self._eye),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            return False
        if not np.array_equal(factor.perm_r, factor.perm_c) or factor.U.diagonal().min() <= 0:
            return False
        self._factor, self.shift = factor, shift
        return True

    def _secular(self, vector: FloatArray, length: float, radius: float) -> float:
        """Newton's next shift for 1/|s| = 1/radius."""
        if length == 0.0:
            return 0.0
        slope = float(vector @ self.solve_shifted(vector))
        return self.shift + (length - radius) / radius * length**2 / slope

    def _step_along_curve(self, gradient: FloatArray, radius: float, shift: float) -> Step:
        """Return the step with the least shift, lengthened to `radius` where the energy curves down."""
        while not self.factorise(shift):
            shift *= 10
        vector = self.solve_shifted(-gradient)
        down = np.random.default_rng(0).normal(size=len(gradient))
        for _ in range(4):
            down = self.solve_shifted(down / np.linalg.norm(down))
        down /= np.linalg.norm(down)
        missing = radius**2 - float(vector @ vector)
        if missing > 0 and down @ (self.matrix @ down) < -self.least:
            vector = vector + np.copysign(np.sqrt(missing), -float(gradient @ down)) * down
        return self._step(vector, gradient, True)

    def _step(self, vector: FloatArray, gradient: FloatArray, at_boundary: bool) -> Step:
        saved = -float(gradient @ vector + vector @ (self.matrix @ vector) / 2)
        return Step(vector, saved, at_boundary)


def find_lowest_sparse(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] and unit eigenvector orthogonal to the columns of `neutral`.

    Lanczos iterations on P (K + shift I)^-1 P, with P the projector off `neutral` and a shift that makes
    the matrix positive definite: the largest eigenvalue nu there is lambda = 1/nu - shift.
    """
    curvature = SparseCurvature(stiffness)
    shift = curvature.least * 10
    if shift == 0.0:
        return 0.0, np.zeros(curvature.matrix.shape[0])
    while not curvature.factorise(shift):
        shift *= 10

    size = curvature.matrix.shape[0]
    inverse = scipy.sparse.linalg.LinearOperator(
        (size, size),
        matvec=lambda v: _project(curvature.solve_shifted(_project(np.ravel(v), neutral)), neutral),
        dtype=float,
    )
    start = _project(np.random.default_rng(0).normal(size=size), neutral)
    _, vectors = scipy.sparse.linalg.eigsh(inverse, k=1, which="LA", v0=start, tol=1e-6)
    vector = _project(vectors[:, 0], neutral)
    vector /= np.linalg.norm(vector)
    return float(vector @ (curvature.matrix @ vector)), vector


def _project(vector: FloatArray, neutral: FloatArray) -> FloatArray:
    """Take the part along the columns of `neutral` out of a vector."""
    projected: FloatArray = vector - neutral @ (neutral.T @ vector)
    return projected


def _inside(guess: float, lower: float, upper: float) -> float:
    """Return `guess` where it lies well between the bounds, else a point between them."""
    if np.isfinite(upper):
        return guess if 1.02 * lower < guess < 0.98 * upper else float(np.sqrt(lower * upper))
    return guess if 1.02 * lower < guess < 1e4 * lower else 10 * lower
