"""The run of the verb `sweep`: its options, its plan, the run itself and its report."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.sweep_options import (
    CaseOptions,
    ResultOptions,
    RunOptions,
    name_option,
    read_operation_options,
)
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.record import CaseAnalysis
    from tensegrity_codegen.sweeps.cases.cases import Cases
    from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
    from tensegrity_codegen.sweeps.run import SweepOutcome, SweepProgress
    from tensegrity_codegen.sweeps.sweep import PreparedSweep


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
        output.load(self.scene, settles=self.do == "equilibrium")
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
            raise InvalidValueError(
                "the folder of results is missing",
                where="--out",
                allowed="a name that ends in .zarr; or --dry-run",
            )
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
        known = [item.argument for item in ANALYSES[self.do].list_sweep_options()]
        for name, value in self.options.items():
            if value not in (None, False) and name not in known:
                raise InvalidValueError(
                    f"not an option of {self.do}",
                    where=name_option(name),
                    given=value,
                    allowed=", ".join(map(name_option, known)) or "no options of this kind",
                )

    def _find_workers(self) -> "int | Cluster":
        """Return where the sweep runs; raises InvalidValueError for two places, or a wait for none."""
        from tensegrity_codegen.sweeps.engines.dask_engine import Cluster, check_wait, check_workers

        workers, scheduler, wait = self.where.workers, self.where.scheduler, self.where.wait
        if scheduler is not None and workers is not None:
            raise InvalidValueError(
                "workers of this machine beside those of a cluster",
                where="workers",
                given=workers,
                allowed="`workers` or `scheduler`",
            )
        if wait is not None and scheduler is None:
            check_wait(wait)
            raise InvalidValueError(
                "a time to wait for a scheduler, and no scheduler",
                where="wait",
                given=wait,
                allowed="with `scheduler`",
            )
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
            text = f"{out} keeps what is finished; the same command goes on where it stopped"
            output.aside.print(text, markup=False, soft_wrap=True)
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
        f"  {count:,} {word}{_first(outcome, word)}"
        for word, count in sorted(outcome.counts.items(), key=lambda item: -item[1])
    ]
    rate = f", {outcome.computed / outcome.seconds:,.0f} cases/s" if outcome.computed else ""
    kept = outcome.finished - outcome.computed
    before = f"; {kept:,} of them were there before" if kept else ""
    lines = [
        f"{outcome.good:,} of {outcome.cases:,} cases are good ({operation}{rate})" + before,
        *rows,
        f"wrote {outcome.path}; see: tensegrity-codegen sweep summary {outcome.path} -o page.html",
    ]
    if outcome.beyond:
        lines.insert(1, f"  in {outcome.beyond:,} of them {BEYOND} (limit_use above 1)")
    left = outcome.cases - outcome.finished
    if outcome.damaged:
        lines.insert(1, f"  {outcome.damaged:,} of them were damaged in the folder, and were computed again")
    if left:
        more = " with --overwrite" if table is not None else ""
        lines.insert(1, f"  {left:,} not computed: the same command{more} goes on")
    return lines


def _first(outcome: "SweepOutcome", word: str) -> str:
    message = outcome.first_message.get(word)
    return f", first: {message}" if message else ""
