"""Equilibria by the solver in the generated C: one call for one of them, or for a whole path of loads.

For small models under time constraints; `find_equilibrium` and `follow_path` take more care and tell more.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arguments import merge_inputs
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.interface import require_double
from tensegrity_codegen.runtime.model.library import raise_for_status
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    UnknownNameError,
    UnstableError,
    suggest,
)
from tensegrity_codegen.tables.manifest import SOLVER_STATUS, STATUS, SolverSpec
from tensegrity_codegen.tables.quantities import ARGUMENTS

WORDS = (*STATUS, *SOLVER_STATUS)
HINTS = {
    "not_converged": "start nearer to the equilibrium, allow more iterations, or loosen the tolerance",
    "unstable": "start elsewhere; a structure without anchors has no strict minimum",
    "branch_lost": "follow_path finds out whether there is a limit point or a bifurcation",
    "non_finite_result": "look for coincident nodes, or a bar at the pole of its angles",
}
REPORT = np.dtype(
    [
        ("status", np.intc),
        ("iterations", np.intc),
        ("shifted", np.intc),
        ("contraction", np.float64),
        ("residual", np.float64),
        ("smallest_pivot", np.float64),
        ("potential_energy", np.float64),
    ],
    align=True,
)


@dataclass(frozen=True)
class SolvedPath:
    """Equilibria in the order of their loads, as far as there are any."""

    status: str  # "ok", "not_converged", "unstable", "branch_lost" (past a limit point), "non_finite_result"
    coordinate: FloatArray  # (n_found, n_coordinates)
    iterations: IntArray  # (n_found,) steps of Newton's method
    residual: FloatArray  # (n_found,) largest entry of the static force
    smallest_pivot: FloatArray  # (n_found,) of the Hessian's Cholesky factors
    potential_energy: FloatArray  # (n_found,) [J]
    failed: Mapping[str, float]  # iterations, residual, pivot, contraction of the one that failed

    def check(self) -> "SolvedPath":
        """Return the path itself; raise UnstableError or ConvergenceError if it has not all equilibria."""
        if self.status == "ok":
            return self
        kind = UnstableError if self.status == "unstable" else ConvergenceError
        raise kind(
            f"no further equilibrium after {len(self.coordinate)}: {self.status}",
            evidence={"status": self.status, "n_found": len(self.coordinate), **self.failed},
            where="find_equilibrium in C",
            hint=HINTS.get(self.status, ""),
        )


class EquilibriumSolver:
    """The solver in a model's library, if it has one, with its work memory; one for each thread."""

    def __init__(self, model: CompiledModel) -> None:
        require_double(model.manifest, "the search for an equilibrium")
        self.model, self.spec = model, _find_spec(model)
        library = model.library
        self._one = library.symbol(self.spec.symbol)
        self._path = library.symbol(f"{self.spec.symbol}_path") if self.spec.varied else None
        self._doubles = library.ffi.typeof("double[]")
        self._ffi = library.ffi
        self._work = np.empty(self.spec.work_size)
        self._size = len(model.manifest.coordinate_name)

    def find(
        self,
        start: ArrayLike | None = None,
        *,
        tolerance: float = 1e-9,
        most_iterations: int = 50,
        **arguments: ArrayLike,
    ) -> SolvedPath:
        """Return the equilibrium near `start` (n_coordinates,), by default the scene's, as a path of one."""
        coordinate = self._sized("coordinate", start, (self._size,)).copy()
        passed = self._arguments(arguments)
        report = np.zeros(1, dtype=REPORT)
        status = self._one(
            self._pointer(coordinate),
            *map(self._pointer, passed.values()),
            tolerance,
            most_iterations,
            self._reports(report),
            self._pointer(self._work),
        )
        self._refuse(status, {"coordinate": coordinate, **passed}, tolerance, most_iterations)
        return _collect(status, coordinate[None, :], report, int(status == 0))

    def follow(
        self,
        values: ArrayLike,
        start: ArrayLike | None = None,
        *,
        tolerance: float = 1e-9,
        most_iterations: int = 50,
        **arguments: ArrayLike,
    ) -> SolvedPath:
        """Return the equilibria under values (n_path, k, n_axes) of `node_load`, each from the one before."""
        if self._path is None:
            raise FormulationError(
                "a path of equilibria needs loads that may change at run time",
                where=self.model.manifest.name,
                hint='build the model with [parameters] node_load = "all"',
            )
        passed = self._arguments(arguments)
        # The loads of all points, and the start.
        shape = self.model.nominal(self.spec.varied).shape
        varied = np.ascontiguousarray(values, dtype=np.float64)
        if varied.shape[1:] != shape:
            raise InvalidValueError(
                "wrong shape", where=self.spec.varied, given=varied.shape, allowed=f"(n_path, *{shape})"
            )
        passed[self.spec.varied] = varied
        coordinate = self._sized("coordinate", start, (self._size,))
        # One call for the whole path; n_found: points that it reached.
        count = len(varied)
        solution, report = np.empty((count, self._size)), np.zeros(count, dtype=REPORT)
        n_found = self._ffi.new("long long *")
        status = self._path(
            self._pointer(coordinate),
            count,
            *map(self._pointer, passed.values()),
            tolerance,
            most_iterations,
            self._pointer(solution),
            self._reports(report),
            n_found,
            self._pointer(self._work),
        )
        self._refuse(status, {"coordinate": coordinate, **passed}, tolerance, most_iterations)
        return _collect(status, solution, report, int(n_found[0]))

    def _pointer(self, array: FloatArray) -> Any:
        return self._ffi.from_buffer(self._doubles, array)

    def _reports(self, array: NDArray[np.void]) -> Any:
        return self._ffi.from_buffer("equilibrium_report[]", array)

    def _arguments(self, values: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
        values = merge_inputs(self.model.manifest, values)
        for name in values:
            if name not in ARGUMENTS or name == "coordinate":
                valid_names = (*self.spec.arguments, *self.model.manifest.input_name)
                raise UnknownNameError(
                    "unknown argument", where=self.spec.symbol, given=name, hint=suggest(name, valid_names)
                )
        return {
            name: self._sized(name, values.get(name), self.model.nominal(name).shape)
            for name in self.spec.arguments
        }

    def _sized(self, name: str, value: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray:
        return to_sized(self.model.nominal(name) if value is None else value, shape, name)

    def _refuse(
        self, status: int, passed: Mapping[str, FloatArray], tolerance: float, most_iterations: int
    ) -> None:
        """Raise the error of wrong arguments."""
        reason = WORDS[status]
        if reason == "invalid_argument" or not np.isfinite(tolerance):
            raise InvalidValueError(
                "the tolerance or the number of iterations is out of range",
                where=self.spec.symbol,
                given=f"tolerance {tolerance}, most_iterations {most_iterations}",
                allowed="a tolerance > 0 and most_iterations >= 0",
            )
        if reason in ("non_finite_input", "null_pointer"):
            raise_for_status(status, self.spec.symbol, passed)


def _find_spec(model: CompiledModel) -> SolverSpec:
    for spec in model.manifest.solvers:
        if spec.name == "equilibrium":
            return spec
    raise FormulationError(
        "the library has no solver 'equilibrium'",
        where=model.manifest.name,
        allowed='a library that was built with solvers = ["equilibrium"]',
        hint='build it with solvers=("equilibrium",), or use find_equilibrium',
    )


def _collect(status: int, coordinate: FloatArray, report: NDArray[np.void], n_found: int) -> SolvedPath:
    failed: dict[str, float] = {}
    if status:
        row = report[n_found]
        failed = {name: row[name].item() for name in (REPORT.names or ()) if name != "status"}
    good = report[:n_found]
    return SolvedPath(
        status=WORDS[status],
        coordinate=coordinate[:n_found],
        iterations=good["iterations"].astype(np.int64),
        residual=good["residual"].copy(),
        smallest_pivot=good["smallest_pivot"].copy(),
        potential_energy=good["potential_energy"].copy(),
        failed=failed,
    )
