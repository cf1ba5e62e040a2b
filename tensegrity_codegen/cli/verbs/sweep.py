"""`tensegrity-codegen sweep`: many cases of one scene, on the cores of this machine or on a cluster."""

from typing import Annotated, Any, ClassVar

import typer

from tensegrity_codegen.cli.option_groups import OptionGroup
from tensegrity_codegen.cli.options import JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.sweep_commands import case, summary
from tensegrity_codegen.cli.sweep_options import (
    CaseOptions,
    ResultOptions,
    RunOptions,
    list_operation_options,
)
from tensegrity_codegen.cli.verb import Verb, VerbWithSubCommands

OperationOptions = Annotated[dict[str, Any], OptionGroup(list_operation_options)]


class SweepCommand(VerbWithSubCommands):
    """The verb and its sub-commands."""

    sub_commands: ClassVar = {"summary": summary, "case": case}


def sweep(
    scene: SceneArgument,
    operation: OperationOptions,
    cases: CaseOptions,
    results: ResultOptions,
    where: RunOptions,
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

        do, keep = operation.pop("do"), tuple(operation.pop("keep") or ())
        if not SweepCall(scene, do, keep, operation, cases, results, where).run(output):
            raise typer.Exit(3)


VERB = Verb(sweep, order=410, command=SweepCommand)
