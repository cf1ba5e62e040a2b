"""`tensegrity-codegen report`: error against run time of every method, for some scenes."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import (
    CompilerOption,
    FreshOption,
    JsonOption,
    OverwriteOption,
    PeersOption,
    ScenesArgument,
)
from tensegrity_codegen.cli.output import Output, list_files
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.output_folder import check_folder


def report(
    scenes: ScenesArgument,
    t_end: Annotated[float, typer.Option("--t-end", help="End of each motion [s].")] = 1.0,
    samples: Annotated[int, typer.Option("--samples", help="Times at which positions are compared.")] = 11,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for report.html, report.csv, report.json, a journal.")
    ] = Path("work_precision"),
    peers: PeersOption = True,
    longest: Annotated[
        float, typer.Option("--longest", help="Tighten a method no further after a run of this time [s].")
    ] = 3.0,
    compiler: CompilerOption = None,
    flags: Annotated[str, typer.Option("--flags", help="reference or native.")] = "native",
    fresh: FreshOption = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Measure error against run time, and recommend a method.

    Compares every formulation, method and tolerance that a scene allows with a reference that two methods
    certify. After an interruption, the same command resumes.

    Example: tensegrity-codegen report prism.toml tower.toml --t-end 2 --out work_precision
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.pipeline.compile_scene import load_nodes
        from tensegrity_codegen.studies.work_precision.report import write_report
        from tensegrity_codegen.studies.work_precision.scene_report import Options

        check_folder(out, ["report.html", "report.csv", "report.json"], inputs=scenes, overwrite=overwrite)
        structures = [load_nodes(path) for path in scenes]
        for structure in structures:
            output.warn_of(structure)
        options = Options(flags=flags, compiler=compiler, peers=peers, longest=longest)
        with output.resumable(out) as notice, output.progress("measuring") as progress:
            made = write_report(
                structures,
                out,
                t_end=t_end,
                samples=samples,
                options=options,
                progress=progress,
                fresh=fresh,
                overwrite=overwrite,
                notice=notice,
            )
        files = {"html": str(made.html), "csv": str(made.csv), "data": str(made.data)}
        output.result(
            {"status": "ok", "files": files, "resumed": output.resumed, **made.as_dict()},
            "\n".join(made.sentences()),
            list_files(files),
        )


VERB = Verb(report, order=710)
