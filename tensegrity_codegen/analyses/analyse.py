"""The analysis `analyse`: self-stresses, mechanisms, prestress, stability and modes of structures."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.at_point import AtPoint, Point, ResultColumn
from tensegrity_codegen.analyses.cases.record import Option, Result, ResultFile
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.prestressed_scene import Prestressed
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.analysis.analyse import Analysis
    from tensegrity_codegen.runtime.model.model import CompiledModel

NO_PRESTRESS = "no prestress with every cable in tension was found without loads"
TRY_SETTLING = (
    "a shape that is rounded, as on a drawing, is only near one with prestress: --rank-tolerance 1e-3 counts "
    "its small singular values as zero, --prestress 100 --scene-out NEAR.toml writes what that finds, and "
    "`equilibrium NEAR.toml --out SETTLED.toml` moves the nodes into balance"
)
NO_MASS = "natural frequencies are omitted: a free node has no mass"
AS_IN_SCENE = "this is the configuration in the scene; --settle analyses the equilibrium instead"
DEFAULT_RESULTS = (
    *("is_stable", "n_selfstress", "n_mechanisms", "prestress", "least_tension", "mechanism_stiffness"),
    *("smallest_eigenvalue", "natural_frequency"),
)
# Results of each analysis: axes, type, unit, sentence.
RESULTS: Mapping[str, ResultColumn] = {
    "is_stable": (
        (),
        "int64",
        "1",
        "1 where tensions exist that stretch all cables and stiffen all mechanisms.",
    ),
    "n_selfstress": ((), "int64", "1", "Independent self-stresses."),
    "n_mechanisms": ((), "int64", "1", "Independent mechanisms."),
    "n_rigid_motions": ((), "int64", "1", "Independent rigid motions."),
    "prestress": (("member",), "float64", "1", "Tensions without loads, the largest force being 1."),
    "least_tension": ((), "float64", "1", "Least tension of a cable in this prestress; NAN without cables."),
    "mechanism_stiffness": (
        (),
        "float64",
        "1",
        "Least stiffness that the tensions give to a mechanism, over the largest force density; NAN without.",
    ),
    "smallest_eigenvalue": (
        (),
        "float64",
        "N/m",
        "Smallest eigenvalue of the stiffness off neutral motions.",
    ),
    "residual": ((), "float64", "N", "Largest static force on a node."),
    "natural_frequency": (("mode",), "float64", "Hz", "Undamped natural frequencies; NAN without masses."),
}


@dataclass(frozen=True)
class Analyse(AtPoint):
    """Find self-stresses, mechanisms, a prestress with all cables in tension, stability and modes.

    Where no prestress exists, node displacements prove it: they change the length of no bar, lengthen no
    cable and shorten at least one. Members are compared with the limits of the scene. Exit code 3 if there
    is no such prestress, or if the structure is not stable with it, and with --strict if members exceed
    limits or buckle.

    --prestress 100 --scene-out tense.toml writes the scene with the prestress found, 100 N in the cable with
    most tension; of several self-stresses it is the one whose least cable tension is largest.

    Example: tensegrity-codegen analyse prism.toml --json
    """

    name: ClassVar[str] = "analyse"
    success_phrase: ClassVar[str] = "were analysed"
    verb_order: ClassVar[int] = 120
    takes: ClassVar[tuple[str, ...]] = ("input", "strict")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".npz",), "Write self-stresses, mechanisms, tensions, modes and proof (.npz)."),
        ResultFile(
            "page", (".html",), "Write a page with pictures of mechanisms and modes (.html).", draws=True
        ),
        ResultFile(
            "scene_out", (".toml",), "Write the scene with the prestress found as a scene file (.toml).",
            key="",
        ),
    )  # fmt: skip
    analysis: ClassVar[str] = "analyse"
    results: ClassVar[Mapping[str, ResultColumn]] = RESULTS
    default_results: ClassVar[tuple[str, ...]] = DEFAULT_RESULTS

    rank_tolerance: Annotated[
        float,
        Option("singular values up to this part of the largest one count as zero.", in_sweep=False),
    ] = 1e-6
    n_modes: Annotated[
        int, Option("number of natural frequencies and modes.", argument_name="modes", in_sweep=False)
    ] = 10
    prestress: Annotated[
        str | None,
        Option(
            "size [N] of the prestress that --scene-out writes: FORCE of the cable with most tension, "
            "least=FORCE of the cable with least, or MEMBER=FORCE.",
            in_sweep=False,
        ),
    ] = None

    def compute_case(
        self, model: "CompiledModel", point: Point, arguments: Mapping[str, Any], names: Collection[str]
    ) -> Mapping[str, Any]:
        """Return the results `names` of one case."""
        from tensegrity_codegen.runtime.analysis.analyse import analyse
        from tensegrity_codegen.runtime.model.interface import name_states

        coordinate, _ = point
        static_arguments = {name: value for name, value in arguments.items() if name != "velocity"}
        n_modes = len(name_states(model.manifest)) // 2
        analysis = analyse(model, coordinate=coordinate, arguments=static_arguments, n_modes=n_modes)
        results: dict[str, Any] = {name: getattr(analysis, name, None) for name in names}
        results["is_stable"] = analysis.status == "stable"
        results["prestress"] = analysis.prestress.tension
        results["least_tension"] = _replace_infinite(analysis.prestress.least_tension)
        results["mechanism_stiffness"] = _replace_infinite(analysis.stability.smallest_eigenvalue)
        results["natural_frequency"] = () if analysis.modes is None else analysis.modes.frequency
        return results

    def check_files(self, paths: "Mapping[str, Any]") -> None:
        """Raise InvalidValueError if only one of --prestress and --scene-out is stated."""
        if (self.prestress is None) != (paths.get("scene_out") is None):
            raise InvalidValueError(
                "the size of the prestress and the file to write belong together",
                where="--prestress" if self.prestress is not None else "--scene-out",
                allowed="both options, or none",
                hint="analyse SCENE --prestress 100 --scene-out tense.toml",
            )

    def solve(self, case: "SceneCase") -> "AnalyseResult":
        """Return the analysis of a scene, at its positions or in its equilibrium."""
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.settle import move_near_origin, with_statics
        from tensegrity_codegen.runtime.analysis.analyse import analyse
        from tensegrity_codegen.system.progress import work_pass

        statics = with_statics(case.subject, case.request)
        centred, offset = move_near_origin(case.subject, case.request)
        needs = find_needs("analyse", centred, statics).alone(statics)
        if self.settles:
            needs = find_needs("equilibrium", centred, statics).besides(needs)
        model = case.build(centred, needs)
        start, arguments = None, case.arguments
        if self.settles:
            equilibrium = case.settle(model)
            start, arguments = equilibrium.coordinate, arguments | equilibrium.internal_argument
        with work_pass("analysing"):
            analysis = analyse(
                model,
                coordinate=start,
                arguments=arguments,
                rank_tolerance=self.rank_tolerance,
                n_modes=self.n_modes,
            )
        moved = replace(analysis, node_position=analysis.node_position + offset)
        return AnalyseResult(case, self, moved, start)


@dataclass(eq=False)
class AnalyseResult(Result):
    """The analysis of a scene.

    start (n_coordinates,): the equilibrium that was analysed; None: the positions of the scene.
    prestressed, prestressed_scene: the scene written with the prestress found, and its path.
    """

    case: "SceneCase"
    options: Analyse
    analysis: "Analysis"
    start: "NDArray[Any] | None"
    prestressed: "Prestressed | None" = None
    prestressed_scene: "Path | None" = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the analysis, and a hint if the positions are not balanced."""
        analysis = self.analysis
        is_apart = not self.options.settles and not analysis.is_balanced and not analysis.is_good
        return (*analysis.warnings, *([AS_IN_SCENE] if is_apart else []))

    @property
    def is_good(self) -> bool:
        """Whether the structure is stable with a prestress, and a scene that was asked for was written."""
        return self.analysis.is_good and (self.prestressed_scene is None or self.prestressed is not None)

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle."""
        return self.analysis.members.is_beyond

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write arrays, a page, or the scene with the prestress found."""
        subject = self.case.subject
        if name == "out":
            from tensegrity_codegen.report.analysis_tables import write_analysis

            write_analysis(self.analysis, path, subject.member_name, subject.node_name, overwrite=overwrite)
            return True
        if name == "page":
            from tensegrity_codegen.report.analysis_page import build_analysis_page
            from tensegrity_codegen.report.pages.page import write_page
            from tensegrity_codegen.structure.outline import hide_bodies, outline_bodies, outline_tendons
            from tensegrity_codegen.system.progress import work_pass

            with work_pass("drawing"):
                drawn, command = outline_bodies(subject), self.case.command
                shown = hide_bodies(outline_tendons(subject)).member_name
                page = build_analysis_page(self.analysis, drawn, shown, command)
                write_page(page, path, overwrite=overwrite)
            return True
        return self._write_prestressed(path, overwrite)

    def _write_prestressed(self, path: "Path", overwrite: bool) -> bool:
        """Write the scene with the prestress found; warn and return False if there is none."""
        from tensegrity_codegen.analyses.cases.prestressed_scene import write_prestressed
        from tensegrity_codegen.structure.ground_support import require_no_ground

        case = self.case
        require_no_ground(case.subject, "a prestress that is written to a scene")
        assert self.options.prestress is not None  # as `check_files` found
        self.prestressed_scene = path
        self.prestressed = write_prestressed(
            case.subject,
            case.request,
            self.analysis,
            self.start,
            self.options.prestress,
            path,
            overwrite=overwrite,
        )
        if self.prestressed is None:
            case.warn(f"{path} is not written: {NO_PRESTRESS}")
        elif self.prestressed.warning:
            case.warn(self.prestressed.warning)
        return self.prestressed is not None

    def as_dict(self) -> dict[str, Any]:
        """Return counts, tensions, certificate, modes and members against their limits."""
        from tensegrity_codegen.report.analysis_tables import describe_analysis

        subject, analysis, tense = self.case.subject, self.analysis, self.prestressed
        data = describe_analysis(analysis, subject.member_name, subject.node_name)
        data["modes_note"] = NO_MASS if analysis.modes is None else None
        data["prestressed"] = None
        if tense is not None:
            data["prestressed"] = {
                "scene": str(self.prestressed_scene),
                "member_tension": dict(zip(subject.member_name, tense.tension.tolist(), strict=True)),
                "residual": tense.residual,
                "note": tense.note,
            }
        data["hint"] = TRY_SETTLING if analysis.status == "infeasible" else None
        return data

    def describe(self) -> list[Any]:
        """Return the verdict, counts, members, proof and modes."""
        from tensegrity_codegen.report.analysis_tables import (
            analysis_members_table,
            analysis_table,
            certificate_table,
            modes_table,
        )

        subject, analysis = self.case.subject, self.analysis
        tables = [
            analysis_members_table(analysis, subject),
            certificate_table(analysis, subject),
            modes_table(analysis, subject.name),
        ]
        notes = [NO_MASS] if analysis.modes is None else []
        if self.prestressed is not None:
            tense = self.prestressed
            notes.append(
                f"wrote {self.prestressed_scene}: member forces from {tense.tension.min():.6g} to "
                f"{tense.tension.max():.6g} N, largest residual {tense.residual:.2g} N; {tense.note}"
            )
        hints = [f"try: {TRY_SETTLING}"] if analysis.status == "infeasible" else []
        verdict = f"{'exceeds limits; ' if self.is_beyond else ''}{analysis.status}: {analysis.message}"
        shown = [table for table in tables if table is not None]
        return [verdict, *hints, analysis_table(analysis, subject.name), *shown, *notes]


def _replace_infinite(value: float) -> float:
    """Return the value, NAN for an infinite one."""
    return value if math.isfinite(value) else math.nan


ANALYSIS = Analyse
