"""Options of `build` alone."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.options import read_folder
from tensegrity_codegen.tables.targets import TARGETS

FolderOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        parser=read_folder,
        metavar="<path>",
        help="Folder for header, C source, example and library.",
    ),
]
QuantityOption = Annotated[
    list[str] | None,
    typer.Option("--quantity", "-q", help="Quantity to compute instead of the scene's; may be repeated."),
]
MeasureOption = Annotated[
    bool,
    typer.Option(
        "--measure", help="Also compile the omitted functions, to measure how many bytes were saved."
    ),
]
EmitterOption = Annotated[
    str | None,
    typer.Option("--emitter", help="Emitter, instead of the scene's: auto, unrolled, lanes, table."),
]
InterfaceOption = Annotated[
    list[str] | None,
    typer.Option(
        "--interface",
        help="Also callable this way, besides the scene's: casadi, for casadi.external with first "
        "derivatives; casadi_hessian, with second derivatives too; acados, for its integrators (alone).",
    ),
]
TargetOption = Annotated[
    str | None,
    typer.Option(
        "--target", help=f"Machine to compile for, by zig, instead of this one: {', '.join(TARGETS)}."
    ),
]
WheelOption = Annotated[
    bool,
    typer.Option("--wheel", help="Add a Python package of the library to --out; it needs NumPy alone."),
]
PresetOption = Annotated[
    str | None,
    typer.Option(
        "--preset",
        help="Settings for a purpose, instead of the scene's: casadi, acados, f32, mcu (docs/embedding.md).",
    ),
]
TuneOption = Annotated[
    bool, typer.Option("--tune", help="Measure emitters and compilers; use and remember the fastest.")
]
TuneForOption = Annotated[
    str | None,
    typer.Option("--tune-for", help="Like --tune, but by the time of this quantity (--tune: sum of all)."),
]
AnyFlagsOption = Annotated[
    bool, typer.Option("--any-flags", help="Let --tune compare reference and native flags.")
]
