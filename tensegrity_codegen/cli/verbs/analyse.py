"""`tensegrity-codegen analyse`: which tensions a structure can have, and how it moves."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import (
    CompilerOption,
    OverwriteOption,
    PrestressOption,
    SceneArgument,
    SceneOutOption,
    StrictOptions,
    check_prestress,
)
from tensegrity_codegen.cli.output import Output, check_result, write_page
from tensegrity_codegen.cli.verb import Verb, quote_command

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.cli.prestressed_scene import Prestressed
    from tensegrity_codegen.runtime.analysis.analysis import Analysis
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


NO_PRESTRESS = "no prestress with every cable in tension was found without loads"
TRY_SETTLING = (
    "a shape that is rounded, as on a drawing, is only near one with prestress: give members an approximate "
    "prestress, let `equilibrium SCENE --out SETTLED.toml` move the nodes into balance, and use that file"
)
NO_MASS = "natural frequencies are omitted: a free node has no mass"

SettleOption = Annotated[
    bool, typer.Option("--settle", help="Analyse the equilibrium instead of the scene's positions.")
]
ToleranceOption = Annotated[
    float,
    typer.Option(
        "--rank-tolerance",
        help="Singular values above this part of the largest one never count as zero.",
    ),
]
ModesOption = Annotated[int, typer.Option("--modes", help="Number of natural frequencies and modes.")]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Write self-stresses, mechanisms, tensions, modes and proof (.npz)."),
]
PageOption = Annotated[
    Path | None,
    typer.Option("--page", help="Write a page with pictures of mechanisms and modes (.html)."),
]


def analyse(
    scene: SceneArgument,
    settle: SettleOption = False,
    input: InputOption = None,
    rank_tolerance: ToleranceOption = 1e-6,
    n_modes: ModesOption = 10,
    out: OutOption = None,
    page: PageOption = None,
    prestress: PrestressOption = None,
    scene_out: SceneOutOption = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: StrictOptions,
) -> None:
    """Find self-stresses, mechanisms, a prestress with all cables in tension, stability and modes.

    Where no prestress exists, node displacements prove it: they change the length of no bar, lengthen no
    cable and shorten at least one. Members are compared with the limits of the scene. Exit code 3 if there
    is no such prestress, or if the structure is not stable with it, and with --strict if members exceed
    limits or buckle.

    --prestress 100 --scene-out tense.toml writes the scene with the prestress found, 100 N in the cable with
    most tension; of several self-stresses it is the one whose least cable tension is largest.

    Example: tensegrity-codegen analyse prism.toml --json
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        check_prestress(prestress, scene_out)
        check_result(out, ".npz", inputs=[scene], overwrite=overwrite)
        check_result(scene_out, ".toml", inputs=[scene], overwrite=overwrite)
        check_result(page, ".html", inputs=[scene], overwrite=overwrite, draws=True)
        subject, found, start, request = _analyse(
            output, scene, settle, input, compiler, rank_tolerance=rank_tolerance, n_modes=n_modes
        )
        output.warn(*found.warnings)
        if not settle and not found.is_balanced and not found.is_good:
            output.warn("this is the configuration in the scene; --settle analyses the equilibrium instead")
        tense = None
        if prestress is not None and scene_out is not None:
            from tensegrity_codegen.structure.ground_support import require_no_ground

            require_no_ground(subject, "a prestress that is written to a scene")
            from tensegrity_codegen.cli.prestressed_scene import write_prestressed

            tense = write_prestressed(
                subject, request, found, start, prestress, scene_out, overwrite=overwrite
            )
            if tense is None:
                output.warn(f"{scene_out} is not written: {NO_PRESTRESS}")
        if out is not None:
            from tensegrity_codegen.report.analysis_data import write_analysis

            write_analysis(found, out, subject.member_name, subject.node_name, overwrite=overwrite)
        if page is not None:
            from tensegrity_codegen.report.analysis_page import build_analysis_page
            from tensegrity_codegen.structure.outline import outline_bodies

            with output.progress("drawing"):
                drawn = outline_bodies(subject)
                shown = build_analysis_page(found, drawn, subject.member_name, quote_command())
                write_page(shown, page, overwrite=overwrite)
        _report(output, subject, found, {"out": out, "page": page}, scene_out, tense)
        is_refused = printing.strict and found.members.is_beyond
        if is_refused or not found.is_good or (scene_out is not None and tense is None):
            raise typer.Exit(3)


def _analyse(
    output: Output,
    scene: Path,
    settle: bool,
    texts: list[str] | None,
    compiler: str | None,
    **options: Any,
) -> "tuple[Subject, Analysis, NDArray[np.float64] | None, ModelRequest]":
    """Return the structure, its analysis, the equilibrium if it was analysed, and the request."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import move_near_origin, with_statics
    from tensegrity_codegen.runtime.analysis.analyse import analyse as run
    from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance, find_equilibrium

    subject, request = output.load(scene, settles=settle)
    arguments: dict[str, Any] = dict(read_inputs(texts, subject, output))
    statics = with_statics(subject, request)
    near, offset = move_near_origin(subject, request)
    wanted = find_needs("analyse", near, statics).alone(statics)
    model = build_library(near, wanted, compiler=compiler, calls=FEW_CALLS).load()
    start = None
    if settle:
        settled = find_equilibrium(model, arguments=arguments, tolerance=choose_tolerance(subject))
        output.warn(*settled.warnings)
        start, arguments = settled.coordinate, arguments | settled.internal_argument
    with output.progress("analysing"):
        found = run(model, coordinate=start, arguments=arguments, **options)
    return subject, replace(found, node_position=found.node_position + offset), start, request


def _report(
    output: Output,
    subject: "Subject",
    found: "Analysis",
    files: dict[str, Path | None],
    scene_out: Path | None,
    tense: "Prestressed | None",
) -> None:
    """Print the analysis: counts, members, proof, modes."""
    from tensegrity_codegen.report.analysis_data import describe_analysis
    from tensegrity_codegen.report.analysis_tables import (
        analysis_members_table,
        analysis_table,
        certificate_table,
        modes_table,
    )

    data = describe_analysis(found, subject.member_name, subject.node_name)
    data["modes_note"] = NO_MASS if found.modes is None else None
    data |= {key: None if path is None else str(path) for key, path in files.items()}
    data["prestressed"] = None
    name = subject.name
    tables = [analysis_members_table(found, subject), certificate_table(found, subject)]
    tables += [modes_table(found, name)]
    shown = [table for table in tables if table is not None]
    notes = [NO_MASS] if found.modes is None else []
    if tense is not None:
        data["prestressed"] = {
            "scene": str(scene_out),
            "member_tension": dict(zip(subject.member_name, tense.tension.tolist(), strict=True)),
            "residual": tense.residual,
            "note": tense.note,
        }
        least, most = tense.tension.min(), tense.tension.max()
        notes.append(
            f"wrote {scene_out}: member forces from {least:.6g} to {most:.6g} N, largest residual "
            f"{tense.residual:.2g} N; {tense.note}"
        )
    data["hint"] = TRY_SETTLING if found.status == "infeasible" else None
    hints = [f"try: {TRY_SETTLING}"] if found.status == "infeasible" else []
    verdict = f"{'exceeds limits; ' if found.members.is_beyond else ''}{found.status}: {found.message}"
    output.result(data, verdict, *hints, analysis_table(found, name), *shown, *notes)


VERB = Verb(analyse, order=120)
