"""Base class of operations that analyse each case at one point, its state or the equilibrium from there."""

from abc import abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import COORDINATE, CaseAnalysis, Option, Output, SceneAnalysis
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    NonFiniteError,
    TensegrityError,
    check_choice,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest

POINTS = ("start", "equilibrium")
NOT_CHECKED = "whether cases snapped is not checked: sweep --do equilibrium --keep snapped tells"
Point = tuple[Any, Any]  # coordinates and velocities, arrays; None: of the scene
ResultColumn = tuple[tuple[str, ...], str, str, str]  # axes, type, unit, sentence


@dataclass(frozen=True)
class AtPoint(SceneAnalysis, CaseAnalysis):
    """An analysis of each case at one point.

    about: ``"start"``: at the state of the case; ``"equilibrium"``: at the stable equilibrium that is found
    from there, at rest.
    """

    analysis: ClassVar[str]  # the name of the needs in `find_needs`
    results: ClassVar[Mapping[str, ResultColumn]]  # all results by name
    default_results: ClassVar[tuple[str, ...]]  # names of those that are kept by default

    about: Annotated[
        str, Option("about the equilibrium of each case, not its state.", flag=("settle", "equilibrium"))
    ] = "start"

    @property
    def settles(self) -> bool:
        """Whether the analysis begins with the search for the equilibrium."""
        return self.about == "equilibrium"

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the functions that the library must serve, that of the search among them."""
        return (self.analysis, *(["equilibria"] if self.settles else []))

    @property
    def not_checked(self) -> str:
        """That rows do not say whether cases snapped on the way to the equilibrium."""
        return NOT_CHECKED if self.settles else ""

    @abstractmethod
    def compute_case(
        self,
        model: "CompiledModel",
        point: Point,
        arguments: Mapping[str, Any],
        names: Collection[str],
    ) -> Mapping[str, Any]:
        """Return results of one case by these names; those of fewer modes than coordinates are shorter."""

    def list_kept(self) -> tuple[str, ...]:
        """Return the names of the stored results; raises UnknownNameError or DuplicateNameError."""
        self.check_keep(self.results)
        check_choice(self.about, POINTS, "point", "about")
        return self.keep or self.default_results

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays, NAN behind the last mode."""
        from tensegrity_codegen.runtime.model.interface import name_states

        states = name_states(manifest)
        labels = {"member": manifest.member_name, "input": manifest.input_name}
        labels |= {"state": states, "state_column": states}
        sizes = {dim: len(names) for dim, names in labels.items()} | {"mode": len(states) // 2}
        outputs = []
        for name in self.list_kept():
            dims, dtype, unit, sentence = self.results[name]
            shape = tuple(sizes[dim] for dim in dims)
            coordinates = {dim: labels[dim] for dim in dims if dim in labels}
            outputs.append(Output(name, dims, shape, dtype, unit, sentence, coordinates))
        return tuple(outputs)

    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the functions of the analysis, and those of the search with `about` "equilibrium"."""
        from tensegrity_codegen.pipeline.analyses import find_needs

        self.list_kept()
        needs = find_needs(self.analysis, structure, request)
        if self.settles:
            search_needs = find_needs("equilibria", structure, request)
            quantities = tuple(dict.fromkeys((*needs.quantities, *search_needs.quantities)))
            needs = replace(needs, quantities=quantities, batch_width=search_needs.batch_width)
        return needs

    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Analyse case by case; a case whose numbers are not finite has the status "non_finite_result"."""
        import numpy as np

        from tensegrity_codegen.analyses.cases.case_equilibria import find_case_equilibria
        from tensegrity_codegen.runtime.model.interface import require_double
        from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance

        require_double(model.manifest, self.name)
        rows = dict(case_arguments.rows)
        if self.settles:
            # Residual forces would turn neutral motions into slow ones.
            tolerance = choose_tolerance(model.structure)
            equilibria = find_case_equilibria(model, case_arguments, threads, tolerance=tolerance)
            rows |= {COORDINATE: equilibria.coordinate, "velocity": np.zeros_like(equilibria.coordinate)}
            rows |= {} if equilibria.internal is None else {"internal": equilibria.internal}
            for k in np.flatnonzero(outcomes.is_ok & ~equilibria.is_found).tolist():
                outcomes.mark(k, equilibria.status[k], equilibria.message[k])
        arrays = {
            output.name: output.full_of_nan(case_arguments.count) for output in self.outputs(model.manifest)
        }
        for k in np.flatnonzero(outcomes.is_ok).tolist():
            arguments = replace(case_arguments, rows=rows).select_case(k)
            point = arguments.pop(COORDINATE, None), arguments.pop("velocity", None)
            try:
                results = self.compute_case(model, point, arguments, arrays.keys())
            except (NonFiniteError, ConvergenceError, np.linalg.LinAlgError) as error:
                status = "not_converged" if isinstance(error, ConvergenceError) else "non_finite_result"
                message = error.problem if isinstance(error, TensegrityError) else str(error)
                outcomes.mark(k, status, message)
                continue
            for name, array in arrays.items():
                value = np.asarray(results[name])
                index: tuple[Any, ...] = (k, *map(slice, value.shape))
                array[index] = value
        return arrays
