"""`tensegrity-codegen analyse`: which tensions a structure can have, and how it moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.files import check_ending, check_output

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.analysis.analysis import Analysis
    from tensegrity_codegen.scene.subject import Subject

__all__ = ["VERB"]

SETTLED = 1e-12  # tolerance of the equilibrium to analyse
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


def analyse(
    scene: SceneArgument,
    settle: SettleOption = False,
    input: InputOption = None,
    rank_tolerance: ToleranceOption = 1e-6,
    n_modes: ModesOption = 10,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    json: JsonOption = False,
) -> None:
    """Find self-stresses, mechanisms, a prestress with all cables in tension, stability and modes.

    Where no prestress exists, node displacements prove it: they change the length of no bar, lengthen no
    cable and shorten at least one. Members are compared with the limits of the scene. Exit code 3 if there
    is no such prestress, or if the structure is not stable with it.

    Example: tensegrity-codegen analyse prism.toml --json
    """
    output = Output(json)
    with output.guard(scene):
        if out is not None:
            check_ending(out, ".npz")
            check_output(out, inputs=[scene], overwrite=overwrite)
        subject, found = _analyse(
            output, scene, settle, input, compiler, rank_tolerance=rank_tolerance, n_modes=n_modes
        )
        if out is not None:
            from tensegrity_codegen.report.analysis_data import write_analysis

            write_analysis(found, out, subject.member_name, subject.node_name)
        _report(output, subject, found, out)
        if not found.is_good:
            raise typer.Exit(3)


def _analyse(
    output: Output,
    scene: Path,
    settle: bool,
    texts: list[str] | None,
    compiler: str | None,
    **options: Any,
) -> tuple[Subject, Analysis]:
    """Return the structure and its analysis, at the scene's positions or at the equilibrium."""
    from tensegrity_codegen.pipeline import build_library, find_needs, move_near_origin, with_statics
    from tensegrity_codegen.runtime.analysis.analyse import analyse as run
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    subject, request = output.load(scene, settles=settle)
    arguments = read_inputs(texts, subject, output)
    statics = with_statics(subject, request)
    near, offset = move_near_origin(subject, request)
    wanted = find_needs("analyse", near, statics).alone(statics)
    model = build_library(near, wanted, compiler=compiler).load()
    start = None
    if settle:
        settled = find_equilibrium(model, arguments=arguments, tolerance=SETTLED)
        for text in settled.warnings:
            output.warn(text)
        start = settled.coordinate
    found = run(model, coordinate=start, arguments=arguments, **options)
    return subject, replace(found, node_position=found.node_position + offset)


def _report(output: Output, subject: Subject, found: Analysis, out: Path | None) -> None:
    """Print the analysis: counts, members, proof, modes."""
    from tensegrity_codegen.report.analysis_data import describe_analysis
    from tensegrity_codegen.report.analysis_tables import (
        analysis_members_table,
        analysis_table,
        certificate_table,
        modes_table,
    )

    for text in found.warnings:
        output.warn(text)
    data = describe_analysis(found, subject.member_name, subject.node_name)
    data |= {"modes_note": NO_MASS if found.modes is None else None, "out": None if out is None else str(out)}
    name = subject.name
    tables = [analysis_members_table(found, subject), certificate_table(found, subject)]
    tables += [modes_table(found, name)]
    shown = [table for table in tables if table is not None]
    notes = [NO_MASS] if found.modes is None else []
    output.result(data, analysis_table(found, name), *shown, *notes, f"{found.status}: {found.message}")


VERB = Verb(analyse, order=55)
