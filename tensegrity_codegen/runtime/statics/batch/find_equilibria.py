"""Stable equilibria of many cases of one structure: loads, parameters, inputs, starts."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import check_argument_names, merge_inputs
from tensegrity_codegen.runtime.model.arrays import agree_on_rows, to_batch
from tensegrity_codegen.runtime.model.interface import require_double, require_model
from tensegrity_codegen.runtime.model.library import check_threads
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria, EquilibriaTable
from tensegrity_codegen.runtime.statics.batch.points import BatchProblem, Points, take
from tensegrity_codegen.runtime.statics.batch.search import LEFT, BatchSearch
from tensegrity_codegen.runtime.statics.batch.stability import find_distances, find_stabilities
from tensegrity_codegen.runtime.statics.equilibrium import (
    START_RESIDUAL_TOLERANCE,
    build_problem,
    check_search_options,
    describe_unheld,
    find_equilibrium,
)
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.statics.stiff_members import are_stiff, find_spring_constants
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.checks import check_callback
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.body_places import find_shown, label_nodes
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.static_methods import FOUND, Method

BLOCK_BYTES = 2**24  # of the stiffnesses of a block
MAX_CASES = 1024  # of a block

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
    return width * max(1, min(MAX_CASES, BLOCK_BYTES // (8 * count**2)) // width)


def search_block(
    model: CompiledModel,
    arguments: Mapping[str, tuple[FloatArray, bool]],
    start: FloatArray,
    cases: IntArray,
    table: EquilibriaTable,
    tolerance: float,
    max_iterations: int,
) -> IntArray:
    """Fill the rows of cases whose search has ended; return the other cases, to be searched alone."""
    problem_of_all, everyone = BatchProblem(model, arguments, cases), np.arange(len(cases))
    spring_constant = find_spring_constants(
        lambda name, coordinate: problem_of_all.compute(name, coordinate, everyone)[0], start[cases]
    )
    kinds, kind = np.unique(are_stiff(spring_constant), axis=0, return_inverse=True)
    unfinished = []
    for number, is_stiff in enumerate(kinds):
        rows = np.flatnonzero(kind == number)
        problem = BatchProblem(model, arguments, cases[rows])
        problem.watch_stiff_members(np.flatnonzero(is_stiff), spring_constant[rows])
        unfinished.append(
            cases[rows[_search_all(problem, start[cases[rows]], table, tolerance, max_iterations)]]
        )
    return np.concatenate(unfinished)


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
        describe_unheld(axis[k], total[k]) if axis[k] >= 0 else MESSAGES.get(status, "")
        for k, status in enumerate(search.status.tolist())
    ]
    return _record(search, message, floor, table)


def _record(search: BatchSearch, message: list[str], floor: FloatArray, table: EquilibriaTable) -> IntArray:
    """Fill rows of the table; return the numbers of cases, within the search, that are left."""
    problem, rows = search.problem, np.flatnonzero(search.status != LEFT)
    if not len(rows):
        return np.arange(len(search.status))
    point, start, status = (take(record, rows) for record in (search.best, search.start, search.status))
    stability = find_stabilities(problem, point, rows)
    is_found = np.isin(status, FOUND)
    # A single search looks at these closer.
    is_lost = is_found & (stability.is_unstable | stability.is_neutral)
    is_lost |= np.isnan(stability.smallest_eigenvalue) | (~is_found & stability.is_neutral)
    status[status == "unbounded"] = "no_equilibrium"
    moved = np.linalg.norm(point.position - start.position, axis=2)
    distance, is_known = find_distances(
        start.position, point.position, stability.neutral_motions, stability.twist
    )
    good = np.flatnonzero(is_known & ~is_lost)
    at_start = _find_unstable_starts(problem, take(start, good), rows[good], floor[rows[good]])
    bodies = problem.manifest.body_places
    names = np.array(label_nodes(problem.manifest.node_name, bodies))
    moved, distance = (np.where(find_shown(len(names), bodies), x, 0.0) for x in (moved, distance))
    texts = {
        "status": status[good].tolist(),
        "message": [message[k] for k in rows[good]],
        "method": ["newton"] * len(good),
        "displaced_node": names[moved.argmax(axis=1)][good].tolist(),
        "changed_node": names[np.nan_to_num(distance).argmax(axis=1)][good].tolist(),
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
        "change": distance.max(axis=1),
        "extent": np.ptp(start.position, axis=1).max(axis=1),
    }
    columns = {name: array[good] for name, array in arrays.items()} | {"is_start_unstable": at_start}
    table.put_many(problem.cases[rows[good]], columns, texts)
    return np.setdiff1d(np.arange(len(search.status)), rows[good])


def _find_unstable_starts(
    problem: BatchProblem, start: Points, rows: IntArray, floor: FloatArray
) -> BoolArray:
    """Return whether each start is nearly in balance and the energy curves down there."""
    is_balanced = start.is_balanced(START_RESIDUAL_TOLERANCE, floor)
    is_unstable = is_balanced.copy()
    if is_balanced.any():
        is_unstable[is_balanced] = find_stabilities(
            problem, take(start, is_balanced), rows[is_balanced]
        ).is_unstable
    return is_unstable


def find_equilibria(
    model: CompiledModel,
    *,
    coordinate: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    tolerance: float = 1e-9,
    max_iterations: int = 500,
    method: Method = "auto",
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Equilibria:
    """Find stable equilibria of many cases: loads, parameters, inputs or starts.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"equilibria"`` (or ``"equilibrium"``, without batch functions), see compile_scene.
    coordinate : array_like, shape (n_coordinates,) or (n_batch, n_coordinates), optional
        Starts [m]; by default the positions of the scene.
    arguments : mapping, optional
        Run-time parameters and inputs by name, with or without a leading axis (n_batch,). At least one of
        the arrays has that axis, or `coordinate` has it.
    tolerance : float
        Allowed node residual, as a part of the largest member force.
    max_iterations : int
        Largest number of iterations of each case.
    method : str
        ``"newton"``, ``"relaxation"`` or ``"auto"``, as in `find_equilibrium`.
    threads : int
        Number of threads; the results do not depend on it.
    progress : callable, optional
        Called with the part of the cases that is done, 0 to 1.

    Returns
    -------
    Equilibria
        One row a case, each with its status; a case without equilibrium does not affect the others.

    Raises
    ------
    InvalidValueError
        A shape or option is out of range.
    UnknownNameError
        An unknown argument.
    FormulationError, LibraryError
        The model lacks a quantity, or is of single precision.

    Notes
    -----
    In node coordinates, with batch functions and up to 200 coordinates, the steps of `find_equilibrium` are
    taken for many cases side by side, with the same radii and the same tests; cases that meet a saddle, a
    mechanism or a failure are searched again alone. Elsewhere, and on the ground, all cases are searched one
    by one.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import compile_scene, find_equilibria
    >>> model = compile_scene("two_nodes.toml", for_="equilibria")
    >>> found = find_equilibria(model, coordinate=np.array([[0, 0, -1.0], [0, 0, -1.2]]))
    >>> found.status, found.member_length.round(4).ravel().tolist()
    (('converged', 'converged'), [1.0613, 1.0613])
    """
    require_model(model)
    check_callback(progress, "progress")
    check_search_options(tolerance, max_iterations, method)
    check_threads(threads)
    starts = _read_starts(model, coordinate, arguments)
    build_problem(model, starts.arguments_of(0))  # raises what no case could be searched with
    search = _Search(model, starts, tolerance, max_iterations, method)
    search.run_all(threads, progress)
    return search.table.build()


@dataclass(frozen=True, eq=False)
class _Starts:
    """Starts (n_batch, n_coordinates), and arguments with whether each has one row a case."""

    coordinate: FloatArray
    arguments: Mapping[str, tuple[FloatArray, bool]]

    @property
    def count(self) -> int:
        return len(self.coordinate)

    def arguments_of(self, k: int) -> dict[str, FloatArray]:
        """Return the arguments of one case."""
        return {
            name: array[k] if is_batched else array for name, (array, is_batched) in self.arguments.items()
        }


def _read_starts(
    model: CompiledModel, coordinate: ArrayLike | None, arguments: Mapping[str, Any] | None
) -> _Starts:
    require_double(model.manifest, "the search for an equilibrium")
    merged = merge_inputs(model.manifest, arguments, is_batch=True, dtype=model.dtype)
    check_argument_names(model.manifest, merged)
    values = {
        name: to_batch(value, model.nominal(name).shape, model.library.precision, name)
        for name, value in merged.items()
    }
    nominal = model.nominal("coordinate")
    starts = to_batch(
        nominal if coordinate is None else coordinate, nominal.shape, model.library.precision, "coordinate"
    )
    lengths = {
        name: len(array)
        for name, (array, is_batched) in {**values, "coordinate": starts}.items()
        if is_batched
    }
    count = agree_on_rows(lengths, "find_equilibria", "use find_equilibrium() for a single case")
    start = starts[0] if starts[1] else np.tile(starts[0], (count, 1))
    return _Starts(start, values)


class _Search:
    """The search of all cases, block by block, into one table of results."""

    def __init__(
        self, model: CompiledModel, starts: _Starts, tolerance: float, max_iterations: int, method: Method
    ) -> None:
        self.model, self.starts, self.method = model, starts, method
        self.tolerance, self.max_iterations = tolerance, max_iterations
        self.table = EquilibriaTable(model, starts.coordinate)
        self.side_by_side = can_go_side_by_side(model, method)

    def divide(self) -> list[IntArray]:
        """Return the numbers of the cases of each block."""
        size = block_size(self.model) if self.side_by_side else 1
        cases = np.arange(self.starts.count)
        return [cases[start : start + size] for start in range(0, len(cases), size)]

    def run_all(self, threads: int, progress: Callable[[float], None] | None) -> None:
        """Search all blocks, in threads where there are several."""
        blocks, done = self.divide(), 0

        def note(count: int) -> None:
            nonlocal done
            done += count
            if progress is not None:
                progress(done / self.starts.count)

        if threads == 1:
            for block in blocks:
                note(self.run(block))
            return
        with ThreadPoolExecutor(threads) as pool:  # the calls into C and LAPACK hold no lock of Python's
            try:
                for count in pool.map(self.run, blocks):
                    note(count)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def run(self, cases: IntArray) -> int:
        """Search the cases of a block, and return how many they are."""
        inputs = {"coordinate": (self.starts.coordinate, True), **self.starts.arguments}
        good = np.ones(len(cases), dtype=np.bool_)
        for name, (array, is_batched) in inputs.items():
            values = array[cases].reshape(len(cases), -1) if is_batched else array.reshape(1, -1)
            is_finite = np.broadcast_to(np.isfinite(values).all(axis=1), len(cases))
            for k in cases[good & ~is_finite]:
                self.table.put(int(k), ("non_finite_input", f"{name} is not finite"))
            good &= is_finite
        remaining = cases[good]
        if self.side_by_side and len(remaining):
            arguments, coordinate = self.starts.arguments, self.starts.coordinate
            options = (self.tolerance, self.max_iterations)
            remaining = search_block(self.model, arguments, coordinate, remaining, self.table, *options)
        for k in remaining.tolist():
            self.table.put(k, self._find_one(k))
        return len(cases)

    def _find_one(self, k: int) -> Equilibrium | tuple[str, str]:
        """Return the record of one case, or status and message where it cannot even be recorded."""
        try:
            return find_equilibrium(
                self.model,
                coordinate=self.starts.coordinate[k],
                arguments=self.starts.arguments_of(k),
                tolerance=self.tolerance,
                max_iterations=self.max_iterations,
                method=self.method,
                raise_on_failure=False,
            )
        except NonFiniteError as error:
            return "not_finite", str(error.problem)
