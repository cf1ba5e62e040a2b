"""All verbs in one application, and how it ends: 0 good, 2 bad input, 3 no convergence or unstable."""

from __future__ import annotations

import sys

import typer

from tensegrity_codegen.cli.build import build
from tensegrity_codegen.cli.doctor import doctor
from tensegrity_codegen.cli.equilibrium import equilibrium
from tensegrity_codegen.cli.linearize import linearize
from tensegrity_codegen.cli.scenes import check, examples, import_foreign, new, schema
from tensegrity_codegen.cli.show import show
from tensegrity_codegen.cli.simulate import simulate
from tensegrity_codegen.version import VERSION

__all__ = ["app", "main"]

app = typer.Typer(
    name="tensegrity-codegen",
    help="From a scene file to a compiled C library that computes a tensegrity structure.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for verb in (new, check, schema, build, equilibrium, simulate, linearize, show, doctor, examples):
    app.command()(verb)
app.command("import")(import_foreign)


@app.callback(invoke_without_command=True)
def version_option(
    version: bool = typer.Option(False, "--version", is_eager=True, help="Print the version and exit."),
) -> None:
    """From a scene file to a compiled C library that computes a tensegrity structure."""
    if version:
        typer.echo(f"tensegrity-codegen {VERSION}")
        raise typer.Exit


def main() -> None:
    """Run the command line; Ctrl-C ends with exit code 130."""
    try:
        app()
    except KeyboardInterrupt:
        typer.echo("interrupted", err=True)
        sys.exit(130)
