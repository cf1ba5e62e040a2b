"""`tensegrity-codegen build`: from a scene to a compiled library."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import CompilerOption, FlagsOption, JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output

__all__ = ["build"]


def build(
    scene: SceneArgument,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for header, C source, example and library.")
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option("--quantity", "-q", help="Quantity to compute instead of the scene's; may be repeated."),
    ] = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Compile what was left out too, to measure the bytes it saved.")
    ] = False,
    compiler: CompilerOption = None,
    flags: FlagsOption = "reference",
    json: JsonOption = False,
) -> None:
    """Generate and compile the library of a scene.

    Example: tensegrity-codegen build prism.toml --out prism_library
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.pipeline import build_library, load_scene
        from tensegrity_codegen.report.tables import functions_table, left_out_table

        structure, request = load_scene(scene)
        if quantity:
            # Without the acceleration there is nothing to integrate.
            integrators = request.integrators if "acceleration" in quantity else ()
            minimised = {"potential_energy", "tangent_stiffness"} <= set(quantity)
            solvers = request.solvers if minimised else ()
            request = request.wanting(*quantity, integrators=integrators, solvers=solvers)
        built = build_library(structure, request, compiler=compiler, flags=flags, measure=measure)
        folder = built.export(out) if out is not None else built.entry.folder
        manifest = built.manifest
        data = {
            "status": "ok",
            "name": manifest.name,
            "folder": str(folder),
            "library": str(folder / built.path.name),
            "from_cache": built.from_cache,
            "seconds": built.seconds,
            "compiler": built.compiler,
            "flags": built.flags,
            "functions": {spec.quantity: spec.symbol for spec in manifest.functions},
            "operations": {spec.quantity: spec.operations for spec in manifest.functions},
            "left_out": [vars(row) for row in manifest.left_out],
        }
        how = "from the cache" if built.from_cache else f"built with {built.compiler}"
        output.result(
            data,
            functions_table(manifest),
            left_out_table(manifest),
            f"{data['library']}\n{how}, {built.seconds:.2f} s",
        )
