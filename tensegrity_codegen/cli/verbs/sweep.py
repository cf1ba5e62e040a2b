"""`tensegrity-codegen sweep`: many cases of one scene, on the cores of this machine or on a cluster."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.sweep_run import (
    CaseOptions,
    ResultOptions,
    RunOptions,
    list_operation_options,
    name_option,
)
from tensegrity_codegen.cli.verb import OptionGroup, Verb, VerbWithSubCommands, quote_command

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.record import CaseAnalysis
    from tensegrity_codegen.sweeps.summary.results import SweepResults


PROGRAM, INPUT = "tensegrity-codegen", "input."


def build_commands(results: "SweepResults", case: int) -> tuple[str, ...]:
    """Return the commands that write the scene of a case and run it alone."""
    from tensegrity_codegen.analyses.cases.record import SceneAnalysis
    from tensegrity_codegen.analyses.cases.registry import ANALYSES

    kind = ANALYSES.get(results.operation)
    file = f"case{case}.toml"
    write = [PROGRAM, "sweep", "case", str(results.path), str(case), "--out", file]
    keys = {
        key: repr(value) for key, value in zip(results.keys, results.key_values[case].tolist(), strict=True)
    }
    inputs = {key: text for key, text in keys.items() if key.startswith(INPUT)}
    words = [PROGRAM, results.operation, file, *_list_options(kind, results.options)]
    if kind is not None and issubclass(kind, SceneAnalysis):
        for key, text in inputs.items():
            words += ["--input", f"{key.removeprefix(INPUT)}={text}"]
    else:  # no verb: a sweep of one case, of the unchanged scene where that matters
        is_apart = kind is not None and kind.needs_scene
        scene, varied = file, inputs or dict(list(keys.items())[:1])
        if is_apart:
            scene, varied = results.scene_file or f"{results.scene}.toml", keys
        words = [PROGRAM, "sweep", scene, "--do", results.operation, *_list_options(kind, results.options)]
        for key, text in varied.items():
            words += ["--over", f"{key}={text}"]
        for text in results.keep:
            words += ["--keep", text]
        words += ["--out", f"case{case}.zarr"]
    return (shlex.join(write), shlex.join(words))


def _list_options(kind: "type[CaseAnalysis] | None", options: Mapping[str, Any]) -> list[str]:
    """Return the options of the operation as words of its verb."""
    words = []
    for option in () if kind is None else kind.list_sweep_options():
        value = options.get(option.name)
        if not option.in_verb or value in (None, ""):
            continue
        if option.flag is None:
            words += [name_option(option.name), repr(value) if isinstance(value, float) else str(value)]
        elif value == option.flag[1]:
            words.append(name_option(option.argument))
    return words


SweepArgument = Annotated[
    Path, typer.Argument(metavar="FILE.zarr", help="Folder that sweep wrote.", show_default=False)
]
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
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.sweeps.summary.results import build_case_scene, check_case, read_results

        check_result(out, ".toml", overwrite=overwrite)
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


ResultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--result",
        help="Result to describe: NAME, NAME[PART,...], NAME[max]; repeatable. Default: the first four.",
    ),
]
OverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--over", help="Key to draw results over; repeat for several. Default: those that matter most."
    ),
]
PageOption = Annotated[Path | None, typer.Option("--out", "-o", help="Write a page (.html).")]


def summary(
    file: SweepArgument,
    result: ResultOption = None,
    over: OverOption = None,
    out: PageOption = None,
    overwrite: OverwriteOption = False,
    *,
    printing: PrintOptions,
) -> None:
    """Summarize a sweep: how cases ended, distributions, what results depend on, worst cases.

    A quantity with dimensions needs a part for each: a label, a place from 0 on, or max, min, mean; one of
    these three alone is over all dimensions. A sweep that is not finished has a summary too.

    Example: tensegrity-codegen sweep summary loads.zarr --result 'member_tension[max]' -o loads.html
    """
    output = Output(printing.json, printing.all)
    with output.guard():
        check_result(out, ".html", overwrite=overwrite, draws=True)
        from tensegrity_codegen.sweeps.summary.finding import describe_finding, list_tables
        from tensegrity_codegen.sweeps.summary.results import read_results
        from tensegrity_codegen.sweeps.summary.summary import summarize

        data = summarize(read_results(file), result or (), over or (), build_commands)
        if out is not None:
            from tensegrity_codegen.report.pages.page import write_page
            from tensegrity_codegen.sweeps.summary.summary_page import build_summary_page

            write_page(build_summary_page(data, quote_command()), out, overwrite=overwrite)
        written = [] if out is None else [f"wrote {out}"]
        output.result(
            {"status": "ok", **data.as_dict(), "out": None if out is None else str(out)},
            describe_finding(data),
            *list_tables(data),
            *written,
        )


OperationOptions = Annotated[dict[str, Any], OptionGroup(list_operation_options)]


class SweepCommand(VerbWithSubCommands):
    """The verb and its sub-commands."""

    sub_commands: ClassVar = {"summary": summary, "case": case}

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Read the words after the verb; gusts, an option of `control`, are keys here."""
        if any(word.partition("=")[0] == "--gust" for word in args):
            problem = "gusts are keys: --over 'gust.NODE[axis]=0:5:6', gust_time.start, gust_time.duration"
            raise typer.BadParameter(problem, param_hint="--gust")
        return super().make_context(info_name, args, parent, **extra)


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
