"""`tensegrity-codegen sweep`: many cases of one scene, on the cores of this machine or on a cluster."""

from typing import Any, ClassVar

import typer

from tensegrity_codegen.cli.options import JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.sub_commands import VerbWithSubCommands
from tensegrity_codegen.cli.sweep_case import case
from tensegrity_codegen.cli.sweep_options import (
    AtolOption,
    ControlOption,
    DoOption,
    DryRunOption,
    FormatOption,
    IterationsOption,
    KeepOption,
    MaxStepsOption,
    MethodOption,
    NumberOption,
    OutOption,
    OverOption,
    OverwriteOption,
    RtolOption,
    SampleOption,
    SamplesOption,
    SamplingOption,
    SchedulerOption,
    SeedOption,
    SettleOption,
    StepOption,
    StopAfterOption,
    TableOption,
    TaskSizeOption,
    TEndOption,
    ToleranceOption,
    WaitOption,
    WorkersOption,
    YesOption,
)
from tensegrity_codegen.cli.sweep_summary import summary
from tensegrity_codegen.cli.verb import Verb


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
