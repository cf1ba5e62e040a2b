"""The operation `equilibrium`: the stable equilibrium of every case, and what is kept of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.at_point import COORDINATE, find_case_equilibria
from tensegrity_codegen.analyses.cases.keep_text import KeptText, label_axis, parse_kept
from tensegrity_codegen.analyses.cases.kept import Kept, bind_kept, find_kept_quantities
from tensegrity_codegen.analyses.cases.quantities import (
    LIMIT_USE,
    LIMIT_USE_RESULT,
    CaseArguments,
    Outcomes,
    compute_limit_use,
    compute_values,
)
from tensegrity_codegen.analyses.cases.record import AnalysisRecord, Option, Output
from tensegrity_codegen.pipeline.analyses import Needs, find_needs, with_snap_check
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.find_equilibrium import judge_snap
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.equilibrium import check_search_options, find_equilibrium
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.static_methods import Method

DEFAULT_RESULTS = (
    *("node_position", "member_tension", "smallest_eigenvalue", "displacement", "change", "residual"),
    LIMIT_USE,
)
# Results of each search besides quantities: type, unit, sentence.
RESULTS = {
    "smallest_eigenvalue": (
        "float64",
        "N/m",
        "Smallest eigenvalue of the stiffness off neutral motions.",
    ),
    "displacement": ("float64", "m", "Largest distance of a node from its start."),
    "change": ("float64", "m", "Largest distance of a node from its start, neutral motions taken out."),
    "residual": ("float64", "N", "Largest static force on a node."),
    "largest_force": ("float64", "N", "Largest member force."),
    "energy": ("float64", "J", "Potential energy."),
    "energy_change": ("float64", "J", "Change of the potential energy from the start."),
    "iterations": ("int64", "1", "Number of iterations."),
    "extent": ("float64", "m", "Longest side of a box around the start."),
    "is_start_unstable": ("int64", "1", "1 where the start was an unstable equilibrium."),
    "neutral_motions": ("int64", "1", "Number of rigid motions that cost no energy."),
    LIMIT_USE: LIMIT_USE_RESULT,
    "saddles_left": ("int64", "1", "Number of unstable equilibria that the search passed."),
}
# Results of the check for snapping, which takes ten times as long as a search.
SNAP_RESULTS = {
    "snapped": (
        "float64",
        "1",
        "1 where the equilibrium was reached by a jump as loads grew from zero, 0 where not; NAN if unknown.",
    ),
    "limit_load_factor": ("float64", "1", "Part of the loads up to which the path is stable; NAN: all."),
    "limit_prestress_factor": ("float64", "1", "The same of the prestress; NAN: all."),
}
RESULTS |= SNAP_RESULTS
NOT_CHECKED = "whether cases snapped is not checked: keep snapped (ten times as long as the search)"
# Quantities that every search returns, so that they are not computed again.
SEARCH_QUANTITIES = (POSITION, "member_tension", "member_length")


@dataclass(frozen=True)
class FindEquilibrium(AnalysisRecord):
    """Stable equilibria, from the start of each case.

    keep: expressions over quantities at the equilibrium, names of RESULTS, ``"coordinate"``; by default
    DEFAULT_RESULTS; tolerance, max_iterations, method: as of `find_equilibrium`.
    """

    name: ClassVar[str] = "equilibrium"
    success_phrase: ClassVar[str] = "converged"

    tolerance: Annotated[float, Option("largest node residual, part of the largest member force.")] = 1e-9
    max_iterations: Annotated[int, Option("most iterations of a search.", in_verb=False)] = 500
    method: Annotated[Method, Option("method, as in the verb of this name.")] = "auto"

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return what the search needs, and the quantities that are kept."""
        check_search_options(self.tolerance, self.max_iterations, self.method)
        kept_quantities = find_kept_quantities(_without_own_results(self._parse_keep()), request)
        needs = find_needs("equilibria", structure, request)
        if self._keeps_snap:
            needs = with_snap_check(structure, request, needs)
        missing = tuple(name for name in kept_quantities if name not in needs.quantities)
        return replace(needs, quantities=(*needs.quantities, *missing))

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept."""
        bound = _bind_quantities(self._parse_keep(), manifest)
        return tuple(
            bound[kept_text.name].output if kept_text.name in bound else _describe_result(kept_text, manifest)
            for kept_text in self._parse_keep()
        )

    @property
    def _keeps_snap(self) -> bool:
        return any(kept_text.expression in SNAP_RESULTS for kept_text in self._parse_keep())

    @property
    def not_checked(self) -> str:
        """That nobody asked whether cases snapped."""
        return "" if self._keeps_snap else NOT_CHECKED

    def _parse_keep(self) -> tuple[KeptText, ...]:
        return parse_kept(self.keep or DEFAULT_RESULTS, (*RESULTS, COORDINATE))

    def compute(
        self, model: CompiledModel, case_arguments: CaseArguments, outcomes: Outcomes, threads: int
    ) -> Mapping[str, NDArray[Any]]:
        """Find the equilibria; a case without one has the status that `find_equilibrium` gives it."""
        count = case_arguments.count
        equilibria = find_case_equilibria(model, case_arguments, threads, **self.options)
        outcomes.mark_ok(equilibria.status, equilibria.message)
        snap = _judge_snaps(model, equilibria, case_arguments) if self._keeps_snap else {}
        bound = _bind_quantities(self._parse_keep(), model.manifest)
        names = dict.fromkeys(name for item in bound.values() for name in item.names)
        values = _compute_quantities(model, equilibria, case_arguments, tuple(names), threads)
        return {
            kept_text.name: bound[kept_text.name].evaluate(values, (count,))
            if kept_text.name in bound
            else compute_limit_use(
                model, case_arguments, slice(count), equilibria.member_tension, equilibria.member_length
            )
            if kept_text.expression == LIMIT_USE
            else snap[kept_text.expression]
            if kept_text.expression in snap
            else getattr(equilibria, kept_text.expression)
            for kept_text in self._parse_keep()
        }


def _judge_snaps(
    model: CompiledModel, equilibria: Equilibria, case_arguments: CaseArguments
) -> dict[str, NDArray[Any]]:
    """Return SNAP_RESULTS of every case, the start of which is its given shape."""
    found = {name: np.full(case_arguments.count, np.nan) for name in SNAP_RESULTS}
    for k in np.flatnonzero(equilibria.is_found).tolist():
        own = {**case_arguments.shared, **{name: array[k] for name, array in case_arguments.rows.items()}}
        own.pop("velocity", None)
        start = own.pop(COORDINATE, None)
        alone = find_equilibrium(model, coordinate=equilibria.coordinate[k], arguments=own)
        snap = judge_snap(model, alone, coordinate=start, arguments=own, base=own.get("node_load"))
        for name, array in found.items():
            value = getattr(snap, name)
            array[k] = np.nan if value is None else value
    return found


def _without_own_results(kept_texts: tuple[KeptText, ...]) -> tuple[KeptText, ...]:
    """Return what is kept besides RESULTS and coordinates: expressions over quantities."""
    return tuple(kept_text for kept_text in kept_texts if kept_text.expression not in (*RESULTS, COORDINATE))


def _bind_quantities(kept_texts: tuple[KeptText, ...], manifest: Manifest) -> dict[str, Kept]:
    """Return the kept expressions over quantities, bound to a library, by the names of their arrays."""
    return {kept.text.name: kept for kept in bind_kept(_without_own_results(kept_texts), manifest)}


def _describe_result(kept_text: KeptText, manifest: Manifest) -> Output:
    expression = kept_text.text_beside_name
    if kept_text.expression in RESULTS:
        return Output(kept_text.name, (), (), *RESULTS[kept_text.expression], expression=expression)
    dim, names = label_axis(manifest, "n_coordinates", COORDINATE)
    sentence = "Free coordinates."
    return Output(kept_text.name, (dim,), (len(names),), "float64", "m", sentence, {dim: names}, expression)


def _compute_quantities(
    model: CompiledModel,
    equilibria: Equilibria,
    case_arguments: CaseArguments,
    names: tuple[str, ...],
    threads: int,
) -> dict[str, NDArray[Any]]:
    """Return the quantities `names` at the equilibria, at rest, (count, ...) each."""
    computed_names = [name for name in names if name not in SEARCH_QUANTITIES]
    rows = {
        **case_arguments.rows,
        COORDINATE: equilibria.coordinate,
        "velocity": np.zeros_like(equilibria.coordinate),
    }
    rows |= {} if equilibria.internal is None else {"internal": equilibria.internal}
    computed = compute_values(model, computed_names, replace(case_arguments, rows=rows), threads)
    values = {name: value for name, (value, _) in computed.items()}
    return values | {name: getattr(equilibria, name) for name in names if name in SEARCH_QUANTITIES}


ANALYSIS = FindEquilibrium
