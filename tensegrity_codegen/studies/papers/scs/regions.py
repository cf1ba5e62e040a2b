"""Where a tower can stand symmetrically: maps over azimuth and declination, prestressable configurations.

Under a force F_3 the tensions are A_r^-1 (0, 0, F_3) (SCS 31), so only the sign of F_3 matters for the map.
Without a force they are a null vector of A_r, which exists only on the contour det(A_r) = 0 (SCS 42).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tensegrity_codegen.studies.papers.scs.symmetry import GROUPS, SymmetricPose, SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

OUTSIDE = -1
MOST_CELLS = 1_000_000


@dataclass(frozen=True)
class RegionMap:
    """What holds over a grid of alpha (columns) and delta (rows) at one height and force.

    alpha_deg (n_a,), delta_deg (n_d,); code (n_d, n_a): 0 all tendons taut, else the sum of 1, 2, 4 for
    saddle, vertical, diagonal that would have to push, -1 outside the bounds; tension (n_d, n_a, 3) [N],
    NaN outside; determinant (n_d, n_a): det(A_r), of which the zero contour is SCS (42), NaN outside.
    """

    alpha_deg: FloatArray
    delta_deg: FloatArray
    height: float
    force: float
    code: NDArray[np.int8]
    tension: FloatArray
    determinant: FloatArray

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(n_d, n_a): where the tower can stand with all tendons taut."""
        return np.asarray(self.code == 0)

    def summary(self) -> dict[str, Any]:
        """Return how much of the grid each code covers, as one JSON-ready object."""
        words = {OUTSIDE: "outside the bounds", 0: "taut"}
        for code in range(1, 8):
            words[code] = "pushing: " + ", ".join(name for k, name in enumerate(GROUPS) if code & 1 << k)
        share = {word: float(np.mean(self.code == code)) for code, word in words.items()}
        return {"height": self.height, "force": self.force, "share": share}


@dataclass(frozen=True)
class PrestressablePose:
    """A configuration that stands without load: pose, and tensions per unit of their norm, all positive."""

    pose: SymmetricPose
    tension: FloatArray


def map_regions(
    tower: SymmetricTower,
    height: float,
    force: float,
    *,
    alpha_deg: FloatArray | None = None,
    delta_deg: FloatArray | None = None,
) -> RegionMap:
    """Return the map at a height [m] under F_3 = `force` [N], not zero; by default in steps of 1 degree.

    Raises InvalidValueError for a force of zero, a height that is not positive, or an empty or huge grid.
    """
    alpha = np.arange(0.0, 361.0) if alpha_deg is None else np.asarray(alpha_deg, dtype=np.float64)
    delta = np.arange(1.0, 90.0) if delta_deg is None else np.asarray(delta_deg, dtype=np.float64)
    _check_map(height, force, alpha, delta)
    grid = np.array([(math.radians(a), math.radians(d), height) for d in delta for a in alpha])
    matrix, shape = tower.matrix(grid), (len(delta), len(alpha))
    inside = tower.is_inside(grid).reshape(shape)
    determinant = np.where(inside, np.linalg.det(matrix).reshape(shape), np.nan)
    # T = A_r^-1 (0, 0, F): by cross products, so that nothing is solved where the matrix is singular.
    along = np.cross(matrix[:, 0], matrix[:, 1]).reshape(*shape, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        tension = force * along / determinant[..., None]
    code = (np.where(tension > 0, 0, 1) * np.array([1, 2, 4])).sum(axis=2)
    code[~inside] = OUTSIDE
    return RegionMap(alpha, delta, height, force, code.astype(np.int8), tension, determinant)


def find_prestressable(tower: SymmetricTower, delta: float, height: float) -> tuple[PrestressablePose, ...]:
    """Return the poses of a declination [rad] and height [m] that stand without load (SCS 30, F_3 = 0).

    The azimuths are roots of det(A_r), looked for in steps of 1 degree; those are kept whose null vector has
    one sign.
    Raises InvalidValueError for a declination or height outside the bounds of SCS 4.
    """
    tower.check_pose(SymmetricPose(0.0, delta, height), "prestressable configuration")
    azimuth = np.radians(np.arange(0.5, 361.5))

    def determinant(alpha: float) -> float:
        return float(tower.determinant(np.array([[alpha, delta, height]]))[0])

    values = tower.determinant(np.array([(alpha, delta, height) for alpha in azimuth]))
    found = []
    for row in np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1])):
        alpha = float(brentq(determinant, azimuth[row], azimuth[row + 1], xtol=1e-15))
        null = np.linalg.svd(tower.matrix(np.array([[alpha, delta, height]]))[0])[2][-1]
        tension = null * np.sign(null.sum())
        if (tension > 0).all():
            found.append(PrestressablePose(SymmetricPose(alpha % (2 * math.pi), delta, height), tension))
    return tuple(found)


def _check_map(height: float, force: float, alpha: FloatArray, delta: FloatArray) -> None:
    if not (math.isfinite(height) and height > 0):
        raise InvalidValueError(
            "out of range", where="height", given=height, allowed="a finite number > 0 [m]"
        )
    if not math.isfinite(force) or force == 0.0:
        raise InvalidValueError(
            "a map needs a force",
            where="force",
            given=force,
            allowed="a finite number that is not zero [N]",
            hint="without a force, see find_prestressable",
        )
    cells = alpha.size * delta.size
    finite = np.isfinite(alpha).all() and np.isfinite(delta).all()
    if not finite or not 1 <= cells <= MOST_CELLS or alpha.ndim != 1 or delta.ndim != 1:
        raise InvalidValueError(
            "not a grid",
            where="alpha_deg, delta_deg",
            given=f"{alpha.shape} x {delta.shape}",
            allowed=f"two lists of finite angles, at most {MOST_CELLS} cells",
        )
