"""Run a plan: compute unfinished tasks, and store each task once; its progress and outcome."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.record import LIMIT_USE
from tensegrity_codegen.analyses.cases.statuses import GOOD, STATUSES
from tensegrity_codegen.sweeps.engines.engine import Engine, FinishedTask
from tensegrity_codegen.sweeps.engines.work import SweepWork
from tensegrity_codegen.sweeps.store.folder import (
    check_same_sweep,
    check_store_folder,
    find_finished,
    locked_store,
)
from tensegrity_codegen.sweeps.store.store import StoreContents, SweepStore, create_store, restore_coordinates
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.extras import SWEEP, import_extra


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep has come."""

    cases: int  # number of cases
    finished: int  # how many are finished, those of earlier runs too
    computed: int  # how many this run has computed
    failed: int  # how many of all that are finished are not good
    seconds: float  # time since this run began to compute [s]

    @property
    def fraction(self) -> float:
        """Fraction of all cases that is finished."""
        return self.finished / self.cases

    @property
    def rate(self) -> float:
        """Cases a second of this run; 0 before the first."""
        return self.computed / self.seconds if self.seconds > 0.0 else 0.0


ShowProgress = Callable[[SweepProgress], None]


@dataclass(frozen=True)
class SweepOutcome:
    """How a run of a sweep ended.

    first_message: the first message of each status that this run met and that is not good; stopped:
    whether it ended before all cases were finished, since as many failed as `stop_after` says; beyond:
    number of cases whose members buckle or exceed a limit: `limit_use` above 1, where it is kept.
    """

    path: Path  # the folder with the results
    cases: int  # number of cases
    counts: Mapping[str, int]  # how many finished cases have each status
    first_message: Mapping[str, str]
    computed: int  # how many cases this run has computed
    seconds: float  # time that this run took [s]
    damaged: int = 0  # how many of these were in the folder before, but damaged or incomplete
    stopped: bool = False
    beyond: int = 0
    empty: tuple[str, ...] = ()  # results that were asked for by `keep` and are NaN in every finished case

    def describe_empty(self) -> str:
        """Return a warning of results that are NaN in every finished case, "" without any."""
        names = ", ".join(self.empty)
        return f"every value of {names} is NaN: these cases do not have what `keep` asks for" if names else ""

    @property
    def finished(self) -> int:
        """Number of finished cases."""
        return sum(self.counts.values())

    @property
    def good(self) -> int:
        """Number of cases whose results are there."""
        return sum(count for status, count in self.counts.items() if status in GOOD)

    @property
    def failed(self) -> int:
        """Number of finished cases that are not good."""
        return self.finished - self.good


def run_sweep(
    work: SweepWork,
    out: str | Path,
    engine: Engine,
    *,
    identity: Mapping[str, Any],
    facts: Mapping[str, Any],
    stop_after: int | None = None,
    on_progress: ShowProgress | None = None,
) -> SweepOutcome:
    """Compute the unfinished tasks of a folder of this identity; stop_after counts earlier failures too."""
    check_stop_after(stop_after)
    check_zarr()
    started = time.monotonic()
    with locked_store(out):
        stored = check_store_folder(out)
        if stored is not None:
            check_same_sweep(out, stored.identity, identity)
        finished = find_finished(out)
        todo = [task for task in work.plan.tasks if task.number not in finished]
        # Processes are forked before Zarr is loaded, which starts threads.
        with engine.run(work, todo) as stream:
            contents = StoreContents(work.plan.cases, work.plan.layout, work.outputs, identity, facts)
            if stored is None:
                create_store(out, contents)
            else:
                restore_coordinates(stored, contents)
            run = _Run(work.plan.cases.count, SweepStore(out), finished, stop_after, on_progress)
            run.consume(stream)
    outcome = run.outcome(Path(out), time.monotonic() - started)
    names = [output.name for output in work.outputs if outcome.good and work.operation.keep]
    empty = tuple(name for name in names if run.store.is_empty(name))
    return replace(outcome, beyond=run.store.count_above(LIMIT_USE), empty=empty)


@dataclass(eq=False)
class _Run:
    """One run of a sweep, with counts of its stored tasks."""

    cases: int
    store: SweepStore
    earlier: frozenset[int]
    stop_after: int | None
    on_progress: ShowProgress | None
    counts: Counter[str] = field(default_factory=Counter)
    first_message: dict[str, str] = field(default_factory=dict)
    computed: int = 0
    damaged: int = 0
    stopped: bool = False

    def __post_init__(self) -> None:
        for code, count in self.store.count_statuses(self.earlier).items():
            self.counts[STATUSES[code]] += count

    def consume(self, stream: Iterator[FinishedTask]) -> None:
        """Store tasks until all are finished, or too many cases have failed."""
        started = time.monotonic()
        self._show(0.0)
        if self._has_failed_enough():
            return
        for finished in stream:
            self._store(finished)
            self._show(time.monotonic() - started)
            if self._has_failed_enough():
                return

    def outcome(self, path: Path, seconds: float) -> SweepOutcome:
        """Return how the run ended."""
        counts = dict(sorted(self.counts.items()))
        return SweepOutcome(
            path, self.cases, counts, self.first_message, self.computed, seconds, self.damaged, self.stopped
        )

    def _store(self, finished: FinishedTask) -> None:
        result = finished.result
        self.damaged += finished.task.count if self.store.has_record(finished.task.number) else 0
        self.store.write(finished.task.number, result, {"seconds": finished.seconds, **finished.facts})
        self.computed += finished.task.count
        codes, indices, numbers = np.unique(result.status, return_index=True, return_counts=True)
        for code, index, number in zip(codes.tolist(), indices.tolist(), numbers.tolist(), strict=True):
            status = STATUSES[code]
            self.counts[status] += number
            if not result.is_good[index]:
                self.first_message.setdefault(status, result.messages[index])

    def _progress(self, seconds: float) -> SweepProgress:
        state = self.outcome(self.store.path, seconds)
        return SweepProgress(self.cases, state.finished, self.computed, state.failed, seconds)

    def _show(self, seconds: float) -> None:
        if self.on_progress is not None:
            self.on_progress(self._progress(seconds))

    def _has_failed_enough(self) -> bool:
        state = self._progress(0.0)
        if self.stop_after is not None and state.failed >= self.stop_after:
            self.stopped = state.finished < self.cases
            return self.stopped
        return False


def check_stop_after(stop_after: Any) -> None:
    """Raise InvalidValueError unless this is a number of failed cases."""
    if stop_after is not None:
        check_whole(stop_after, "stop_after", 1, problem="not a number of cases")


def check_zarr() -> None:
    """Raise MissingExtraError if results could not be stored; nothing is loaded yet."""
    import importlib.util

    if importlib.util.find_spec("zarr") is None:
        import_extra("zarr", SWEEP)
