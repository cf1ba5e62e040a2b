"""`tensegrity-codegen sweep`: many cases of one scene, on the cores of this machine or on a cluster."""

from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from tensegrity_codegen.cli.options import JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.sweep_commands import case, summary
from tensegrity_codegen.cli.verb import Verb, VerbWithSubCommands

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


class SweepCommand(VerbWithSubCommands):
    """The verb and its sub-commands."""

    sub_commands: ClassVar = {"summary": summary, "case": case}


def sweep(
    scene: SceneArgument,
    do: DoOption,
    over: OverOption = None,
    sample: SampleOption = None,
    table: TableOption = None,
    n: NumberOption = None,
    seed: SeedOption = 0,
    sampling: SamplingOption = "random",
    keep: KeepOption = None,
    t_end: TEndOption = None,
    samples: SamplesOption = None,
    method: MethodOption = None,
    step: StepOption = None,
    rtol: RtolOption = None,
    atol: AtolOption = None,
    max_steps: MaxStepsOption = None,
    control: ControlOption = None,
    tolerance: ToleranceOption = None,
    max_iterations: IterationsOption = None,
    settle: SettleOption = False,
    out: OutOption = None,
    format: FormatOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    wait: WaitOption = None,
    task_size: TaskSizeOption = None,
    stop_after: StopAfterOption = None,
    dry_run: DryRunOption = False,
    yes: YesOption = False,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Compute many cases of one scene, and store their results in a folder.

    KEY is a number of the scene by its path: classes.cable.spring_constant, shape.height, loads[0].force[2],
    gravity[2], nodes.n3.position[1]; of the assembled structure: rest_length.bar1, node_load.t1[2],
    node_velocity.t1[0]; or input.NAME. Each point of the grid of all --over is combined with each row of the
    sample or table. One library serves all cases that differ in numbers only.

    A case that does not converge is a row with its status. The same command again goes on where it stopped.
    Exit code 0 also where some cases are not good, 3 where none is.

    Example: tensegrity-codegen sweep prism.toml --do equilibrium --over 'gravity[2]=-20:0:101' --out g.zarr
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.cli.sweep_run import SweepCall

        options: dict[str, Any] = {
            "t_end": t_end, "samples": samples, "method": method, "step": step, "rtol": rtol, "atol": atol,
            "max_steps": max_steps, "control": control, "tolerance": tolerance,
            "max_iterations": max_iterations, "about": "equilibrium" if settle else None,
        }  # fmt: skip
        cases: dict[str, Any] = {
            "over": over or (), "sample": sample or (), "table": table, "n": n, "seed": seed,
            "method": sampling,
        }  # fmt: skip
        call = SweepCall(
            scene, do, tuple(keep or ()), options, cases, out, format, workers, scheduler, wait, task_size,
            stop_after, yes, overwrite,
        )  # fmt: skip
        if not call.run(output, dry_run=dry_run):
            raise typer.Exit(3)


VERB = Verb(sweep, order=410, command=SweepCommand)
