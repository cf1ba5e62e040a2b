"""Tasks in processes of this machine, each of which may be killed at any moment."""

import multiprocessing
import os
import signal
import time
import warnings
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any

from tensegrity_codegen.sweeps.engines.engine import MOST_ATTEMPTS, FinishedTask
from tensegrity_codegen.sweeps.engines.threads import limit_threads
from tensegrity_codegen.sweeps.engines.work import Libraries, SweepWork, compute_task, set_task_aside
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.forked import DEFERRED, can_fork, deferred_signals, end_process

LOOK = 0.5  # [s] between two looks at signals
AHEAD = 2  # tasks that a worker has at a time: the next is there when it has sent a result


@dataclass(frozen=True)
class LocalEngine:
    """Processes of this machine.

    Processes are forked where the system can do that, so that they have the libraries that are loaded;
    elsewhere they start anew and load them from the cache.

    Attributes
    ----------
    workers : int
        Number of processes.
    libraries : Libraries
        Libraries of the groups of cases, built when they are first needed.
    """

    workers: int
    libraries: Libraries

    @contextmanager
    def run(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator[Iterator[FinishedTask]]:
        """Start the processes; see `Engine.run`."""
        pool = _Pool(work, self.libraries, tasks)
        try:
            for _ in range(min(self.workers, len(tasks))):
                pool.start_worker()
            yield pool.results()
        finally:
            pool.end()


@dataclass(eq=False)
class _Worker:
    """A process, the end of its pipe, and the tasks that it has; it works on the first of them."""

    process: Any
    connection: Connection
    tasks: deque[Task] = field(default_factory=deque)


class _Pool:
    """The processes of one sweep."""

    def __init__(self, work: SweepWork, libraries: Libraries, tasks: Sequence[Task]) -> None:
        self.work, self.libraries = work, libraries
        self.waiting = deque(tasks)
        self.workers: list[_Worker] = []
        self.ended: Counter[int] = Counter()  # how many processes ended while they worked on a task
        self.problem: dict[int, str] = {}

    def start_worker(self) -> None:
        """Start a process and give it tasks."""
        context: Any = multiprocessing.get_context("fork" if can_fork() else "spawn")
        here, there = context.Pipe()
        # A forked process has the ends of all pipes; a pipe ends when all processes have closed it.
        inherited = [here, *(worker.connection for worker in self.workers)] if can_fork() else []
        process = context.Process(
            target=_serve, args=(self.work, self.libraries, there, inherited), daemon=True
        )
        with warnings.catch_warnings(), deferred_signals():
            warnings.simplefilter("ignore")  # of fork beside threads, which the process does not use
            process.start()
        there.close()
        worker = _Worker(process, here)
        self.workers.append(worker)
        self._feed(worker)

    def results(self) -> Generator[FinishedTask, None, None]:
        """Give the results of all tasks as they end."""
        while self.workers and (self.waiting or any(worker.tasks for worker in self.workers)):
            ready = wait([worker.connection for worker in self.workers], LOOK)
            for worker in [item for item in self.workers if item.connection in ready]:
                finished = self._receive(worker)
                if finished is not None:
                    yield finished

    def end(self) -> None:
        """End all processes."""
        for worker in self.workers:
            end_process(worker.process)
            worker.connection.close()
        self.workers.clear()

    def _feed(self, worker: _Worker) -> None:
        """Give a worker its next tasks; near the end each gets one at a time."""
        most = AHEAD if len(self.waiting) > AHEAD * len(self.workers) else 1
        while self.waiting and len(worker.tasks) < most:
            task = self.waiting.popleft()
            worker.tasks.append(task)
            with suppress(OSError):  # it has ended, which is noticed when its results are awaited
                worker.connection.send(task.number)

    def _receive(self, worker: _Worker) -> FinishedTask | None:
        try:
            result, seconds, problem = worker.connection.recv()
        except (EOFError, OSError, ValueError):
            return self._replace(worker)
        task = worker.tasks.popleft()
        if isinstance(problem, TensegrityError):
            raise problem
        finished = self._give_up_or_repeat(task, problem) if problem else None
        if not problem:
            finished = FinishedTask(task, result, seconds, {"attempts": self.ended[task.number] + 1})
        self._feed(worker)
        return finished

    def _replace(self, worker: _Worker) -> FinishedTask | None:
        """Start another process for one that has ended; the task that it worked on has had an attempt."""
        end_process(worker.process)
        worker.connection.close()
        self.workers.remove(worker)
        tasks, finished = list(worker.tasks), None
        self.waiting.extendleft(reversed(tasks[1:]))
        if tasks:
            finished = self._give_up_or_repeat(tasks[0], _describe_end(worker.process.exitcode))
        if self.waiting:
            self.start_worker()
        return finished

    def _give_up_or_repeat(self, task: Task, problem: str) -> FinishedTask | None:
        self.ended[task.number] += 1
        if self.ended[task.number] < MOST_ATTEMPTS:
            self.waiting.appendleft(task)
            return None
        message = f"its task was computed {MOST_ATTEMPTS} times without a result: {problem}"
        facts = {"attempts": MOST_ATTEMPTS, "problem": problem}
        return FinishedTask(task, set_task_aside(self.work, task, message), 0.0, facts)


def _describe_end(code: int | None) -> str:
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"its process was ended by {signal.Signals(-code).name}"
    return f"its process ended with code {code}"


def _serve(
    work: SweepWork, libraries: Libraries, connection: Connection, inherited: list[Connection]
) -> None:
    """Compute tasks by their numbers until the other end of the pipe is closed."""
    for other in inherited:
        other.close()
    if os.name == "posix":
        os.setpgid(0, 0)  # Ctrl-C reaches the parent alone, which ends this process and all that it started
    for number in DEFERRED:
        signal.signal(number, signal.SIG_IGN)
    limit_threads()
    with suppress(EOFError, OSError):  # the parent is gone
        while True:
            task = work.plan.tasks[connection.recv()]
            connection.send(_try(work, task, libraries))


def _try(work: SweepWork, task: Task, libraries: Libraries) -> tuple[Any, float, Any]:
    started = time.perf_counter()
    try:
        result = compute_task(work, task, libraries.load)
    except TensegrityError as error:
        return None, 0.0, error
    except Exception as error:
        return None, 0.0, f"{type(error).__name__}: {error}"[:500]
    return result, time.perf_counter() - started, None
