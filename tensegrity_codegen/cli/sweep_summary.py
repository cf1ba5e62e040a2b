"""`tensegrity-codegen sweep summary`: what came out of a sweep, as text, JSON and one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.cli.option_names import quote_command
from tensegrity_codegen.cli.options import JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.scene_files import write_text
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.files import check_ending, check_output

if TYPE_CHECKING:
    from tensegrity_codegen.sweeps.summary.summary import SweepSummary


SweepArgument = Annotated[
    Path, typer.Argument(metavar="FILE.zarr", help="Folder that sweep wrote.", show_default=False)
]
ResultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--result",
        help="Result to describe: NAME, NAME[PART,...], NAME[max]; repeatable. Default: the first four.",
    ),
]
OverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--over", help="Key to draw results over; repeat for several. Default: those that matter most."
    ),
]
PageOption = Annotated[Path | None, typer.Option("--out", "-o", help="Write a page (.html).")]


def summary(
    file: SweepArgument,
    result: ResultOption = None,
    over: OverOption = None,
    out: PageOption = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Summarize a sweep: how cases ended, distributions, what results depend on, worst cases.

    A quantity with dimensions needs a part for each: a label, a place from 0 on, or max, min, mean; one of
    these three alone is over all dimensions. A sweep that is not finished has a summary too.

    Example: tensegrity-codegen sweep summary loads.zarr --result 'member_tension[max]' -o loads.html
    """
    output = Output(json)
    with output.guard():
        if out is not None:
            check_ending(out, ".html")
            check_output(out, overwrite=overwrite)
            require_plot()
        from tensegrity_codegen.cli.sweep_commands import build_commands
        from tensegrity_codegen.sweeps.summary.finding import describe_finding
        from tensegrity_codegen.sweeps.summary.read_results import read_results
        from tensegrity_codegen.sweeps.summary.summary import summarize
        from tensegrity_codegen.sweeps.summary.tables import list_tables

        found = summarize(read_results(file), result or (), over or (), build_commands)
        if out is not None:
            _write_page(found, out, overwrite)
        written = [] if out is None else [f"wrote {out}"]
        output.result(
            {"status": "ok", **found.as_dict(), "out": None if out is None else str(out)},
            describe_finding(found),
            *list_tables(found),
            *written,
        )


def _write_page(found: "SweepSummary", path: Path, overwrite: bool) -> None:
    """Write the page, whole or not at all."""
    from tensegrity_codegen.report.pages.render_page import render_page
    from tensegrity_codegen.sweeps.summary.summary_page import build_summary_page

    text = render_page(build_summary_page(found, quote_command()))
    write_text(text, path, overwrite=overwrite)
