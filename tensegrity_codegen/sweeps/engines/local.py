"""Tasks in processes of this machine, each of which may be killed at any moment."""

import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.sweeps.engines.engine import Engine
from tensegrity_codegen.sweeps.engines.work import Libraries, SweepWork, compute_task
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.forked import DEFERRED, can_fork, deferred_signals, end_process
from tensegrity_codegen.system.threads import limit_threads

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

    workers: number of processes; libraries: libraries of the groups of cases, built when they are first
    needed.
    """

    workers: int
    libraries: Libraries

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
    """A pool of processes, replaced by another one where a process has ended."""

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
