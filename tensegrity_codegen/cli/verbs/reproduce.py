"""`tensegrity-codegen reproduce`: the papers beside what comes out here, as one page."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import FreshOption, JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.output_folder import check_folder


def reproduce(
    paper: Annotated[
        list[str] | None, typer.Argument(metavar="[sk|lin|scs|all]...", help="Papers; all if none is named.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for reproduce.html and reproduce.json.")
    ] = Path("reproduction"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Smaller sizes and shorter times, for a first look.")
    ] = False,
    fresh: FreshOption = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Recompute the tables and figures of three papers, and compare them with the printed ones on a page.

    After an interruption, the same command resumes.

    Example: tensegrity-codegen reproduce all --out reproduction
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.report.result_tables import outcome_table
        from tensegrity_codegen.studies.papers.reproduce import reproduce as run

        check_folder(out, ["reproduce.html", "reproduce.json"], inputs=(), overwrite=overwrite)
        with output.resumable(out) as notice, output.progress("computing") as progress:
            made = run(
                paper or [],
                out,
                quick=quick,
                progress=progress,
                fresh=fresh,
                overwrite=overwrite,
                notice=notice,
            )
        wrote = f"wrote {made.html}\nwrote {made.data}"
        output.result(
            {"status": "ok", "resumed": output.resumed, **made.summary()},
            made.page.title,
            outcome_table(made.page),
            wrote,
        )


VERB = Verb(reproduce, order=730)
