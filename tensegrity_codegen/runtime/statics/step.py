"""Operations of a trust region on a stiffness: the best step within a radius, solves with its shift.

The step minimises g.s + s.K s / 2 over |s| <= radius, through (K + shift I) s = -g with the smallest
shift >= 0 that makes K + shift I positive definite and s short enough (J. J. Moré, D. C. Sorensen,
"Computing a trust region step", SIAM J. Sci. Stat. Comput. 4, 1983).
"""

from dataclasses import dataclass
from typing import Protocol

from tensegrity_codegen.system.arrays import FloatArray

SINGULAR_TOLERANCE = 1e-13  # of the norm of the stiffness: eigenvalues below are rounding


@dataclass(frozen=True)
class Step:
    """A step (n_coordinates,) [m], the energy that it should save [J], whether the radius cut it."""

    vector: FloatArray
    predicted: float
    at_boundary: bool


class Curvature(Protocol):
    """The stiffness of one configuration, ready for steps; `shift` [N/m] is that of the last step.

    n_factors: factorisations so far.
    """

    shift: float
    n_factors: int

    def find_step(self, gradient: FloatArray, radius: float) -> Step:
        """Return the step that saves most energy within `radius`."""
        ...

    def solve_shifted(self, right: FloatArray) -> FloatArray:
        """Return (K + shift I)^-1 right with the shift of the last step."""
        ...
