"""C text of the numbers of a distribution of tensions: sizes, members, pulls, bounds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.control.embedded.table_printer import Table, TablePrinter
from tensegrity_codegen.control.feedback.tension_distribution import PASSES, TensionDistribution
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec
from tensegrity_codegen.tables.precision import Precision

QP_ITERATIONS = 100
# With smaller weights rounding in single precision hides which bounds depend on each other.
LEAST_WEIGHT = {"double": 0.0, "single": 1e-4}


@dataclass(frozen=True)
class DistributionTables:
    """Sizes and tables of a distribution.

    Attributes
    ----------
    sizes : dict of str to int
        Sizes that the header states, by their names in C.
    constants : dict of str to int
        Enumerators of the source alone.
    tables : list of Table
        Constant arrays.
    has_others : bool
        Whether inputs that are not the actuators' change rest lengths of driven members.
    """

    sizes: dict[str, int]
    constants: dict[str, int]
    tables: list[Table]
    has_others: bool


def build_distribution_tables(
    distribution: TensionDistribution,
    motion: Motion,
    matrix: FunctionSpec,
    precision: Precision,
    *,
    iterations: int = QP_ITERATIONS,
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
    precision : Precision
        Of the numbers.
    iterations : int
        Most iterations of DAQP in one quadratic program.

    Returns
    -------
    DistributionTables
        Sizes and tables by their names in C.
    """
    cables, driven = distribution.cables, distribution.cables.driven
    pulls, others = cables.incidence[driven] != 0.0, cables.other_incidence[driven] != 0.0
    is_stiff = cables.spring_constant[driven] + cables.axial_stiffness[driven] > 0.0
    limited = np.isin(driven, cables.limited) & is_stiff
    places = _find_places(matrix, driven)
    preferred = distribution.preferred
    table = (motion.member_tension if preferred is None else preferred[None])[:, driven]
    printer, weight = TablePrinter(precision), max(distribution.weight, LEAST_WEIGHT[precision.name])
    tables = [
        printer.whole("DRIVEN_MEMBER", driven, "members that actuators pull"),
        printer.whole("IS_LIMITED", limited, "whether they have a least tension"),
        printer.real("SPRING_CONSTANT", cables.spring_constant[driven], "their spring constants [N/m]"),
        printer.real("AXIAL_STIFFNESS", cables.axial_stiffness[driven], "their axial stiffnesses [N]"),
        printer.real("DRIVEN_REST", cables.base[driven], "their rest lengths without inputs [m]"),
        printer.real(
            "LEAST_TENSION", np.where(limited, distribution.least_tension[driven], 0.0), "least tensions [N]"
        ),
        printer.real("PREFERRED_TENSION", table, "preferred tensions at each knot [N]"),
        printer.real("WEIGHT_ROOT", [np.sqrt(weight)], "root of the weight of preferred tensions"),
        *_lists(printer, "PULL_START", "PULL_DRIVEN", pulls.T, "driven members of each actuator"),
        *_lists(printer, "DRIVEN_START", "DRIVEN_PULL", pulls, "actuators that pull each driven member"),
        printer.whole("EQUILIBRIUM_PLACE", places, "place of each entry in the columns of driven members"),
    ]
    if others.any():
        tables += _lists(printer, "OTHER_START", "OTHER_INPUT", others, "other inputs of each driven member")
    constants = {
        "N_PREFERRED": len(table),
        "IS_COUPLED": int((pulls.sum(axis=1) > 1).any()),
        "IS_FIXED": int(cables.is_one_to_one),
        "QP_ITERATIONS": iterations,
        "QP_PASSES": 1 if cables.is_one_to_one else PASSES,
    }
    sizes = _find_sizes(pulls, limited, motion.coordinate.shape[1], len(cables.base), len(places))
    return DistributionTables(sizes, constants, tables, bool(others.any()))


def _find_sizes(
    pulls: NDArray[np.bool_], limited: NDArray[np.bool_], n_coordinates: int, n_members: int, n_entries: int
) -> dict[str, int]:
    """Return the sizes for members (rows) that actuators (columns) pull."""
    n_driven, n = pulls.shape
    is_shared = pulls.sum(axis=1) > 1
    shared = int((limited & is_shared).sum())
    rows = n_coordinates + (n_driven if is_shared.any() else 0)
    return {
        "N_MEMBERS": n_members,
        "N_DRIVEN": n_driven,
        "N_PULLS": int(pulls.sum()),
        "N_SHARED": shared,
        "N_ROWS": rows,
        "N_TARGETS": rows + n,
        "N_BOUNDS": n + shared,
        "N_SUMMED": max(shared, 1),
        "N_SET": n + 1,
        "SIZE_EQUILIBRIUM": n_entries,
        "SIZE_MATRIX": (rows + n) * n,
        "SIZE_TRIANGLE": n * (n + 1) // 2,
        "SIZE_FACTOR": (n + 1) * (n + 2) // 2,
    }


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


def _lists(
    printer: TablePrinter, start: str, entry: str, chosen: NDArray[np.bool_], comment: str
) -> list[Table]:
    """Return two tables: where the list of each row starts, and the chosen columns of all rows."""
    starts: ArrayLike = np.concatenate([[0], np.cumsum(chosen.sum(axis=1))])
    return [
        printer.whole(start, starts, f"where the {comment} begin"),
        printer.whole(entry, np.nonzero(chosen)[1], comment),
    ]
