"""The verb `new`: a scene file to start from."""

from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.cli.verbs.examples import read_example
from tensegrity_codegen.system.files import check_ending, write_text


def new(
    scene: SceneArgument,
    shape: Annotated[
        str, typer.Option("--shape", help="Example to start from; see the verb examples.")
    ] = "prism",
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Write a new scene file, with comments that explain the format.

    Example: tensegrity-codegen new my_prism.toml --shape prism
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.scene.names import check_scene_name

        check_ending(scene, ".toml")
        check_scene_name(scene.stem, where=str(scene))
        lines = read_example(shape).splitlines(keepends=True)
        name_line = next(index for index, line in enumerate(lines) if line.startswith("name ="))
        comment = lines[name_line].partition("#")
        lines[name_line] = f'name = "{scene.stem}"' + (f"  #{comment[2]}" if comment[1] else "\n")
        write_text("".join(lines), scene, overwrite=overwrite)
        output.result({"status": "ok", "scene": str(scene), "shape": shape}, f"wrote {scene}")


VERB = Verb(new, order=10)
