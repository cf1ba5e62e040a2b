"""The analysis `equilibrium`: the stable equilibrium of a scene or of many cases, and its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import (
    COORDINATE,
    LIMIT_USE,
    LIMIT_USE_RESULT,
    CaseAnalysis,
    Option,
    Output,
    Result,
    ResultFile,
    SceneAnalysis,
)
from tensegrity_codegen.system.errors import ConvergenceError
from tensegrity_codegen.tables.static_methods import Method

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.keep_text import KeptText
    from tensegrity_codegen.analyses.cases.kept import Kept
    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest

POSITION = "node_position"

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
class FindEquilibrium(SceneAnalysis, CaseAnalysis):
    """Find the stable equilibrium of a scene, and report how far the nodes moved.

    On the ground weights and loads grow from zero, and friction holds feet from where they first touch.
    Exit code 3 if nothing is found, as where the structure slides or tips, and with --strict if members
    exceed limits or buckle.

    --out may name the scene itself: with --overwrite the settled structure replaces it. The written rest
    lengths contain the values of --input; forces of inputs and loads of --load are not written.

    Example: tensegrity-codegen equilibrium prism.toml --load t1=0,0,-10 --json
    """

    name: ClassVar[str] = "equilibrium"
    success_phrase: ClassVar[str] = "converged"
    verb_order: ClassVar[int] = 110
    takes: ClassVar[tuple[str, ...]] = ("load", "input", "strict")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".toml",), "Write the settled structure as a scene file.", may_be_scene=True),
        ResultFile("page", (".html",), "Write a page of the equilibrium (.html).", draws=True),
    )

    tolerance: Annotated[float, Option("largest node residual, part of the largest member force.")] = 1e-9
    max_iterations: Annotated[int, Option("most iterations of a search.", in_verb=False)] = 500
    method: Annotated[Method, Option("method: auto, newton or relaxation.")] = "auto"
    frictionless: Annotated[
        bool, Option("on the ground: without friction, whatever the scene says.", in_sweep=False)
    ] = False

    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the functions of the search, and the quantities that `keep` requests."""
        from tensegrity_codegen.analyses.cases.kept import find_kept_quantities
        from tensegrity_codegen.pipeline.analyses import find_needs, with_snap_check
        from tensegrity_codegen.runtime.statics.equilibrium import check_search_options

        check_search_options(self.tolerance, self.max_iterations, self.method)
        kept_quantities = find_kept_quantities(_without_own_results(self._parse_keep()), request)
        needs = find_needs("equilibria", structure, request)
        if self._keeps_snap:
            needs = with_snap_check(structure, request, needs)
        missing = tuple(name for name in kept_quantities if name not in needs.quantities)
        return replace(needs, quantities=(*needs.quantities, *missing))

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays."""
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
        """That snapping is not checked, unless `keep` requests it."""
        return "" if self._keeps_snap else NOT_CHECKED

    def _parse_keep(self) -> "tuple[KeptText, ...]":
        from tensegrity_codegen.analyses.cases.keep_text import parse_kept

        return parse_kept(self.keep or DEFAULT_RESULTS, (*RESULTS, COORDINATE))

    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Find the equilibria; a case without one has the status that `find_equilibrium` gives it."""
        from tensegrity_codegen.analyses.cases.case_equilibria import find_case_equilibria
        from tensegrity_codegen.analyses.cases.quantities import compute_limit_use

        count = case_arguments.count
        equilibria = find_case_equilibria(model, case_arguments, threads, **self.options)
        outcomes.mark_ok(equilibria.status, equilibria.message)
        snap: Mapping[str, Any] = {}
        if self._keeps_snap:
            snap = _judge_snaps(model, equilibria, case_arguments, outcomes)
        bound = _bind_quantities(self._parse_keep(), model.manifest)
        names = dict.fromkeys(name for kept_result in bound.values() for name in kept_result.names)
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

    def solve(self, case: "SceneCase") -> "EquilibriumResult":
        """Return the equilibrium of a scene, checked for snapping and for errors of cables in segments."""
        from tensegrity_codegen.pipeline.segment_error import add_segment_error
        from tensegrity_codegen.pipeline.settle import move_back, move_near_origin
        from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium
        from tensegrity_codegen.system.progress import work_pass

        structure, request = case.subject, case.request
        centred, offset = move_near_origin(structure, request)
        model = case.build_statics(centred)
        with work_pass("checking for snap-through"):
            equilibrium = find_equilibrium(
                model,
                arguments=case.arguments,
                tolerance=self.tolerance,
                method=self.method,
                frictionless=self.frictionless,
                raise_on_failure=False,
            )
        try:
            equilibrium = add_segment_error(equilibrium, request, compiler=case.compiler)
        except ConvergenceError as error:
            case.warn(f"the discretisation error of cables in segments is unknown: {error.problem}")
        equilibrium = move_back(equilibrium, structure, offset, case.added_load, case.inputs)
        return EquilibriumResult(equilibrium, case)


@dataclass(frozen=True, eq=False)
class SearchResult(Result):
    """An answer that depends on the search for the equilibrium of a scene."""

    equilibrium: "Equilibrium"

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the search."""
        return self.equilibrium.warnings

    @property
    def is_good(self) -> bool:
        """Whether an equilibrium was found."""
        return self.equilibrium.is_found


@dataclass(frozen=True, eq=False)
class EquilibriumResult(SearchResult):
    """The equilibrium of a scene."""

    case: "SceneCase"

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle, or the structure snapped on the way."""
        return self.has_snapped or self.has_flaws

    @property
    def has_flaws(self) -> bool:
        """Whether members exceed limits or buckle."""
        members = self.equilibrium.members
        return members is not None and members.is_beyond

    @property
    def has_snapped(self) -> bool:
        """Whether the path of increasing loads ends before this equilibrium."""
        return self.equilibrium.snap is not None and bool(self.equilibrium.snap.snapped)

    @property
    def verdict(self) -> str:
        """What is wrong with the equilibrium, "" if nothing is."""
        return "snapped; " * self.has_snapped + "exceeds limits; " * self.has_flaws

    @property
    def actuated(self) -> "Subject":
        """The structure with the rest lengths that inputs and slip through rings leave."""
        from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
        from tensegrity_codegen.structure.sliding import slip_rest_lengths

        subject = self.case.subject
        rest_length = add_inputs_to_rest_length(subject, self.case.inputs)
        rest_length = slip_rest_lengths(subject.sliding, rest_length, self.equilibrium.slid)
        return subject.with_changes(rest_length=rest_length)

    def as_dict(self) -> dict[str, Any]:
        """Return the equilibrium, nodes and members by name."""
        equilibrium = self.equilibrium
        nodes, members = equilibrium.node_name, equilibrium.member_name
        bodies = [body.name for body in getattr(self.case.subject, "bodies", ())]
        places = {"body_position": equilibrium.body_position, "body_axes": equilibrium.body_axes}
        placed = {
            key: dict(zip(bodies, values.tolist(), strict=True))
            for key, values in places.items()
            if values is not None
        }
        checks = equilibrium.members
        return {
            **equilibrium.as_evidence(),
            "limits": None if checks is None else checks.as_dict(members),
            "node_position": dict(zip(nodes, equilibrium.node_position.tolist(), strict=True)),
            **placed,
            "member_length": dict(zip(members, equilibrium.member_length.tolist(), strict=True)),
            "member_tension": dict(zip(members, equilibrium.member_tension.tolist(), strict=True)),
            "held_load": self.case.held_load,
            "inputs": dict(self.case.inputs),
        }

    def describe(self) -> list[Any]:
        """Return status, nodes, members, residual and motion."""
        from tensegrity_codegen.report.tables import feet_table, members_table, nodes_table, segments_table
        from tensegrity_codegen.runtime.contacts.rest_memory import describe_plastic, describe_slip
        from tensegrity_codegen.structure.bodies import BodySystem
        from tensegrity_codegen.structure.member_limits import describe_tensions, summarise_tensions
        from tensegrity_codegen.structure.outline import outline_tendons

        equilibrium, structure = self.equilibrium, self.actuated
        drawn, members = outline_tendons(structure), equilibrium.members
        tables = [
            nodes_table(drawn, equilibrium.node_position),
            members_table(drawn, equilibrium.member_length, equilibrium.member_tension, members),
        ]
        if equilibrium.feet is not None:
            feet = equilibrium.feet
            table = feet_table(structure.name, feet.node_name, feet.force, feet.state, feet.penetration)
            tables.insert(0, table)
        if equilibrium.segments:
            tables.append(segments_table(structure.name, equilibrium.segments))
        tensions = describe_tensions(summarise_tensions(structure, equilibrium.member_tension))
        sentences = [equilibrium.message] if equilibrium.message else []
        sentences += [tensions] if equilibrium.is_found else []
        flaws = [] if members is None else members.describe()
        unit = "in the units of the coordinates" if isinstance(structure, BodySystem) else "N/m"
        return [
            f"{self.verdict}{equilibrium.status}: {'; but '.join(['; '.join(sentences), *flaws])}",
            *(tables if equilibrium.is_found else []),  # else those of no equilibrium would hide the reason
            *describe_plastic(equilibrium.plastic_elongation),
            *describe_slip(equilibrium.slid),
            f"largest residual {equilibrium.residual:.3g} N of largest member force "
            f"{equilibrium.largest_force:.6g} N; "
            f"smallest eigenvalue {equilibrium.smallest_eigenvalue:.6g} {unit}",
            *(describe_displacement(equilibrium) if equilibrium.is_found else []),
        ]

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the settled structure, at rest, as a scene file, or a page, if an equilibrium was found."""
        from tensegrity_codegen.scene.describe import describe_subject
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.structure.bodies import BodySystem

        equilibrium, structure = self.equilibrium, self.actuated
        if not equilibrium.is_found:
            return False
        if name == "page":
            self._write_page(path, overwrite)
            return True
        if isinstance(structure, BodySystem):
            at_rest = {"coordinate": equilibrium.coordinate, "velocity": 0 * structure.velocity}
        else:
            at_rest = {
                "node_position": equilibrium.node_position,
                "node_velocity": 0 * structure.node_velocity,
            }
        document = describe_subject(structure.with_changes(**at_rest), self.case.request)
        write_scene(document, path, overwrite=overwrite)
        return True

    def _write_page(self, path: "Path", overwrite: bool) -> None:
        from tensegrity_codegen.report.loads import compute_static_loads
        from tensegrity_codegen.report.pages.page import write_page
        from tensegrity_codegen.report.state_page import build_state_page
        from tensegrity_codegen.structure.member_limits import describe_tensions, summarise_tensions
        from tensegrity_codegen.structure.outline import hide_bodies, outline_bodies, outline_tendons
        from tensegrity_codegen.system.progress import work_pass

        equilibrium, subject = self.equilibrium, self.actuated
        tensions = describe_tensions(summarise_tensions(subject, equilibrium.member_tension))
        title = f"{self.verdict}in balance: {tensions}"
        with work_pass("drawing"):
            load = compute_static_loads(subject, equilibrium)
            drawn = outline_bodies(subject.with_changes(node_load=load))
            names = hide_bodies(outline_tendons(subject)).member_name
            page = build_state_page(
                equilibrium, drawn, names, f"{title[:1].upper()}{title[1:]}", self.case.command
            )
            write_page(page, path, overwrite=overwrite)


def describe_displacement(equilibrium: "Equilibrium") -> list[str]:
    """Return how far nodes moved, and which motions cost nothing, a line each."""
    lines = ["no node moved"]
    if equilibrium.displacement:
        lines = [f"node {equilibrium.displaced_node} moved farthest, {equilibrium.displacement:.6g} m"]
    if not equilibrium.neutral_motion_names:
        return lines
    if equilibrium.displacement:
        is_moved = equilibrium.change > 1e-12 * equilibrium.extent  # otherwise rounding
        moved = f"node {equilibrium.changed_node} moved farthest, {equilibrium.change:.6g} m"
        lines = [
            f"{moved if is_moved else 'no node moved'}, without these motions "
            f"(with them: node {equilibrium.displaced_node}, {equilibrium.displacement:.6g} m)"
        ]
    free = f"free to {_join_motions(equilibrium.neutral_motion_names)}, without change of energy"
    return [free, *lines]


def _join_motions(names: Sequence[str]) -> str:
    """Return names of neutral motions as one text: "slide along x, y; turn about z"."""
    texts = []
    for kind in ("slide along ", "turn about "):
        axes = [name.removeprefix(kind) for name in names if name.startswith(kind)]
        texts += [kind + ", ".join(axes)] if axes else []
    n_mechanisms = names.count("mechanism")
    texts += [f"move in {n_mechanisms} mechanism{'s' * (n_mechanisms > 1)}"] if n_mechanisms else []
    return "; ".join(texts)


def _judge_snaps(
    model: "CompiledModel",
    equilibria: "Equilibria",
    case_arguments: "CaseArguments",
    outcomes: "Outcomes",
) -> "dict[str, NDArray[Any]]":
    """Return SNAP_RESULTS of every case, the start of which is its given shape, and note the reasons."""
    import numpy as np

    from tensegrity_codegen.runtime.paths.find_equilibrium import judge_snap

    results = {name: np.full(case_arguments.count, np.nan) for name in SNAP_RESULTS}
    for k in np.flatnonzero(equilibria.is_found).tolist():
        arguments = case_arguments.select_case(k)
        arguments.pop("velocity", None)
        start = arguments.pop(COORDINATE, None)
        search_arguments = (
            arguments if equilibria.internal is None else arguments | {"internal": equilibria.internal[k]}
        )
        single = _record_found(model, equilibria.coordinate[k], search_arguments, equilibria.status[k])
        snap = judge_snap(
            model, single, coordinate=start, arguments=arguments, base=arguments.get("node_load")
        )
        outcomes.messages[k] = "; ".join(filter(None, [outcomes.messages[k], *snap.describe()]))
        for name, array in results.items():
            value = getattr(snap, name)
            array[k] = np.nan if value is None else value
    return results


def _record_found(
    model: "CompiledModel", coordinate: "NDArray[Any]", arguments: Mapping[str, Any], status: str
) -> "Equilibrium":
    """Return the record of an equilibrium that was found before, without a search."""
    from tensegrity_codegen.runtime.statics.equilibrium import build_problem, record_outcome
    from tensegrity_codegen.runtime.statics.newton import Outcome

    problem = build_problem(model, arguments)
    start = problem.to_search_coordinate(coordinate)
    problem.watch_stiff_members(start)
    point = problem.find_point(start)
    assert point is not None  # it was found before
    return record_outcome(problem, point, Outcome(status, point, 0), "")


def _without_own_results(kept_texts: "tuple[KeptText, ...]") -> "tuple[KeptText, ...]":
    """Return the texts without RESULTS and coordinates: expressions over quantities."""
    return tuple(kept_text for kept_text in kept_texts if kept_text.expression not in (*RESULTS, COORDINATE))


def _bind_quantities(kept_texts: "tuple[KeptText, ...]", manifest: "Manifest") -> "dict[str, Kept]":
    """Return the kept expressions over quantities, bound to a library, by the names of their arrays."""
    from tensegrity_codegen.analyses.cases.kept import bind_kept

    return {
        kept_result.kept_text.name: kept_result
        for kept_result in bind_kept(_without_own_results(kept_texts), manifest)
    }


def _describe_result(kept_text: "KeptText", manifest: "Manifest") -> Output:
    from tensegrity_codegen.analyses.cases.keep_text import label_axis

    expression = kept_text.text_beside_name
    if kept_text.expression in RESULTS:
        return Output(kept_text.name, (), (), *RESULTS[kept_text.expression], expression=expression)
    dim, names = label_axis(manifest, "n_coordinates", COORDINATE)
    sentence = "Free coordinates."
    return Output(kept_text.name, (dim,), (len(names),), "float64", "m", sentence, {dim: names}, expression)


def _compute_quantities(
    model: "CompiledModel",
    equilibria: "Equilibria",
    case_arguments: "CaseArguments",
    names: tuple[str, ...],
    threads: int,
) -> "dict[str, NDArray[Any]]":
    """Return the quantities `names` at the equilibria, at rest, (count, ...) each."""
    import numpy as np

    from tensegrity_codegen.analyses.cases.quantities import compute_values

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
