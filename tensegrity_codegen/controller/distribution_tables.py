"""C text of the numbers of a distribution of tensions: sizes, members, pulls, bounds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.manifest import FunctionSpec
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.control.tension_distribution import PASSES, TensionDistribution

__all__ = ["DistributionTables", "build_distribution_tables"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class DistributionTables:
    """Sizes, and tables of whole numbers and of real ones, by their names in C.

    Attributes
    ----------
    sizes : dict of str to int
        Enumerators that the header states.
    constants : dict of str to int
        Enumerators of the source alone.
    indices : dict of str to ndarray of int
        Tables of indices.
    numbers : dict of str to ndarray
        Tables of numbers.
    weight_root : float
        Root of eps over the mean square of the equilibrium matrix.
    """

    sizes: dict[str, int]
    constants: dict[str, int]
    indices: dict[str, IntArray]
    numbers: dict[str, FloatArray]
    weight_root: float


def build_distribution_tables(
    distribution: TensionDistribution, motion: Motion, matrix: FunctionSpec, *, iterations: int = 100
) -> DistributionTables:
    """Return the numbers of a distribution as the C of a controller needs them.

    Parameters
    ----------
    distribution : TensionDistribution
        As of design_distribution.
    motion : Motion
        The motion of the controller, whose knots are those of the preferred tensions.
    matrix : FunctionSpec
        The equilibrium matrix as the model computes it.
    iterations : int
        Most iterations of DAQP in one quadratic program.

    Returns
    -------
    DistributionTables
        Tables by their names in C.
    """
    cables, driven = distribution.cables, distribution.cables.driven
    pulls = cables.incidence[driven].astype(bool)
    others = cables.other_incidence[driven].astype(bool)
    limited = np.isin(driven, cables.limited) & (
        cables.spring_constant[driven] + cables.axial_stiffness[driven] > 0.0
    )
    is_shared = pulls.sum(axis=1) > 1
    n_coordinates, preferred = motion.coordinate.shape[1], distribution.preferred
    table = (motion.member_tension if preferred is None else preferred[None])[:, driven]
    places = _find_places(matrix, driven)
    sizes = {
        "N_MEMBERS": len(cables.base),
        "N_DRIVEN": len(driven),
        "N_PULLS": int(pulls.sum()),
        "N_SHARED": int((limited & is_shared).sum()),
        "N_ROWS": n_coordinates + (len(driven) if is_shared.any() else 0),
        "SIZE_EQUILIBRIUM": len(places),
    }
    return DistributionTables(
        sizes,
        {"N_PREFERRED": len(table), "QP_ITERATIONS": iterations, "QP_PASSES": PASSES},
        {
            "DRIVEN_MEMBER": driven,
            "IS_LIMITED": limited.astype(np.int64),
            "PULL_START": _starts(pulls.sum(axis=0)),
            "PULL_DRIVEN": np.nonzero(pulls.T)[1],
            "DRIVEN_START": _starts(pulls.sum(axis=1)),
            "DRIVEN_PULL": np.nonzero(pulls)[1],
            "OTHER_START": _starts(others.sum(axis=1)),
            "OTHER_INPUT": np.nonzero(others)[1],
            "EQUILIBRIUM_PLACE": places,
        },
        {
            "SPRING_CONSTANT": cables.spring_constant[driven],
            "AXIAL_STIFFNESS": cables.axial_stiffness[driven],
            "DRIVEN_REST": cables.base[driven],
            "LEAST_TENSION": np.where(limited, distribution.least_tension[driven], 0.0),
            "PREFERRED_TENSION": table.ravel(),
        },
        float(np.sqrt(distribution.weight)),
    )


def _find_places(matrix: FunctionSpec, driven: IntArray) -> IntArray:
    """Return where each entry belongs in the columns of driven members, stored row by row; -1: nowhere."""
    if matrix.pattern is not None:
        rows = matrix.pattern.row.astype(np.int64)
        columns = np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.pattern.column_start))
    else:
        rows, columns = (part.ravel() for part in np.indices(matrix.shape))
    place = np.full(matrix.shape[1], -1)
    place[driven] = np.arange(len(driven))
    found: IntArray = np.where(place[columns] < 0, -1, rows * len(driven) + place[columns])
    return found


def _starts(counts: Iterable[Any]) -> IntArray:
    """Return where rows start that have so many entries, and the end of the last one."""
    return np.concatenate([[0], np.cumsum(list(counts), dtype=np.int64)])
