"""Base class of operations that analyse each case at one point, its state or the equilibrium from there."""

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
from tensegrity_codegen.analyses.cases.record import AnalysisRecord, Option, Output
from tensegrity_codegen.pipeline.analyses import Needs, find_needs
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.require import require_double
from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    NonFiniteError,
    TensegrityError,
    check_choice,
)
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest

COORDINATE = "coordinate"
POINTS = ("start", "equilibrium")
Point = tuple[NDArray[Any] | None, NDArray[Any] | None]  # coordinates and velocities, None: of the scene
Result = tuple[tuple[str, ...], str, str, str]  # axes, type, unit, sentence


@dataclass(frozen=True)
class AtPoint(AnalysisRecord):
    """An analysis of each case at one point.

    about: ``"start"``: at the state of the case; ``"equilibrium"``: at the stable equilibrium that is found
    from there, at rest.
    """

    analysis: ClassVar[str]  # whose needs the library has to serve, as of `find_needs`
    results: ClassVar[Mapping[str, Result]]  # all results by name
    default_results: ClassVar[tuple[str, ...]]  # names of those that are kept by default

    about: Annotated[
        str, Option("about the equilibrium of each case, not its state.", flag=("settle", "equilibrium"))
    ] = "start"

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the analyses that are done, with that of the equilibrium they are about."""
        return (self.analysis, *(["equilibria"] if self.about == "equilibrium" else []))

    @abstractmethod
    def compute_case(
        self,
        model: CompiledModel,
        point: Point,
        arguments: Mapping[str, Any],
        names: Collection[str],
    ) -> Mapping[str, Any]:
        """Return results of one case by these names; those of fewer modes than coordinates are shorter."""

    def list_kept(self) -> tuple[str, ...]:
        """Return the names of what is kept; raises UnknownNameError or DuplicateNameError."""
        for name in self.keep:
            check_choice(name, self.results, f"result of {self.name}", f"keep {name!r}")
        if len(set(self.keep)) < len(self.keep):
            raise DuplicateNameError("kept twice", where="keep", given=", ".join(self.keep))
        check_choice(self.about, POINTS, "point", "about")
        return self.keep or self.default_results

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept, NAN behind the last mode."""
        states = name_states(manifest)
        labels = {"member": manifest.member_name, "input": manifest.input_name}
        labels |= {"state": states, "state_column": states}
        sizes = {dim: len(names) for dim, names in labels.items()} | {"mode": len(states) // 2}
        found = []
        for name in self.list_kept():
            dims, dtype, unit, sentence = self.results[name]
            shape = tuple(sizes[dim] for dim in dims)
            own = {dim: labels[dim] for dim in dims if dim in labels}
            found.append(Output(name, dims, shape, dtype, unit, sentence, own))
        return tuple(found)

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what the analysis needs, and equilibria where it is about these."""
        self.list_kept()
        needs = find_needs(self.analysis, structure, request)
        if self.about == "equilibrium":
            more = find_needs("equilibria", structure, request)
            quantities = tuple(dict.fromkeys((*needs.quantities, *more.quantities)))
            needs = replace(needs, quantities=quantities, batch_width=more.batch_width)
        return needs

    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Analyse case by case; a case whose numbers are not finite has the status "non_finite_result"."""
        require_double(model.manifest, self.name)
        rows = dict(case_arguments.rows)
        if self.about == "equilibrium":
            # What is left of the forces turns neutral motions into slow ones.
            tolerance = choose_tolerance(model.structure)
            found = find_case_equilibria(model, case_arguments, threads, tolerance=tolerance)
            rows |= {COORDINATE: found.coordinate, "velocity": np.zeros_like(found.coordinate)}
            rows |= {} if found.internal is None else {"internal": found.internal}
            for k in np.flatnonzero(outcomes.is_ok & ~found.is_found).tolist():
                outcomes.mark(k, found.status[k], found.message[k])
        arrays = {
            output.name: output.full_of_nan(case_arguments.count) for output in self.outputs(model.manifest)
        }
        for k in np.flatnonzero(outcomes.is_ok).tolist():
            own = {**case_arguments.shared, **{name: array[k] for name, array in rows.items()}}
            point = own.pop(COORDINATE, None), own.pop("velocity", None)
            try:
                kept = self.compute_case(model, point, own, arrays.keys())
            except (NonFiniteError, ConvergenceError, np.linalg.LinAlgError) as error:
                status = "not_converged" if isinstance(error, ConvergenceError) else "non_finite_result"
                message = error.problem if isinstance(error, TensegrityError) else str(error)
                outcomes.mark(k, status, message)
                continue
            for name, array in arrays.items():
                value = np.asarray(kept[name])
                place: tuple[Any, ...] = (k, *map(slice, value.shape))
                array[place] = value
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
