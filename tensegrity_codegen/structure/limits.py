"""Limits of a structure: tensions, stresses, buckling, clearance between bars, stiffness."""

import math
from dataclasses import dataclass, field, fields

import numpy as np

from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray

# Limits of single members, and the value of each that limits nothing.
MEMBER_LIMITS = {
    "least_tension": -math.inf,
    "most_tension": math.inf,
    "yield_stress": math.inf,
    "buckling": 0.0,
}


def _no_members() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of a structure, member by member; without a limit a value is infinite, `buckling` 0 or less.

    Attributes
    ----------
    least_tension, most_tension : ndarray, shape (n_members,) [N]
        Bounds of the tension of each member; -infinity and infinity without a limit.
    yield_stress : ndarray, shape (n_members,) [Pa]
        Largest axial stress, in tension and in compression; infinite without a limit.
    buckling : ndarray, shape (n_members,) [1]
        Safety factor against Euler buckling; 0 without a limit; -infinity where it is stated as false.
    clearance : float [m]
        Least distance between the surfaces of bars; -infinity without a limit.
    least_stiffness : float [N/m]
        Bound of the smallest eigenvalue of the tangent stiffness; -infinity without a limit.

    Notes
    -----
    With tension t, section A, length l and flexural rigidity E I of a member, the limits are::

        least_tension <= t <= most_tension
        |t| / A <= yield_stress
        -t buckling <= pi^2 E I / l^2
        clearance <= distance between two bars
        least_stiffness <= smallest eigenvalue of the tangent stiffness

    which hold for every t where there is no limit.
    """

    least_tension: FloatArray = field(default_factory=_no_members)
    most_tension: FloatArray = field(default_factory=_no_members)
    yield_stress: FloatArray = field(default_factory=_no_members)
    buckling: FloatArray = field(default_factory=_no_members)
    clearance: float = -math.inf
    least_stiffness: float = -math.inf

    def __post_init__(self) -> None:
        freeze_fields(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Limits) and all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    def __hash__(self) -> int:
        return hash((*(getattr(self, key).tobytes() for key in MEMBER_LIMITS), self.clearance))

    @property
    def is_stated(self) -> bool:
        """Whether there is any limit."""
        of_members = any(np.any(getattr(self, key) != none) for key, none in MEMBER_LIMITS.items())
        return bool(of_members or self.clearance > -math.inf or self.least_stiffness > -math.inf)

    def for_members(self, count: int) -> "Limits":
        """Return the limits themselves, or where they are of no members at all, those of `count` members.

        Parameters
        ----------
        count : int
            Number of members of the structure.

        Returns
        -------
        Limits
            Limits whose arrays have the shape (count,), if they had the shape (0,).
        """
        if count == 0 or any(len(getattr(self, key)) for key in MEMBER_LIMITS):
            return self
        free = {key: np.full(count, none) for key, none in MEMBER_LIMITS.items()}
        return Limits(**free, clearance=self.clearance, least_stiffness=self.least_stiffness)
