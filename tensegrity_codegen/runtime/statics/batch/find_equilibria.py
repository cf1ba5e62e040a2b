"""Stable equilibria of many cases of one structure: loads, parameters, inputs, starts."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import agree_on_rows, to_batch
from tensegrity_codegen.runtime.model.batch import check_threads
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import check_argument_names, merge_inputs
from tensegrity_codegen.runtime.model.require import require_double, require_model
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria, EquilibriaTable
from tensegrity_codegen.runtime.statics.batch.side_by_side import (
    block_size,
    can_go_side_by_side,
    search_block,
)
from tensegrity_codegen.runtime.statics.equilibrium import (
    build_problem,
    check_search_options,
    find_equilibrium,
)
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.checks import check_callback
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.static_methods import Method


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
    given = {
        name: to_batch(value, model.nominal(name).shape, model.library.precision, name)
        for name, value in merged.items()
    }
    nominal = model.nominal("coordinate")
    place = to_batch(
        nominal if coordinate is None else coordinate, nominal.shape, model.library.precision, "coordinate"
    )
    lengths = {
        name: len(array) for name, (array, is_batched) in {**given, "coordinate": place}.items() if is_batched
    }
    count = agree_on_rows(lengths, "find_equilibria", "use find_equilibrium() for a single case")
    start = place[0] if place[1] else np.tile(place[0], (count, 1))
    return _Starts(start, given)


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
        return [cases[first : first + size] for first in range(0, len(cases), size)]

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
        parts = {"coordinate": (self.starts.coordinate, True), **self.starts.arguments}
        good = np.ones(len(cases), dtype=np.bool_)
        for name, (array, is_batched) in parts.items():
            own = array[cases].reshape(len(cases), -1) if is_batched else array.reshape(1, -1)
            is_finite = np.broadcast_to(np.isfinite(own).all(axis=1), len(cases))
            for k in cases[good & ~is_finite]:
                self.table.put(int(k), ("non_finite_input", f"{name} is not finite"))
            good &= is_finite
        left = cases[good]
        if self.side_by_side and len(left):
            given, place = self.starts.arguments, self.starts.coordinate
            options = (self.tolerance, self.max_iterations)
            left = search_block(self.model, given, place, left, self.table, *options)
        for k in left.tolist():
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
