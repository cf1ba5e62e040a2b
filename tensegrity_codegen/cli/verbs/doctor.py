"""`tensegrity-codegen doctor`: what is installed, which compiler, does it work."""

import typer

from tensegrity_codegen.cli.options import JsonOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb


def doctor(json: JsonOption = False) -> None:
    """Show what is installed and whether a C compiler works; exit code 2 if something required is missing.

    Example: tensegrity-codegen doctor
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.cli.installation import describe_installation, examine_installation

        data = examine_installation()
        output.result(data, "\n".join(describe_installation(data)))
        if data["problems"]:
            raise typer.Exit(2)


VERB = Verb(doctor, order=610)
