"""The verb `schema`: the JSON schema of scene files."""

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.streams import print_text
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.files import check_ending, write_text


def schema(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; stdout if not given.")
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Print the JSON schema of scene files, for editors that complete and check them.

    Example: tensegrity-codegen schema --out scene.schema.json
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.scene.schema.schema import scene_json_schema

        if out is not None:
            check_ending(out, ".json")
        document = scene_json_schema()
        if out is None:
            print_text(json_module.dumps(document, indent=2) + "\n")
        else:
            write_text(json_module.dumps(document, indent=2) + "\n", out, overwrite=overwrite)
            output.result({"status": "ok", "out": str(out)}, f"wrote {out}")


VERB = Verb(schema, order=35)
