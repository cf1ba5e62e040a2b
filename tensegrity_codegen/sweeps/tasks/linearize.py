"""The operation `linearize`: the linear model of every case, its frequencies and damping ratios."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import BATCH_WIDTH, Needs, find_needs
from tensegrity_codegen.runtime.linear.linearize import LinearModel
from tensegrity_codegen.runtime.linear.linearize import linearize as linearize_one
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.require import require_double
from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.statuses import encode_status
from tensegrity_codegen.sweeps.tasks.case_arguments import CaseArguments, read_case_arguments
from tensegrity_codegen.sweeps.tasks.equilibrium import find_each
from tensegrity_codegen.sweeps.tasks.operation import Operation, Output, TaskResult, build_result
from tensegrity_codegen.system.errors import DuplicateNameError, NonFiniteError, TensegrityError, check_choice
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest

USUAL = ("natural_frequency", "damping_ratio", "A", "B")
RESULTS = (*USUAL, "residual_rate", "zero_eigenvalues", "growing_eigenvalues")
POINTS = ("start", "equilibrium")
SETTLED = 1e-12  # tolerance of equilibria: what is left of the forces turns neutral motions into slow ones


@dataclass(frozen=True)
class Linearize(Operation):
    """Linear models x' = A (x - x0) + B (u - u0) + r of every case.

    Attributes
    ----------
    keep : tuple of str
        Names of RESULTS; by default USUAL.
    about : str
        ``"start"``: about the state of the case; ``"equilibrium"``: about the stable equilibrium that is
        found from there, at rest.
    """

    name: ClassVar[str] = "linearize"

    about: str = "start"

    def describe(self) -> dict[str, Any]:
        """Return name and options, JSON-ready."""
        return {**super().describe(), "about": self.about}

    def _kept(self) -> tuple[str, ...]:
        for name in self.keep:
            check_choice(name, RESULTS, "result of a linear model", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))
        check_choice(self.about, POINTS, "point to linearize about", "about")
        return self.keep or USUAL

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what linear models need, and equilibria where they are about these."""
        self._kept()
        needs = find_needs("linearize", structure, request)
        if self.about == "equilibrium":
            more = find_needs("equilibria", structure, request)
            needs = replace(needs, quantities=tuple(dict.fromkeys((*needs.quantities, *more.quantities))))
        return replace(needs, batch_width=BATCH_WIDTH)

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept; frequencies are NAN behind the last oscillation."""
        states, inputs = name_states(manifest), manifest.input_name
        modes = len(states) // 2
        known = {
            "natural_frequency": (("mode",), (modes,), "float64", "Hz", "Undamped natural frequencies."),
            "damping_ratio": (("mode",), (modes,), "float64", "1", "Damping ratios of these modes."),
            "A": (("state", "state_column"), (len(states),) * 2, "float64", "", "Jacobian dx'/dx."),
            "B": (("state", "input"), (len(states), len(inputs)), "float64", "", "Jacobian dx'/du."),
            "residual_rate": (("state",), (len(states),), "float64", "", "State derivative at the point."),
            "zero_eigenvalues": ((), (), "int64", "1", "Eigenvalues that are zero to rounding."),
            "growing_eigenvalues": ((), (), "int64", "1", "Eigenvalues with a positive real part."),
        }
        labels = {"state": states, "state_column": states, "input": inputs}
        kept = [name for name in self._kept() if inputs or name != "B" or "B" in self.keep]
        return tuple(
            Output(name, *known[name], {dim: labels[dim] for dim in known[name][0] if dim in labels})
            for name in kept
        )

    def run(
        self, model: CompiledModel, arguments: Mapping[str, Any], count: int, *, threads: int = 1
    ) -> TaskResult:
        """Compute the linear models; a case whose derivatives are not finite has "non_finite_result"."""
        require_double(model.manifest, "linearization")
        given = read_case_arguments(model, arguments, count)
        status, messages = given.status()
        rows = dict(given.rows)
        if self.about == "equilibrium":
            self._settle(model, given, rows, status, messages, threads)
        outputs = self.outputs(model.manifest)
        arrays = {output.name: output.full_of_nan(count) for output in outputs}
        for k in np.flatnonzero(status == encode_status("ok")):
            own = {**given.shared, **{name: array[k] for name, array in rows.items()}}
            start = {name: own.pop(name, None) for name in ("coordinate", "velocity")}
            try:
                linear = linearize_one(
                    model, coordinate=start["coordinate"], velocity=start["velocity"], arguments=own
                )
            except (NonFiniteError, np.linalg.LinAlgError) as error:
                status[k] = encode_status("non_finite_result")
                messages[k] = error.problem if isinstance(error, TensegrityError) else str(error)
                continue
            for name, array in arrays.items():
                array[k] = _read(linear, name, array[k])
        return build_result(arrays, status, messages)

    @staticmethod
    def _settle(
        model: CompiledModel,
        given: CaseArguments,
        rows: dict[str, NDArray[Any]],
        status: NDArray[np.int8],
        messages: list[str],
        threads: int,
    ) -> None:
        """Put equilibria at rest into the rows; cases without one get its status and message."""
        found = find_each(model, given, threads, tolerance=SETTLED)
        rows["coordinate"], rows["velocity"] = found.coordinate, np.zeros_like(found.coordinate)
        for k in np.flatnonzero((status == encode_status("ok")) & ~found.is_found):
            status[k], messages[k] = encode_status(found.status[k]), found.message[k]


def _read(linear: LinearModel, name: str, empty: NDArray[Any]) -> Any:
    """Return one result of a linear model; behind the last oscillation frequencies stay `empty`."""
    if name in ("natural_frequency", "damping_ratio"):
        found = getattr(linear, name)
        return np.concatenate([found, empty[len(found) :]])
    if name in ("A", "B"):
        return getattr(linear, name).toarray()
    if name == "residual_rate":
        return linear.residual_rate
    spectrum = linear.spectrum
    return spectrum.growing if name == "growing_eigenvalues" else spectrum.zero_eigenvalues
