"""Options of a simulation, as `simulate` takes them."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.runtime.integrate.methods import METHODS

TEndOption = Annotated[float, typer.Option("--t-end", help="Simulated time [s].", show_default=False)]
SamplesOption = Annotated[int, typer.Option("--samples", help="Number of equally spaced samples.")]
RtolOption = Annotated[
    float, typer.Option("--rtol", help="Relative tolerance of methods with error control.")
]
AtolOption = Annotated[
    float | None,
    typer.Option(
        "--atol",
        help="Absolute tolerance, m and m/s; if not given 1e-9 of the structure's length and speed.",
        show_default=False,
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        help=f"One of {', '.join(METHODS)}; auto says what it chooses, radau is for stiff bars.",
    ),
]
StepOption = Annotated[float | None, typer.Option("--step", help="Step of fixed-step methods [s].")]
MaxStepsOption = Annotated[
    int | None,
    typer.Option(
        "--max-steps", help="Most steps of one run of a method in C; default a million, more with --keep."
    ),
]
KeepOption = Annotated[
    str, typer.Option("--keep", help="energy: keep it constant, for long undamped motions.")
]
ControlOption = Annotated[
    str | None,
    typer.Option(
        "--control",
        help="What the tolerance limits: samples (total error; default) or steps (default with --keep).",
    ),
]
ProfileOption = Annotated[
    Path | None,
    typer.Option("--profile", help="Inputs over time (.csv): the column time, and one for each input."),
]
ProfileKindOption = Annotated[
    str, typer.Option("--profile-kind", help="Between the rows of --profile: linear or cubic.")
]
SettleOption = Annotated[bool, typer.Option("--settle", help="Start from the equilibrium.")]
UntilOption = Annotated[
    str | None,
    typer.Option("--until", help="End early: contact of two bars, or a condition: 'top.z < 0.1'."),
]
BatchOption = Annotated[
    Path | None, typer.Option("--batch", help="File of many starts (.npz), simulated side by side.")
]
ThreadsOption = Annotated[int, typer.Option("--threads", help="Number of threads for a batch.")]
