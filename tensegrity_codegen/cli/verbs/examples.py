"""The verb `examples`: the scenes that ship with the package."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.scene_files import list_examples, read_example
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.files import check_ending, write_text


def examples(
    name: Annotated[str | None, typer.Argument(help="Example to copy; default: list all.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; NAME.toml if not given.")
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """List the example scenes, or copy one of them.

    Example: tensegrity-codegen examples prism --out prism.toml
    """
    output = Output(json)
    with output.guard():
        if name is None:
            about = {key: text.splitlines()[0].lstrip("# ") for key, text in list_examples().items()}
            lines = [f"{key:<14} {sentence}" for key, sentence in about.items()]
            output.result({"status": "ok", "examples": about}, "\n".join(lines))
            return
        target = out or Path(f"{name}.toml")
        check_ending(target, ".toml")
        write_text(read_example(name), target, overwrite=overwrite)
        output.result({"status": "ok", "out": str(target)}, f"wrote {target}")


VERB = Verb(examples, order=25)
