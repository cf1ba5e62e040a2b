"""Equilibria of many cases in node coordinates, searched side by side; what is rare is left out."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import EquilibriaTable
from tensegrity_codegen.runtime.statics.batch.node_distances import find_distances
from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points
from tensegrity_codegen.runtime.statics.batch.search import LEFT, MOVING, BatchSearch
from tensegrity_codegen.runtime.statics.batch.stability import Stabilities, find_stabilities
from tensegrity_codegen.runtime.statics.equilibrium_record import START_RESIDUAL_TOLERANCE
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.tables.formulations import find_formulation

BLOCK_BYTES = 2**24  # of the stiffnesses of a block
MOST_CASES = 1024  # of a block

MESSAGES = {
    "converged": "",
    "rounding_limited": "rounding error keeps the residual above the tolerance",
    "unbounded": "the loads move the structure without bound",
}


def can_go_side_by_side(model: CompiledModel, method: str) -> bool:
    """Return whether cases of this model can be searched side by side by this method."""
    in_nodes = find_formulation(model.manifest.formulation).statics == "nodes"
    count = len(model.manifest.coordinate_name)
    small = in_nodes and count == len(model.manifest.coordinate_node_axis) and 0 < count <= DENSE_LIMIT
    has_all = all(model.has(name) for name in EQUILIBRIUM_QUANTITIES)
    return small and has_all and method != "relaxation" and bool(model.library.batch_width)


def block_size(model: CompiledModel) -> int:
    """Return how many cases are searched at a time: a whole number of lanes."""
    count, width = len(model.manifest.coordinate_name), model.library.batch_width
    return width * max(1, min(MOST_CASES, BLOCK_BYTES // (8 * count**2)) // width)


def search_block(
    model: CompiledModel,
    arguments: Mapping[str, tuple[FloatArray, bool]],
    start: FloatArray,
    cases: IntArray,
    table: EquilibriaTable,
    tolerance: float,
    max_iterations: int,
) -> IntArray:
    """Fill the rows of cases whose search has ended; return the other cases, which are to be searched alone.

    start: (n_batch, n_coordinates) of all cases; arguments: each with whether it has one row a case.
    """
    problem = BatchProblem(model, arguments)
    begun = problem.find_points(start[cases], cases)
    stiffness, is_finite = problem.find_stiffness(start[cases], cases)
    good = np.flatnonzero(begun.is_finite & is_finite)
    left = [np.flatnonzero(~(begun.is_finite & is_finite))]
    if len(good):
        begun, own = begun.take(good), cases[good]
        floor = problem.rounding_floor(stiffness[good], begun, own)
        search = BatchSearch(problem, own, begun)
        axis, total = problem.find_unbalanced_axes(begun, floor * np.sqrt(problem.size + 1))
        search.status[axis >= 0] = "no_equilibrium"
        search.run(tolerance, max_iterations)
        message = [
            _say_unheld(axis[k], total[k]) if axis[k] >= 0 else MESSAGES.get(word, "")
            for k, word in enumerate(search.status.tolist())
        ]
        left.append(good[_record(search, message, floor, table)])
    return cases[np.concatenate(left)]


def _say_unheld(axis: int, total: float) -> str:
    return f"nothing is anchored along {'xyz'[axis]}, and the loads there add up to {total:.6g} N"


def _record(search: BatchSearch, message: list[str], floor: FloatArray, table: EquilibriaTable) -> IntArray:
    """Fill rows of the table; return the numbers of cases, within the search, that are left."""
    problem, point, start = search.problem, search.best, search.start
    stability = find_stabilities(problem, point, search.cases)
    status = search.status.copy()
    ended = np.isin(status, ("converged", "rounding_limited"))
    is_lost = ended & (stability.is_unstable | stability.is_neutral)  # what a single search looks at closer
    status[is_lost | (status == MOVING) | np.isnan(stability.smallest_eigenvalue)] = LEFT
    at_start = _find_unstable_starts(search, floor, status)
    status[status == "unbounded"] = "no_equilibrium"
    position = problem.place(point.coordinate, search.cases)
    begun = problem.place(start.coordinate, search.cases)
    moved = np.linalg.norm(position - begun, axis=2)
    apart, is_known = find_distances(begun, position, stability.neutral_motions, stability.twist)
    status[~is_known | ((status == "no_equilibrium") & stability.is_neutral)] = LEFT
    rows = np.flatnonzero(status != LEFT)
    names = np.array(problem.manifest.node_name)
    words = {
        "status": status[rows].tolist(),
        "message": [message[k] for k in rows],
        "method": ["newton"] * len(rows),
        "displaced_node": names[moved.argmax(axis=1)][rows].tolist(),
        "changed_node": names[np.nan_to_num(apart).argmax(axis=1)][rows].tolist(),
    }
    arrays = _list_arrays(point, start, stability) | {
        "node_position": position,
        "iterations": search.iterations,
        "displacement": moved.max(axis=1),
        "change": apart.max(axis=1),
        "extent": np.ptp(begun, axis=1).max(axis=1),
        "is_start_unstable": at_start,
    }
    table.put_many(search.cases[rows], {name: array[rows] for name, array in arrays.items()}, words)
    return np.flatnonzero(status == LEFT)


def _list_arrays(point: Points, start: Points, stability: Stabilities) -> dict[str, NDArray[np.generic]]:
    return {
        "coordinate": point.coordinate,
        "member_length": point.length,
        "member_tension": point.tension,
        "residual": point.node_force,
        "largest_force": point.largest_force,
        "smallest_eigenvalue": stability.smallest_eigenvalue,
        "neutral_motions": stability.neutral_motions,
        "energy": point.energy,
        "energy_change": point.energy - start.energy,
    }


def _find_unstable_starts(search: BatchSearch, floor: FloatArray, status: NDArray[np.str_]) -> BoolArray:
    """Return whether the start of each case is nearly in balance and the energy curves down there."""
    found = np.zeros(len(status), dtype=np.bool_)
    near = np.flatnonzero(search.start.is_balanced(START_RESIDUAL_TOLERANCE, floor) & (status != LEFT))
    if len(near):
        stability = find_stabilities(search.problem, search.start.take(near), search.cases[near])
        found[near] = stability.is_unstable
    return found
