"""The loop over the tasks of a sweep, the same for processes of this machine and for a cluster.

An engine opens a place that takes tasks, a few at a time; results come back in any order. A task that fails
or whose worker ends is computed again; what fails twice is set aside. Where a worker's end takes the results
of others with it, all tasks under way are computed again one by one, so that the one that ends its worker is
alone when it does.
"""

import multiprocessing
import os
import queue
import signal
import threading
import time
import warnings
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

from tensegrity_codegen.analyses.cases.record import TaskResult
from tensegrity_codegen.sweeps.engines.work import (
    Libraries,
    SweepWork,
    Task,
    build_empty_result,
    compute_task,
)
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.forked import DEFERRED, can_fork, deferred_signals, end_process
from tensegrity_codegen.system.threads import limit_threads

MOST_ATTEMPTS = 2  # a task that fails so many times is set aside
LOOK = 0.5  # [s] between two looks at the workers while no task ends
FINAL = "KilledWorker"  # of Dask, which has tried the task several times itself


@dataclass(frozen=True, eq=False)
class FinishedTask:
    """A task and its results.

    facts: what else goes into the record of the task: attempts, and where it was computed.
    """

    task: Task
    result: TaskResult  # its results
    seconds: float  # time that a worker took for it [s]
    facts: dict[str, Any] = field(default_factory=dict)


class Place(Protocol):
    """A place that computes tasks."""

    def submit(self, task: Task) -> Any:
        """Return the future of a task, whose result is (TaskResult, seconds, facts)."""

    def count(self) -> int:
        """Return how many tasks shall be under way; raises ClusterError where nobody computes any more."""

    def explain(self, error: Exception) -> str:
        """Return why a task has no result; raises ClusterError where no task will have one."""


class Engine(ABC):
    """A factory of places for the tasks of a sweep."""

    @abstractmethod
    def open(self, work: SweepWork, tasks: Sequence[Task]) -> AbstractContextManager[Place]:
        """Start the workers; leaving the context ends all that still runs."""

    @contextmanager
    def run(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator[Iterator[FinishedTask]]:
        """Start the workers and give the results of the tasks as they end; raises what a worker raises."""
        if not tasks:
            yield iter(())
            return
        with self.open(work, tasks) as workers:
            yield _run_tasks(workers, work, tasks)


def _run_tasks(workers: Place, work: SweepWork, tasks: Sequence[Task]) -> Iterator[FinishedTask]:
    waiting, doubtful = deque(tasks), deque[Task]()
    running: dict[Any, Task] = {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    failed: Counter[int] = Counter()

    def submit(task: Task) -> None:
        future = workers.submit(task)
        running[future] = task
        future.add_done_callback(ended.put)

    while waiting or doubtful or running:
        # Tasks that may have ended a worker run one by one, the others when these are done.
        limit = workers.count()
        if doubtful and not running:
            submit(doubtful.popleft())
        while waiting and not doubtful and len(running) < limit and not _is_tried(running, failed):
            submit(waiting.popleft())
        try:
            future = ended.get(timeout=LOOK)
        except queue.Empty:
            continue
        task = running.pop(future)
        try:
            result, seconds, facts = future.result()
        except TensegrityError:
            raise
        except Exception as error:
            failed[task.number] += 1
            problem, is_final = workers.explain(error), type(error).__name__ == FINAL
            if failed[task.number] < MOST_ATTEMPTS and not is_final:
                (doubtful if isinstance(error, BrokenExecutor) else waiting).appendleft(task)
                continue
            yield _set_aside(work, task, problem, failed[task.number])
        else:
            yield FinishedTask(task, result, seconds, {"attempts": failed[task.number] + 1, **facts})


def _is_tried(running: dict[Any, Task], failed: Counter[int]) -> bool:
    """Return whether a task is computed again."""
    return any(failed[task.number] for task in running.values())


def _set_aside(work: SweepWork, task: Task, problem: str, attempts: int) -> FinishedTask:
    times = f"{attempts} times" if attempts > 1 else "several times"
    message = f"its task was computed {times} without a result: {problem}"
    facts = {"attempts": attempts, "problem": problem}
    return FinishedTask(task, build_empty_result(work, task, "set_aside", message), 0.0, facts)


AHEAD = 2  # tasks that a worker has at a time: the next is there when it has sent a result
END_TIME = 1.0  # [s] for which the end of processes is awaited, once one of them has ended
_served: list[tuple[SweepWork, Libraries]] = []  # of this process, which is a worker


class TaskError(Exception):
    """An error that is none of this package, as a text, so that any process can read it."""


@dataclass(frozen=True)
class LocalEngine(Engine):
    """Processes of this machine.

    Processes are forked where the system can do that, so that they have the libraries that are loaded;
    elsewhere they start anew and load them from the cache.
    """

    workers: int  # number of processes
    libraries: Libraries  # libraries of the groups of cases, built when they are first needed

    @contextmanager
    def open(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator["_Pool"]:
        """Start the processes; see `Engine.open`."""
        pool = _Pool(min(self.workers, len(tasks)), (work, self.libraries))
        try:
            pool.start()
            yield pool
        finally:
            pool.end()


class _Pool:
    """A pool of processes, replaced by another one once a process has ended."""

    def __init__(self, workers: int, served: tuple[SweepWork, Libraries]) -> None:
        self.workers, self.served = workers, served
        self.executor: ProcessPoolExecutor | None = None
        self.processes: dict[int, Any] = {}

    def start(self) -> None:
        """Start the processes: all at once where they are forked, before other threads are there."""
        context: Any = multiprocessing.get_context("fork" if can_fork() else "spawn")
        self.executor = ProcessPoolExecutor(self.workers, context, _begin, self.served)
        self._submit(os.getpid)

    def submit(self, task: Task) -> "Future[Any]":
        """Return the future of a task; see `Place`."""
        try:
            return self._submit(_compute, task.number)
        except BrokenExecutor:
            self.end()
            self.start()
            return self._submit(_compute, task.number)

    def count(self) -> int:
        """Return how many tasks shall be under way."""
        return AHEAD * self.workers

    def explain(self, error: Exception) -> str:
        """Return why a task has no result: its error, or how its process ended."""
        if not isinstance(error, BrokenExecutor):
            return str(error)[:500]
        for process in self.processes.values():  # all end where one has ended, but not at once
            process.join(END_TIME)
        codes = [process.exitcode for process in self.processes.values()]
        ended = [code for code in codes if code not in (None, 0, -signal.SIGTERM)]  # SIGTERM: of the others
        for code in ended:
            with suppress(ValueError):
                return f"its process was ended by {signal.Signals(-code).name}"
        return f"its process ended with code {ended[0]}" if ended else "its process was ended by SIGTERM"

    def end(self) -> None:
        """End all processes."""
        for process in self.processes.values():
            end_process(process)
        if self.executor is not None:
            self.executor.shutdown(wait=True, cancel_futures=True)
        self.processes.clear()

    def _submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        assert self.executor is not None
        with warnings.catch_warnings(), deferred_signals():
            warnings.simplefilter("ignore")  # of fork beside threads, which the process does not use
            future = self.executor.submit(function, *arguments)
            self.processes.update(self.executor._processes or {})
        return future


def _begin(work: SweepWork, libraries: Libraries) -> None:
    """Make this process a worker, which ends with its parent."""
    if os.name == "posix":
        os.setpgid(0, 0)  # Ctrl-C reaches the parent alone, which ends this process and all that it started
    for number in DEFERRED:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    limit_threads()
    _served[:] = [(work, libraries)]


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _compute(number: int) -> tuple[Any, float, dict[str, Any]]:
    """Return the results of a task, and the time that it took."""
    work, libraries = _served[0]
    started = time.perf_counter()
    try:
        result = compute_task(work, work.plan.tasks[number], libraries.load)
    except TensegrityError:
        raise
    except Exception as error:
        raise TaskError(f"{type(error).__name__}: {error}"[:500]) from None
    return result, time.perf_counter() - started, {}
