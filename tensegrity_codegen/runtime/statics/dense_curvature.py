"""Trust-region steps and lowest curvature of a small stiffness, by its full eigendecomposition."""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.step import SINGULAR_TOLERANCE, Step
from tensegrity_codegen.system.arrays import FloatArray


class DenseCurvature:
    """K = V diag(lambda) V^T; gradients below `noise` [N] along singular directions count as rounding."""

    def __init__(self, stiffness: Any, noise: float) -> None:
        matrix = np.asarray(stiffness.toarray())
        self.value, self.vector = np.linalg.eigh((matrix + matrix.T) / 2)
        self.noise = noise
        self.threshold = SINGULAR_TOLERANCE * float(np.abs(self.value).max(initial=0.0))
        self.shift = 0.0
        self.n_factors = 1

    def find_step(self, gradient: FloatArray, radius: float) -> Step:
        """Return the step that saves most energy within `radius`."""
        part = self.vector.T @ gradient
        part[(np.abs(self.value) <= self.threshold) & (np.abs(part) <= self.noise)] = 0.0
        curved = bool(self.value[0] < -self.threshold)
        self.shift = 0.0
        if not curved and bool(np.all(self.value[part != 0.0] > self.threshold)):
            newton = self._along(part)
            if np.linalg.norm(newton) <= radius:
                return self._step(newton, part, False)
        self.shift = self._find_shift(part, radius)
        along = self._along(part)
        missing = radius**2 - float(along @ along)
        if curved and missing > 0.01 * radius**2:
            along[0] += np.copysign(np.sqrt(missing), -part[0])
        return self._step(along, part, True)

    def solve_shifted(self, right: FloatArray) -> FloatArray:
        """Return (K + shift I)^-1 right with the shift of the last step; singular parts stay zero."""
        solved: FloatArray = -self.vector @ self._along(self.vector.T @ right)
        return solved

    def _along(self, part: FloatArray) -> FloatArray:
        """-part / (lambda + shift), eigenvector by eigenvector; singular directions rest."""
        stiff = self.value + self.shift
        usable = stiff > (self.threshold if self.shift == 0 else 0.0)
        along: FloatArray = np.where(usable, -part / np.where(usable, stiff, 1.0), 0.0)
        return along

    def _find_shift(self, part: FloatArray, radius: float) -> float:
        """Return the shift whose step is `radius` long, or the least one where the step is shorter."""
        moving = part != 0.0
        least = max(0.0, -float(self.value[0]))
        stiff, force = self.value[moving], part[moving]
        tiny = SINGULAR_TOLERANCE * float(np.linalg.norm(force)) / radius
        edge = least + max(self.threshold, 1e-12 * least, tiny)

        def excess(shift: float) -> float:
            length = float(np.linalg.norm(force / (stiff + shift)))
            return float(np.log(max(length, 1e-300) / radius))

        if force.size == 0 or excess(edge) <= 0:
            return edge
        most = edge + 1.01 * float(np.linalg.norm(force)) / radius
        return float(scipy.optimize.brentq(excess, edge, most, rtol=1e-6))

    def _step(self, along: FloatArray, part: FloatArray, at_boundary: bool) -> Step:
        saved = -float(part @ along + (self.value * along) @ along / 2)
        return Step(self.vector @ along, saved, at_boundary)


def find_lowest_dense(stiffness: Any, neutral: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest eigenvalue [N/m] and unit eigenvector orthogonal to the columns of `neutral`."""
    matrix = np.asarray(stiffness.toarray())
    complement = np.eye(len(matrix))
    if neutral.shape[1]:
        full, _ = np.linalg.qr(neutral, mode="complete")
        complement = full[:, neutral.shape[1] :]
    reduced = complement.T @ matrix @ complement
    value, vector = np.linalg.eigh((reduced + reduced.T) / 2)
    return float(value[0]), complement @ vector[:, 0]
