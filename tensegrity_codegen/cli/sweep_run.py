"""Options of the verb `sweep`, in groups, and its run; options of operations are read from their modules."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.record import CaseAnalysis
    from tensegrity_codegen.sweeps.cases.cases import Cases
    from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
    from tensegrity_codegen.sweeps.run import SweepOutcome, SweepProgress
    from tensegrity_codegen.sweeps.sweep import PreparedSweep

KeepOption = Annotated[
    list[str] | None,
    typer.Option(
        "--keep", help="What is kept of each case, such as member_tension, max(member_tension); repeatable."
    ),
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="With --format: replace the table if it exists.")
]


@dataclass(frozen=True)
class CaseOptions:
    """Statements of the cases."""

    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            help="An axis of a grid: KEY=start:stop:n, KEY=start:stop:n:log or KEY=a,b,c; repeat for "
            "several.",
        ),
    ] = None
    sample: Annotated[
        list[str] | None,
        typer.Option(
            "--sample",
            help="A random number: KEY=normal(m,s), KEY=uniform(a,b) or KEY=lognormal(m,s); repeat for "
            "several.",
        ),
    ] = None
    table: Annotated[
        Path | None, typer.Option("--table", help="Cases from a file (.csv): a column a key, a row a case.")
    ] = None
    n: Annotated[int | None, typer.Option("--n", help="Number of samples (saltelli: base number).")] = None
    seed: Annotated[int, typer.Option("--seed", help="Seed of the samples.")] = 0
    sampling: Annotated[
        str,
        typer.Option(
            "--sampling",
            help="How samples are drawn: random, latin_hypercube, sobol, or saltelli (for Sobol' indices).",
        ),
    ] = "random"
    yes: Annotated[bool, typer.Option("--yes", help="Allow more than 100,000 cases.")] = False


@dataclass(frozen=True)
class ResultOptions:
    """Where results go, and whether they are computed."""

    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder of results (.zarr); one that exists goes on where it stopped."
        ),
    ] = None
    format: Annotated[
        str | None,
        typer.Option("--format", help="Write the numbers of all cases as a table too: csv or parquet."),
    ] = None
    overwrite: OverwriteOption = False
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the plan, and do nothing.")] = False


@dataclass(frozen=True)
class RunOptions:
    """Where and how far the cases are computed."""

    workers: Annotated[
        int | None, typer.Option("--workers", help="Processes on this machine; default: one a core.")
    ] = None
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Address of a Dask scheduler, as tcp://10.0.0.1:8786.")
    ] = None
    wait: Annotated[
        float | None,
        typer.Option(
            "--wait", help="Longest time to wait for the scheduler and its workers [s]; default: 30."
        ),
    ] = None
    task_size: Annotated[
        int | None, typer.Option("--task-size", help="Most cases of a task; default: chosen by their time.")
    ] = None
    stop_after: Annotated[
        int | None, typer.Option("--stop-after", help="Stop after so many cases that are not good.")
    ] = None


def list_operation_options() -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of --do, --keep and the options of all operations, by argument."""
    from tensegrity_codegen.analyses.cases.registry import ANALYSES

    listed = [(do, option) for do, kind in ANALYSES.items() for option in kind.list_sweep_options()]
    do = typer.Option("--do", help=f"What is done with each case: {', '.join(ANALYSES)}.", show_default=False)
    declarations: dict[str, tuple[Any, Any]] = {"do": (Annotated[str, do], ...), "keep": (KeepOption, None)}
    for name in dict.fromkeys(option.argument for _, option in listed):
        same = [(do, option) for do, option in listed if option.argument == name]
        helps = {
            description: [do for do, option in same if option.help == description]
            for description in (option.help for _, option in same)
        }
        help = "; ".join(f"{', '.join(by)}: {description}" for description, by in helps.items())
        declared: Any = typer.Option(name_option(name), help=help)
        option = same[0][1]
        kind: Any = bool if option.flag else option.kind | None
        declarations[name] = (Annotated[kind, declared], False if option.flag else None)
    return declarations


def name_option(argument: str) -> str:
    """Return the option of an argument."""
    return "--" + argument.replace("_", "-")


def read_operation_options(given: dict[str, Any]) -> dict[str, Any]:
    """Return the values of options by the names of their fields, None unless they are stated."""
    from tensegrity_codegen.analyses.cases.registry import ANALYSES

    stated: dict[str, Any] = {}
    for kind in ANALYSES.values():
        for option in kind.list_sweep_options():
            value = given[option.argument]
            stated[option.name] = value if option.flag is None else option.flag[1] if value else None
    return stated


# How messages of the cases name their options.
NAMES = {name: f"--{name}" for name in ("over", "sample", "table", "n", "seed", "sampling", "yes")}


@dataclass(frozen=True)
class SweepCall:
    """One call of the verb; options: of all operations, by their arguments."""

    scene: Path
    do: str
    keep: tuple[str, ...]
    options: dict[str, Any]
    cases: CaseOptions
    results: ResultOptions
    where: RunOptions

    def run(self, output: Output) -> bool:
        """Plan and run the sweep, and print how it ended; return whether some cases are good."""
        from tensegrity_codegen.analyses.cases.registry import build_analysis
        from tensegrity_codegen.sweeps.cases.build_cases import build_cases

        self._check()
        stated = self.cases
        cases = build_cases(
            stated.over or (), stated.sample or (), stated.table, n=stated.n, seed=stated.seed,
            method=stated.sampling, yes=stated.yes, options=NAMES,
        )  # fmt: skip
        self._check_options()
        operation = build_analysis(self.do, self.keep, **read_operation_options(self.options))
        output.load(self.scene, settles=self.do == "equilibrium", sags=True)
        prepared = self._prepare(cases, operation)
        if self.results.dry_run:
            planned = prepared.planned
            output.result({"status": "ok", **planned.describe()}, str(planned))
            return True
        output.aside.print(str(prepared.planned), markup=False, soft_wrap=True)
        with output.progress("sweeping") as move:
            outcome = self._run(output, prepared, move)
        if outcome.empty:
            output.warn(outcome.describe_empty())
        table = self._write_table(output)
        data = _describe_outcome(prepared, outcome) | {"table": None if table is None else str(table)}
        data["not_checked"] = operation.not_checked
        if operation.not_checked:
            output.note(operation.not_checked)
        written = [] if table is None else [f"wrote {table}"]
        output.result(data, *_list_lines(outcome, operation.name, table), *written)
        return outcome.good > 0

    def _check(self) -> None:
        """Check the options of files and engines before any work."""
        from tensegrity_codegen.sweeps.run import check_stop_after
        from tensegrity_codegen.sweeps.store.folder import check_store_name

        results = self.results
        if results.out is None and not results.dry_run:
            problem = "the folder of results is missing"
            raise InvalidValueError(problem, where="--out", allowed="a name that ends in .zarr; or --dry-run")
        if results.out is not None:
            check_store_name(results.out)
        self._find_workers()
        check_stop_after(self.where.stop_after)
        if results.overwrite and results.format is None:
            raise InvalidValueError(
                "nothing that could be replaced",
                where="--overwrite",
                allowed="with --format, for the table beside the folder",
                hint="a folder of results is never replaced: the same command goes on with it, and another "
                "sweep needs another name in --out",
            )
        if results.format is not None:
            from tensegrity_codegen.sweeps.store.table import check_table

            check_table(self._table, results.format, overwrite=results.overwrite)

    def _check_options(self) -> None:
        """Raise InvalidValueError for an option of another operation."""
        from tensegrity_codegen.analyses.cases.registry import ANALYSES

        check_choice(self.do, ANALYSES, "operation", "--do")
        valid_names = [option.argument for option in ANALYSES[self.do].list_sweep_options()]
        for name, value in self.options.items():
            if value not in (None, False) and name not in valid_names:
                problem = f"not an option of {self.do}"
                allowed = ", ".join(map(name_option, valid_names)) or "no options of this kind"
                raise InvalidValueError(problem, where=name_option(name), given=value, allowed=allowed)

    def _find_workers(self) -> "int | Cluster":
        """Return where the sweep runs; raises InvalidValueError for two places, or a wait for none."""
        from tensegrity_codegen.sweeps.engines.dask_engine import Cluster, check_wait, check_workers

        workers, scheduler, wait = self.where.workers, self.where.scheduler, self.where.wait
        if scheduler is not None and workers is not None:
            problem, allowed = "workers of this machine beside those of a cluster", "`workers` or `scheduler`"
            raise InvalidValueError(problem, where="workers", given=workers, allowed=allowed)
        if wait is not None and scheduler is None:
            check_wait(wait)
            problem = "a time to wait for a scheduler, and no scheduler"
            raise InvalidValueError(problem, where="wait", given=wait, allowed="with `scheduler`")
        if scheduler is None:
            return check_workers(workers)
        return check_workers(Cluster(scheduler) if wait is None else Cluster(scheduler, wait))

    @property
    def _table(self) -> Path:
        """The file of --format: the folder's name with another ending, beside it."""
        return (self.results.out or Path("sweep.zarr")).with_suffix(f".{self.results.format}")

    def _prepare(self, cases: "Cases", operation: "CaseAnalysis") -> "PreparedSweep":
        from tensegrity_codegen.sweeps.sweep import prepare_sweep

        return prepare_sweep(
            self.scene, cases, operation, out=self.results.out, workers=self._find_workers(),
            task_size=self.where.task_size, yes=self.cases.yes, option="--yes",
        )  # fmt: skip

    def _run(
        self, output: Output, prepared: "PreparedSweep", move: Callable[[float], None]
    ) -> "SweepOutcome":
        out = self.results.out
        assert out is not None
        try:
            return prepared.run(out, stop_after=self.where.stop_after, on_progress=_follow(output, move))
        except KeyboardInterrupt:
            note = f"{out} keeps what is finished; the same command goes on where it stopped"
            output.aside.print(note, markup=False, soft_wrap=True)
            raise

    def _write_table(self, output: Output) -> Path | None:
        out, format = self.results.out, self.results.format
        if format is None or out is None:
            return None
        from tensegrity_codegen.sweeps.store.table import write_sweep_table

        absent = write_sweep_table(out, self._table, format, overwrite=self.results.overwrite)
        if absent:
            output.warn(f"{self._table} has no columns for {', '.join(absent)}, which are no single numbers")
        return self._table


def _follow(output: Output, move: Callable[[float], None]) -> "Callable[[SweepProgress], None]":
    """Return a function that shows how far a sweep has come, with its rate and the cases that failed."""

    def show(state: "SweepProgress") -> None:
        failed = f", {state.failed:,} not good" if state.failed else ""
        rate = f", {state.rate:,.0f} cases/s" if state.computed else ""
        output.entitle(f"{state.finished:,} of {state.cases:,} cases{failed}{rate}")
        move(state.fraction)

    return show


def _describe_outcome(prepared: "PreparedSweep", outcome: "SweepOutcome") -> dict[str, Any]:
    """Return how a sweep ended, for JSON."""
    return {
        "status": "ok" if outcome.good else "failed",
        "out": str(outcome.path),
        "n_cases": outcome.cases,
        "n_finished": outcome.finished,
        "n_good": outcome.good,
        "n_not_good": outcome.failed,
        "n_computed": outcome.computed,
        "n_damaged": outcome.damaged,
        "n_beyond_limits": outcome.beyond,
        "counts": dict(outcome.counts),
        "first_messages": dict(outcome.first_message),
        "stopped": outcome.stopped,
        "cases_per_second": outcome.computed / outcome.seconds if outcome.seconds > 0.0 else 0.0,
        "plan": prepared.planned.describe(),
    }


def _list_lines(outcome: "SweepOutcome", operation: str, table: Path | None) -> list[str]:
    """Return how a sweep ended, for people."""
    from tensegrity_codegen.analyses.cases.quantities import BEYOND

    rows = [
        f"  {count:,} {status}{_first(outcome, status)}"
        for status, count in sorted(outcome.counts.items(), key=lambda item: -item[1])
    ]
    rate = f", {outcome.computed / outcome.seconds:,.0f} cases/s" if outcome.computed else ""
    n_stored = outcome.finished - outcome.computed
    before = f"; {n_stored:,} of them were there before" if n_stored else ""
    lines = [
        f"{outcome.good:,} of {outcome.cases:,} cases are good ({operation}{rate})" + before,
        *rows,
        f"wrote {outcome.path}; see: tensegrity-codegen sweep summary {outcome.path} -o page.html",
    ]
    if outcome.beyond:
        lines.insert(1, f"  in {outcome.beyond:,} of them {BEYOND} (limit_use above 1)")
    n_pending = outcome.cases - outcome.finished
    if outcome.damaged:
        lines.insert(1, f"  {outcome.damaged:,} of them were damaged in the folder, and were computed again")
    if n_pending:
        suffix = " with --overwrite" if table is not None else ""
        lines.insert(1, f"  {n_pending:,} not computed: the same command{suffix} goes on")
    return lines


def _first(outcome: "SweepOutcome", word: str) -> str:
    message = outcome.first_message.get(word)
    return f", first: {message}" if message else ""
