"""CVODE of SUNDIALS by scikit-sundae over our compiled accelerations, all called from Python."""

import os
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from sksundae.cvode import CVODE

from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision.library_contenders import ATOL_OF_RTOL
from tensegrity_codegen.studies.work_precision.measure import Contender, Run
from tensegrity_codegen.studies.work_precision.peers.sundials import MAX_DENSE
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.request import ModelRequest

os.environ.setdefault(
    "SUNLOGGER_WARNING_FILENAME", os.devnull
)  # of steps lost in the time, at loose settings
MAX_STEPS = 10_000_000  # between two samples


class Rates:
    """The right-hand side of a structure, and its Jacobian, called from Python at the least cost.

    CVODE's arrays are copied to where the C functions read and write: pointers to arrays cost more.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        is_large, has_contacts = structure.n_members > MAX_DENSE, structure.ground is not None
        jacobian = "tangent_stiffness" if is_large else "state_jacobian"
        wanted = ("acceleration", "internal_rate" if has_contacts else jacobian)
        request = ModelRequest(wanted, formulation="node_position", emitter="auto")
        self.model = build_library(structure, request, flags="native", calls=MANY_CALLS).load()
        self.n = n = len(self.model.manifest.coordinate_name)
        parts = ("coordinate", "velocity", *(("internal",) if has_contacts else ()))
        self.start = np.concatenate([self.model.nominal(name) for name in parts])
        self.x, self.rate = self.start.copy(), np.zeros_like(self.start)
        self.calls = [self._bind("acceleration", self.rate[n : 2 * n])]
        self.solvers = ("gmres", "sparse") if is_large else ("dense", "gmres")
        if has_contacts:  # Jacobians by differences
            self.calls.append(self._bind("internal_rate", self.rate[2 * n :]))
        else:
            self._set_jacobian(jacobian)

    def _bind(self, quantity: str, out: FloatArray) -> Callable[[], int]:
        """Return the C function with its pointers, from the parts of x to `out`."""
        library, function, n = self.model.library, self.model.function(quantity), self.n
        parts = {"coordinate": self.x[:n], "velocity": self.x[n : 2 * n], "internal": self.x[2 * n :]}
        arrays = [parts.get(name, self.model.nominal(name)) for name in function.arguments] + [out]
        pointers = [library.ffi.from_buffer("double[]", array, require_writable=False) for array in arrays]
        return partial(library.symbol(function.spec.symbol), *pointers)

    def _set_jacobian(self, quantity: str) -> None:
        """Bind the Jacobian of the rates: all of it, or the stiffness of a structure without damping."""
        pattern, n, structure = self.model.function(quantity).spec.pattern, self.n, self.structure
        assert pattern is not None
        self.found = np.zeros(len(pattern.row))
        self.find_jacobian = self._bind(quantity, self.found)
        row = np.array(pattern.row, np.int32)
        column = np.repeat(np.arange(pattern.shape[1], dtype=np.int32), np.diff(pattern.column_start))
        self.scale, self.ones = np.ones(len(row)), np.zeros(0)
        if quantity == "tangent_stiffness":
            assert not structure.damping.any()
            assert not structure.member_mass.any()
            node, every = structure.coordinate_node_axis[:, 0], np.arange(n, dtype=np.int32)
            self.scale, self.ones = -1.0 / structure.node_mass[node][row], np.ones(n)
            row, column = np.concatenate([n + row, every]), np.concatenate([column, n + every])
        self.row, self.column = row, column

    def contender(self, times: FloatArray, method: str, solver: str) -> Contender:
        """Return CVODE with a method and a solver of its linear equations."""
        n, x, rate, calls = self.n, self.x, self.rate, self.calls
        speed, into = x[n : 2 * n], rate[:n]
        solvers: dict[float, Any] = {}

        def rates(_: float, y: FloatArray, to: FloatArray) -> None:
            x[:] = y
            into[:] = speed
            for call in calls:
                if call():  # no finite result
                    rate[:] = np.nan
            to[:] = rate

        def jacobian(_: float, y: FloatArray, __: FloatArray, to: FloatArray) -> None:
            x[:] = y
            self.find_jacobian()
            values = np.concatenate([self.found * self.scale, self.ones])
            if solver == "sparse":
                to[:] = values
            else:
                to[self.row, self.column] = values

        options: dict[str, Any] = {"linsolver": solver, "method": method, "max_num_steps": MAX_STEPS}
        if solver == "sparse" or ("dense" in solver and len(self.calls) == 1):
            options |= {"jacfn": jacobian}
        if solver == "sparse":
            shape = (len(x), len(x))
            options |= {"sparsity": csc_array((np.ones(len(self.row)), (self.row, self.column)), shape=shape)}
        node, axis = self.structure.coordinate_node_axis.T

        def prepare(rtol: float) -> None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that a sparse Jacobian by differences would be another one
                solvers[rtol] = CVODE(rates, rtol=rtol, atol=ATOL_OF_RTOL * rtol, **options)

        def run(rtol: float) -> Callable[[], Run]:
            try:
                found = solvers[rtol].solve(times, self.start)
            except RuntimeError as error:
                return partial(Run, np.zeros((0, 0, 3)), "failed", str(error), 0, 0)
            position = np.tile(self.structure.node_position, (len(found.y), 1, 1))
            position[:, node, axis] = found.y[:, :n]
            return partial(Run, position, "ok" if found.success else "failed", found.message, 0, found.nfev)

        name = f"CVODE {method}, {solver}"
        return Contender(name, "peer", "node_position", method, "tolerance", (), run, prepare)
