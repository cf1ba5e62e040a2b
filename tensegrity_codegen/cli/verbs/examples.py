"""The verb `examples`: the scenes that ship with the package."""

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.files import check_ending, write_text


def list_examples() -> dict[str, str]:
    """Return name -> text of the scenes that ship with the package."""
    folder = files("tensegrity_codegen.scene").joinpath("examples")
    examples = {
        file.name.removesuffix(".toml"): file for file in folder.iterdir() if file.name.endswith(".toml")
    }
    return {name: examples[name].read_text(encoding="utf-8") for name in sorted(examples)}


def read_example(name: str) -> str:
    """Return the text of an example; UnknownNameError for a name that is none."""
    examples = list_examples()
    check_choice(name, examples, "example", "examples")
    return examples[name]


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
            about = {key: content.splitlines()[0].lstrip("# ") for key, content in list_examples().items()}
            lines = [f"{key:<14} {sentence}" for key, sentence in about.items()]
            output.result({"status": "ok", "examples": about}, "\n".join(lines))
            return
        target = out or Path(f"{name}.toml")
        check_ending(target, ".toml")
        write_text(read_example(name), target, overwrite=overwrite)
        output.result({"status": "ok", "out": str(target)}, f"wrote {target}")


VERB = Verb(examples, order=25)
