"""Options of `sweep`: what varies, what is done and kept, where it runs."""

from pathlib import Path
from typing import Annotated

import typer

DoOption = Annotated[
    str,
    typer.Option(
        "--do",
        help="What is done with each case: evaluate, equilibrium, linearize or simulate.",
        show_default=False,
    ),
]
OverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--over",
        help="An axis of a grid: KEY=start:stop:n, KEY=start:stop:n:log or KEY=a,b,c; repeat for several.",
    ),
]
SampleOption = Annotated[
    list[str] | None,
    typer.Option(
        "--sample",
        help="A random number: KEY=normal(m,s), KEY=uniform(a,b) or KEY=lognormal(m,s); repeat for several.",
    ),
]
TableOption = Annotated[
    Path | None, typer.Option("--table", help="Cases from a file (.csv): a column a key, a row a case.")
]
NumberOption = Annotated[int | None, typer.Option("--n", help="Number of samples (saltelli: base number).")]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of the samples.")]
SamplingOption = Annotated[
    str,
    typer.Option(
        "--sampling",
        help="How samples are drawn: random, latin_hypercube, sobol, or saltelli (for Sobol' indices).",
    ),
]
KeepOption = Annotated[
    list[str] | None,
    typer.Option(
        "--keep", help="What is kept of each case, such as member_tension, max(member_tension); repeatable."
    ),
]
TEndOption = Annotated[float | None, typer.Option("--t-end", help="simulate: simulated time [s].")]
SamplesOption = Annotated[
    int | None, typer.Option("--samples", help="simulate: number of equally spaced samples.")
]
MethodOption = Annotated[
    str | None, typer.Option("--method", help="simulate, equilibrium: method, as in the verb of this name.")
]
RtolOption = Annotated[float | None, typer.Option("--rtol", help="simulate: relative tolerance.")]
AtolOption = Annotated[float | None, typer.Option("--atol", help="simulate: absolute tolerance, m and m/s.")]
StepOption = Annotated[float | None, typer.Option("--step", help="simulate: step of fixed-step methods [s].")]
MaxStepsOption = Annotated[int | None, typer.Option("--max-steps", help="simulate: most steps of a motion.")]
ControlOption = Annotated[
    str | None,
    typer.Option(
        "--control",
        help="simulate: what the tolerance limits: steps, the default as for simulate --batch, or samples, "
        "as for one motion of simulate, which takes longer.",
    ),
]
ToleranceOption = Annotated[
    float | None,
    typer.Option("--tolerance", help="equilibrium: largest node residual, part of the largest member force."),
]
IterationsOption = Annotated[
    int | None, typer.Option("--max-iterations", help="equilibrium: most iterations of a search.")
]
SettleOption = Annotated[
    bool, typer.Option("--settle", help="linearize: about the equilibrium of each case, not its state.")
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Folder of results (.zarr); one that exists goes on where it stopped."),
]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", help="Processes on this machine; default: one a core.")
]
SchedulerOption = Annotated[
    str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, as tcp://10.0.0.1:8786.")
]
WaitOption = Annotated[
    float | None,
    typer.Option("--wait", help="Longest time to wait for the scheduler and its workers [s]; default: 30."),
]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Show the plan, and do nothing.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Allow more than 100,000 cases.")]
StopAfterOption = Annotated[
    int | None, typer.Option("--stop-after", help="Stop after so many cases that are not good.")
]
TaskSizeOption = Annotated[
    int | None, typer.Option("--task-size", help="Most cases of a task; default: chosen by their time.")
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="With --format: replace the table if it exists.")
]
FormatOption = Annotated[
    str | None,
    typer.Option("--format", help="Write the numbers of all cases as a table too: csv or parquet."),
]
