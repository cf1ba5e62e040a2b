"""Equilibria of many cases in node coordinates, searched side by side; what is rare is left out."""

from collections.abc import Mapping

import numpy as np

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import EquilibriaTable
from tensegrity_codegen.runtime.statics.batch.node_distances import find_distances
from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points, take
from tensegrity_codegen.runtime.statics.batch.search import LEFT, BatchSearch
from tensegrity_codegen.runtime.statics.batch.stability import find_stabilities
from tensegrity_codegen.runtime.statics.equilibrium_record import START_RESIDUAL_TOLERANCE
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.statics.stiff_members import are_stiff, find_spring_constants
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
    # The ground is loaded in steps, and members side by side are single strands
    is_alone = method == "relaxation" or bool(model.manifest.contact_name or model.manifest.ring_nodes)
    is_alone |= bool(model.manifest.internal_name)
    return small and has_all and not is_alone and bool(model.library.batch_width)


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
    whole, everyone = BatchProblem(model, arguments, cases), np.arange(len(cases))
    spring_constant = find_spring_constants(
        lambda name, coordinate: whole.compute(name, coordinate, everyone)[0], start[cases]
    )
    kinds, kind = np.unique(are_stiff(spring_constant), axis=0, return_inverse=True)
    left = []
    for number, is_stiff in enumerate(kinds):
        rows = np.flatnonzero(kind == number)
        problem = BatchProblem(model, arguments, cases[rows])
        problem.watch_stiff_members(np.flatnonzero(is_stiff), spring_constant[rows])
        left.append(cases[rows[_search_all(problem, start[cases[rows]], table, tolerance, max_iterations)]])
    return np.concatenate(left)


def _search_all(
    problem: BatchProblem, start: FloatArray, table: EquilibriaTable, tolerance: float, max_iterations: int
) -> IntArray:
    """Fill the rows of cases of a problem; return the numbers, within the problem, of those that are left."""
    rows = np.arange(len(start))
    begun = problem.find_points(start, rows)
    stiffness, is_finite = problem.find_stiffness(start, rows)
    floor = problem.rounding_floor(stiffness, begun)
    search = BatchSearch(problem, begun)
    axis, total = problem.find_unbalanced_axes(begun, floor * np.sqrt(problem.size + 1))
    search.status[axis >= 0] = "no_equilibrium"
    search.status[~(begun.is_finite & is_finite)] = LEFT
    search.run(tolerance, max_iterations)
    message = [
        _say_unheld(axis[k], total[k]) if axis[k] >= 0 else MESSAGES.get(word, "")
        for k, word in enumerate(search.status.tolist())
    ]
    return _record(search, message, floor, table)


def _say_unheld(axis: int, total: float) -> str:
    return f"nothing is anchored along {'xyz'[axis]}, and the loads there add up to {total:.6g} N"


def _record(search: BatchSearch, message: list[str], floor: FloatArray, table: EquilibriaTable) -> IntArray:
    """Fill rows of the table; return the numbers of cases, within the search, that are left."""
    problem, rows = search.problem, np.flatnonzero(search.status != LEFT)
    if not len(rows):
        return np.arange(len(search.status))
    point, start, status = (take(record, rows) for record in (search.best, search.start, search.status))
    stability = find_stabilities(problem, point, rows)
    is_found = np.isin(status, ("converged", "rounding_limited"))
    is_lost = is_found & (
        stability.is_unstable | stability.is_neutral
    )  # what a single search looks at closer
    is_lost |= np.isnan(stability.smallest_eigenvalue) | (~is_found & stability.is_neutral)
    status[status == "unbounded"] = "no_equilibrium"
    moved = np.linalg.norm(point.position - start.position, axis=2)
    apart, is_known = find_distances(
        start.position, point.position, stability.neutral_motions, stability.twist
    )
    good = np.flatnonzero(is_known & ~is_lost)
    at_start = _find_unstable_starts(problem, take(start, good), rows[good], floor[rows[good]])
    names = np.array(problem.manifest.node_name)
    words = {
        "status": status[good].tolist(),
        "message": [message[k] for k in rows[good]],
        "method": ["newton"] * len(good),
        "displaced_node": names[moved.argmax(axis=1)][good].tolist(),
        "changed_node": names[np.nan_to_num(apart).argmax(axis=1)][good].tolist(),
    }
    arrays = {
        "coordinate": point.coordinate,
        "node_position": point.position,
        "member_length": point.length,
        "member_tension": point.tension,
        "residual": point.node_force,
        "largest_force": point.largest_force,
        "iterations": search.iterations[rows],
        "smallest_eigenvalue": stability.smallest_eigenvalue,
        "neutral_motions": stability.neutral_motions,
        "energy": point.energy,
        "energy_change": point.energy - start.energy,
        "displacement": moved.max(axis=1),
        "change": apart.max(axis=1),
        "extent": np.ptp(start.position, axis=1).max(axis=1),
    }
    found = {name: array[good] for name, array in arrays.items()} | {"is_start_unstable": at_start}
    table.put_many(problem.cases[rows[good]], found, words)
    return np.setdiff1d(np.arange(len(search.status)), rows[good])


def _find_unstable_starts(
    problem: BatchProblem, start: Points, rows: IntArray, floor: FloatArray
) -> BoolArray:
    """Return whether each start is nearly in balance and the energy curves down there."""
    near = start.is_balanced(START_RESIDUAL_TOLERANCE, floor)
    found = near.copy()
    if near.any():
        found[near] = find_stabilities(problem, take(start, near), rows[near]).is_unstable
    return found
