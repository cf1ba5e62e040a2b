"""Options of the verb `sweep`, in groups; those of operations are read from their modules."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

KeepOption = Annotated[
    list[str] | None,
    typer.Option(
        "--keep", help="What is kept of each case, such as member_tension, max(member_tension); repeatable."
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


@dataclass(frozen=True)
class CaseOptions:
    """What states the cases."""

    over: OverOption = None
    sample: SampleOption = None
    table: TableOption = None
    n: NumberOption = None
    seed: SeedOption = 0
    sampling: SamplingOption = "random"
    yes: YesOption = False


@dataclass(frozen=True)
class ResultOptions:
    """Where results go, and whether they are computed."""

    out: OutOption = None
    format: FormatOption = None
    overwrite: OverwriteOption = False
    dry_run: DryRunOption = False


@dataclass(frozen=True)
class RunOptions:
    """Where and how far the cases are computed."""

    workers: WorkersOption = None
    scheduler: SchedulerOption = None
    wait: WaitOption = None
    task_size: TaskSizeOption = None
    stop_after: StopAfterOption = None


def list_operation_options() -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of --do, --keep and the options of all operations, by argument."""
    from tensegrity_codegen.analyses.cases.registry import ANALYSES

    listed = [(do, item) for do, kind in ANALYSES.items() for item in kind.list_sweep_options()]
    do = typer.Option("--do", help=f"What is done with each case: {', '.join(ANALYSES)}.", show_default=False)
    found: dict[str, tuple[Any, Any]] = {"do": (Annotated[str, do], ...), "keep": (KeepOption, None)}
    for name in dict.fromkeys(item.argument for _, item in listed):
        same = [(do, item) for do, item in listed if item.argument == name]
        words = {
            text: [do for do, item in same if item.help == text] for text in (item.help for _, item in same)
        }
        help = "; ".join(f"{', '.join(by)}: {text}" for text, by in words.items())
        own: Any = typer.Option(name_option(name), help=help)
        item = same[0][1]
        kind: Any = bool if item.flag else item.kind | None
        found[name] = (Annotated[kind, own], False if item.flag else None)
    return found


def name_option(argument: str) -> str:
    """Return the option of an argument."""
    return "--" + argument.replace("_", "-")


def read_operation_options(given: dict[str, Any]) -> dict[str, Any]:
    """Return the values of options by the names of their fields, None where they are not stated."""
    from tensegrity_codegen.analyses.cases.registry import ANALYSES

    stated: dict[str, Any] = {}
    for kind in ANALYSES.values():
        for item in kind.list_sweep_options():
            value = given[item.argument]
            stated[item.name] = value if item.flag is None else item.flag[1] if value else None
    return stated
