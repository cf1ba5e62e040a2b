"""`tensegrity-codegen sweep case`: one case of a sweep, and its scene as a file of its own."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.sweep_summary import SweepArgument
from tensegrity_codegen.system.files import check_ending, check_output

NumberArgument = Annotated[int, typer.Argument(metavar="CASE", help="Number of the case, from 0 on.")]
OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="Write the scene of the case (.toml).")]


def case(
    file: SweepArgument,
    number: NumberArgument,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Show one case of a sweep, and write its scene.

    The text ends with the commands that write the scene and run the case alone.

    Example: tensegrity-codegen sweep case loads.zarr 17 -o case17.toml
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.cli.sweep_commands import build_commands
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.sweeps.summary.case_scene import build_case_scene, check_case
        from tensegrity_codegen.sweeps.summary.read_results import read_results

        if out is not None:
            check_ending(out, ".toml")
            check_output(out, overwrite=overwrite)
        results = read_results(file)
        check_case(results, number)
        keys = dict(zip(results.keys, results.key_values[number].tolist(), strict=True))
        if out is not None:
            write_scene(build_case_scene(file, keys), out, overwrite=overwrite)
        status, message = results.words[int(results.status[number])], results.message(number)
        commands = build_commands(results, number)
        output.result(
            {
                "status": "ok",
                "case": number,
                "case_status": status,
                "message": message,
                "keys": keys,
                "commands": list(commands),
                "out": None if out is None else str(out),
            },
            f"{status}: {message}" if message else status,
            *(f"{key} = {value!r}" for key, value in keys.items()),
            *([f"wrote {out}"] if out is not None else commands),
        )
