"""C text of the numbers of model-predictive control: sizes, weights, limits, places of derivatives."""

from collections.abc import Mapping

import numpy as np

from tensegrity_codegen.control.embedded.parts import ControllerParts, limit_iterations
from tensegrity_codegen.control.embedded.tables import (
    ProgramTables,
    Table,
    TablePrinter,
    find_places,
    tabulate_lists,
)
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.study.tuning import find_angles
from tensegrity_codegen.structure.outline import outline_tendons
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import Precision

ROOT_TOLERANCE = 1e-14  # of the largest eigenvalue of a weight, below which it is zero


def build_prediction_tables(
    parts: ControllerParts, mpc: Mpc, model: Manifest, precision: Precision
) -> ProgramTables:
    """Return the numbers of model-predictive control as the C of a controller needs them."""
    printer = TablePrinter(precision)
    functions = {spec.quantity: spec for spec in model.functions}
    n, m = len(mpc.coordinate_range), len(mpc.R)
    back, _, count = split_delays(parts.bounds.delay, parts.sample)
    # Weights, as sums whose squares are the cost.
    root, last = _find_root(mpc.Q), _find_triangle(mpc.gains.S[-1])
    rows, columns = np.nonzero(root)
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(root)))])
    # Limits: least tensions of members, ranges of coordinates.
    cables, limited = mpc.cables, mpc.cables.limited
    bounded = np.flatnonzero(np.isfinite(mpc.coordinate_range).any(axis=1))
    size = float(np.ptp(outline_tendons(parts.subject).node_position, axis=0).max())
    reach = np.where(find_angles(parts.manifest), np.pi, size)
    tables = [
        printer.whole("BLOCK_START", [0, *np.cumsum(mpc.blocks)], "first command of each block"),
        printer.whole("WEIGHT_START", starts, "where the weighted sums of the errors of a state begin"),
        printer.whole("WEIGHT_COLUMN", columns, "errors in these sums"),
        printer.real("WEIGHT_ROOT", root[rows, columns], "their factors"),
        printer.real("LAST_ROOT", last[np.triu_indices(len(last))], "triangle of the cost of the last state"),
        printer.real("INPUT_WEIGHT", mpc.R, "weight of the deviations of the inputs"),
        printer.real("SOFT_WEIGHT", [mpc.excess_weight], "weight of what exceeds least tensions and ranges"),
        *tabulate_derivatives(printer, functions, parts.bounds.place, n),
        printer.real("PLAN_REACH", reach, "how far a planned coordinate may be from the motion"),
        printer.whole("BOUNDED", bounded, "coordinates with a range"),
        printer.real("BOUNDED_LEAST", mpc.coordinate_range[bounded, 0], "their least values"),
        printer.real("BOUNDED_MOST", mpc.coordinate_range[bounded, 1], "their largest values"),
    ]
    if len(limited):
        pulls, others = cables.incidence[limited] != 0.0, cables.other_incidence[limited] != 0.0
        matrix = functions["equilibrium_matrix"]
        tables += [
            printer.whole("LIMITED_MEMBER", limited, "members with a least tension"),
            printer.real("LIMITED_SPRING", cables.spring_constant[limited], "their spring constants [N/m]"),
            printer.real("LIMITED_AXIAL", cables.axial_stiffness[limited], "their axial stiffnesses [N]"),
            printer.real("LIMITED_REST", cables.base[limited], "their rest lengths without inputs [m]"),
            printer.real("LIMITED_TENSION", mpc.least_tension[limited], "their least tensions [N]"),
            *tabulate_lists(printer, "LIMITED_PULL_START", "LIMITED_PULL", pulls, "actuators of each"),
            *tabulate_lists(printer, "LIMITED_OTHER_START", "LIMITED_OTHER", others, "other inputs of each"),
            printer.whole(
                "LENGTH_PLACE", find_places(matrix, limited), "place of each derivative of a length"
            ),
        ]
    largest = [int(np.prod(spec.shape)) for spec in functions.values()]
    n_blocks, n_soft = len(mpc.blocks), len(mpc.blocks) * (len(limited) + len(bounded))
    variables, set_size = n_blocks * m, n_blocks * m + n_soft + 1
    n_rows = (n_blocks - 1) * m + n_soft
    return ProgramTables(
        {
            "N_HORIZON": mpc.horizon,
            "N_STAGES": mpc.horizon + int(count.max()),
            "N_BLOCKS": n_blocks,
            "N_VARIABLES": variables,
            "N_WEIGHTED": max(len(root), len(last)),
            "N_LIMITED": len(limited),
            "N_BOUNDED": len(bounded),
            "N_SOFT": n_soft,
            "N_ROWS": n_rows,
            "N_CONSTRAINTS": variables + n_rows,
            "N_SET": set_size,
            "SIZE_TRIANGLE": variables * (variables + 1) // 2,
            "SIZE_FACTOR": set_size * (set_size + 1) // 2,
            "SIZE_CALL": max(largest),
        },
        {
            "N_WEIGHTED": len(root),
            "LEAST_DELAY": int(back.min()),
            "MPC_SUBSTEPS": mpc.substeps,
            "QP_ITERATIONS": limit_iterations(parts.qp_iterations, variables + n_rows),
        },
        tables,
    )


def tabulate_derivatives(
    printer: TablePrinter, functions: Mapping[str, FunctionSpec], place: IntArray, n: int
) -> list[Table]:
    """Return where the derivatives of n accelerations belong: by the state, by the inputs at these places."""
    return [
        printer.whole(
            "STATE_PLACE",
            find_places(functions["state_jacobian"], np.arange(2 * n), n),
            "place of each derivative by the state among those of the accelerations",
        ),
        printer.whole(
            "INPUT_PLACE",
            find_places(functions["input_jacobian"], place, n),
            "place of each derivative by the inputs among those of the accelerations by the actuators",
        ),
    ]


def _find_root(weight: FloatArray) -> FloatArray:
    """Return rows W with W^T W = weight; for a diagonal one a row for each entry above zero."""
    if not (weight - np.diag(np.diag(weight))).any():
        chosen = np.flatnonzero(np.diag(weight) > 0.0)
        found: FloatArray = np.sqrt(weight[chosen])
        return found
    values, vectors = np.linalg.eigh(weight)
    kept = values > ROOT_TOLERANCE * values.max(initial=0.0)
    return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)


def _find_triangle(weight: FloatArray) -> FloatArray:
    """Return an upper triangle U with U^T U = weight, which may be singular."""
    values, vectors = np.linalg.eigh(weight)
    return np.asarray(np.linalg.qr(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)[1])
