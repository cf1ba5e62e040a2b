"""`tensegrity-codegen equilibrium`: where the structure settles."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.inputs import InputOption
from tensegrity_codegen.cli.options import CompilerOption, SceneArgument, StrictOptions
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.files import check_ending, check_output
from tensegrity_codegen.tables.static_methods import Method

LoadOption = Annotated[
    list[str] | None,
    typer.Option(
        "--load",
        help="Load NODE=fx,fy,fz [N] added to the scene's (planar scene: two numbers); may be repeated.",
    ),
]
ToleranceOption = Annotated[
    float, typer.Option(help="Largest node residual, as a fraction of the largest member force.")
]
MethodOption = Annotated[Method, typer.Option(help="auto, newton or relaxation.")]
FrictionlessOption = Annotated[
    bool, typer.Option("--frictionless", help="On the ground: without friction, whatever the scene says.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="Write the settled structure as a scene file.")
]
OverwriteOption = Annotated[bool, typer.Option(help="Let --out replace a file.")]


def equilibrium(
    scene: SceneArgument,
    load: LoadOption = None,
    input: InputOption = None,
    tolerance: ToleranceOption = 1e-9,
    method: MethodOption = "auto",
    frictionless: FrictionlessOption = False,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: StrictOptions,
) -> None:
    """Find the stable equilibrium of a scene, and report how far the nodes moved.

    On the ground weights and loads grow from zero, and friction holds feet from where they first touch.
    Exit code 3 if nothing is found, as where the structure slides or tips, and with --strict if members
    exceed limits or buckle.

    --out may name the scene itself: with --overwrite the settled structure replaces it. The written rest
    lengths contain the values of --input; forces of inputs and loads of --load are not written.

    Example: tensegrity-codegen equilibrium prism.toml --load t1=0,0,-10 --json
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        from tensegrity_codegen.cli.settle import settle_scene

        if out is not None:
            check_ending(out, ".toml")
            check_output(out, overwrite=overwrite, inputs=[] if overwrite else [scene])
        found = settle_scene(
            output,
            scene,
            load or [],
            input,
            out,
            overwrite=overwrite,
            compiler=compiler,
            tolerance=tolerance,
            method=method,
            frictionless=frictionless,
        )
        if not found.is_found or (printing.strict and found.members is not None and found.members.is_beyond):
            raise typer.Exit(3)


VERB = Verb(equilibrium, order=110)
