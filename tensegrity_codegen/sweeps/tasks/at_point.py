"""Base class of operations that analyse each case at one point, its state or the equilibrium from there."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import BATCH_WIDTH, Needs, find_needs
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.require import require_double
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.tasks.case_arguments import CaseArguments, Outcomes
from tensegrity_codegen.sweeps.tasks.operation import Operation, Option
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    NonFiniteError,
    TensegrityError,
    check_choice,
)
from tensegrity_codegen.tables.request import ModelRequest

COORDINATE = "coordinate"
POINTS = ("start", "equilibrium")
POINT_TOLERANCE = 1e-12  # of equilibria: what is left of the forces turns neutral motions into slow ones
Point = tuple[NDArray[Any] | None, NDArray[Any] | None]  # coordinates and velocities, None: of the scene
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class AtPoint(Operation):
    """An analysis of each case at one point.

    Attributes
    ----------
    about : str
        ``"start"``: at the state of the case; ``"equilibrium"``: at the stable equilibrium that is found from
        there, at rest.
    """

    analysis: ClassVar[str]  # whose needs the library has to serve, as of `find_needs`
    result_names: ClassVar[tuple[str, ...]]  # names of all results
    default_results: ClassVar[tuple[str, ...]]  # those that are kept by default

    about: Annotated[
        str, Option("about the equilibrium of each case, not its state.", flag=("settle", "equilibrium"))
    ] = "start"

    @abstractmethod
    def compute_case(
        self,
        model: CompiledModel,
        point: Point,
        arguments: Mapping[str, Any],
        empty: Mapping[str, NDArray[Any]],
    ) -> Mapping[str, Any]:
        """Return what is kept of one case, by name; empty: arrays of NaN of the shapes of the results."""

    def list_kept(self) -> tuple[str, ...]:
        """Return the names of what is kept; raises UnknownNameError or DuplicateNameError."""
        for name in self.keep:
            check_choice(name, self.result_names, f"result of {self.name}", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))
        check_choice(self.about, POINTS, "point", "about")
        return self.keep or self.default_results

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what the analysis needs, and equilibria where it is about these."""
        self.list_kept()
        needs = find_needs(self.analysis, structure, request)
        if self.about == "equilibrium":
            more = find_needs("equilibria", structure, request)
            needs = replace(needs, quantities=tuple(dict.fromkeys((*needs.quantities, *more.quantities))))
        return replace(needs, batch_width=BATCH_WIDTH)

    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Analyse case by case; a case whose numbers are not finite has the status "non_finite_result"."""
        require_double(model.manifest, self.name)
        rows = dict(case_arguments.rows)
        if self.about == "equilibrium":
            found = find_case_equilibria(model, case_arguments, threads, tolerance=POINT_TOLERANCE)
            rows |= {COORDINATE: found.coordinate, "velocity": np.zeros_like(found.coordinate)}
            for k in np.flatnonzero(outcomes.is_ok & ~found.is_found).tolist():
                outcomes.mark(k, found.status[k], found.message[k])
        arrays = {
            output.name: output.full_of_nan(case_arguments.count) for output in self.outputs(model.manifest)
        }
        for k in np.flatnonzero(outcomes.is_ok).tolist():
            own = {**case_arguments.shared, **{name: array[k] for name, array in rows.items()}}
            point = own.pop(COORDINATE, None), own.pop("velocity", None)
            empty = {name: array[k] for name, array in arrays.items()}
            try:
                kept = self.compute_case(model, point, own, empty)
            except (NonFiniteError, ConvergenceError, np.linalg.LinAlgError) as error:
                status = "not_converged" if isinstance(error, ConvergenceError) else "non_finite_result"
                message = error.problem if isinstance(error, TensegrityError) else str(error)
                outcomes.mark(k, status, message)
                continue
            for name, array in arrays.items():
                array[k] = kept[name]
        return arrays


def find_case_equilibria(
    model: CompiledModel, case_arguments: CaseArguments, threads: int, **options: Any
) -> Equilibria:
    """Return the equilibria of cases; options: as of `find_equilibria`."""
    require_double(model.manifest, "the search for an equilibrium")
    start = case_arguments.all.get(COORDINATE, model.nominal(COORDINATE))
    if start.ndim == 1:
        start = np.tile(start, (case_arguments.count, 1))
    others = {
        name: array for name, array in case_arguments.all.items() if name not in (COORDINATE, "velocity")
    }
    return find_equilibria(model, coordinate=start, arguments=others, threads=threads, **options)
