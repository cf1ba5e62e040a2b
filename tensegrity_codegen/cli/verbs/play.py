"""`tensegrity-codegen play`: a page in which the compiled model runs."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.picture import ThreeOption, play_live
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.files import check_ending, check_output
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR


def play(
    scene: SceneArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="Live page (.html).")],
    overwrite: OverwriteOption = False,
    rtol: Annotated[float, typer.Option("--rtol", help="Relative tolerance of each step.")] = 1e-6,
    method: Annotated[
        str,
        typer.Option(
            "--method", help=f"Integrator at the start: auto, rk54, or {STIFF_INTEGRATOR} for stiff bars."
        ),
    ] = "auto",
    settle: Annotated[bool, typer.Option("--settle", help="Start from the equilibrium, at rest.")] = False,
    profile: Annotated[
        Path | None,
        typer.Option("--profile", help="Inputs over time (.csv), as of simulate; the camera follows."),
    ] = None,
    three: ThreeOption = None,
    json: JsonOption = False,
) -> None:
    """Write a page in which the compiled model runs: drag nodes, move sliders, at real time.

    The generated C is compiled to WebAssembly by zig and stands in the page, one HTML file without requests.

    Example: tensegrity-codegen play prism.toml --out prism.html
    """
    output = Output(json)
    with output.guard(scene):
        check_ending(out, ".html")
        inputs = [path for path in (scene, profile) if path is not None]
        check_output(out, inputs=inputs, overwrite=overwrite)
        output.result(*play_live(output, scene, out, rtol, method, settle, profile, three, overwrite))


VERB = Verb(play, order=240)
