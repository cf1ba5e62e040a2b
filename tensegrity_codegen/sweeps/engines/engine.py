"""The loop over the tasks of a sweep, the same for processes of this machine and for a cluster.

An engine opens a place that takes tasks, a few at a time; results come back in any order. A task that fails
or whose worker ends is computed again; what fails twice is set aside. Where a worker's end takes the results
of others with it, all tasks under way are computed again one by one, so that the one that ends its worker is
alone when it does.
"""

import queue
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from tensegrity_codegen.analyses.cases.record import TaskResult
from tensegrity_codegen.sweeps.engines.work import SweepWork, set_task_aside
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.system.errors import TensegrityError

MOST_ATTEMPTS = 2  # a task that fails so many times is set aside
LOOK = 0.5  # [s] between two looks at the workers while no task ends
FINAL = "KilledWorker"  # of Dask, which has tried the task several times itself


@dataclass(frozen=True, eq=False)
class FinishedTask:
    """A task and its results.

    result: its results; seconds: time that a worker took for it [s]; facts: what else goes into the record of
    the task: attempts, and where it was computed.
    """

    task: Task
    result: TaskResult
    seconds: float
    facts: dict[str, Any] = field(default_factory=dict)


class Place(Protocol):
    """Where tasks are computed."""

    def submit(self, task: Task) -> Any:
        """Return the future of a task, whose result is (TaskResult, seconds, facts)."""

    def count(self) -> int:
        """Return how many tasks shall be under way; raises ClusterError where nobody computes any more."""

    def explain(self, error: Exception) -> str:
        """Return why a task has no result; raises ClusterError where no task will have one."""


class Engine(ABC):
    """What opens a place for the tasks of a sweep."""

    @abstractmethod
    def open(self, work: SweepWork, tasks: Sequence[Task]) -> AbstractContextManager[Place]:
        """Start the workers; leaving the context ends all that still runs."""

    @contextmanager
    def run(self, work: SweepWork, tasks: Sequence[Task]) -> Iterator[Iterator[FinishedTask]]:
        """Start the workers and give the results of the tasks as they end, each once, in any order.

        Errors of this package that a worker raises are raised here.
        """
        if not tasks:
            yield iter(())
            return
        with self.open(work, tasks) as place:
            yield _run_tasks(place, work, tasks)


def _run_tasks(place: Place, work: SweepWork, tasks: Sequence[Task]) -> Iterator[FinishedTask]:
    waiting, doubtful = deque(tasks), deque[Task]()
    running: dict[Any, Task] = {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    failed: Counter[int] = Counter()

    def submit(task: Task) -> None:
        future = place.submit(task)
        running[future] = task
        future.add_done_callback(ended.put)

    while waiting or doubtful or running:
        # Tasks that may have ended a worker run one by one, the others when these are done.
        most = place.count()
        if doubtful and not running:
            submit(doubtful.popleft())
        while waiting and not doubtful and len(running) < most and not _is_tried(running, failed):
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
            problem, is_final = place.explain(error), type(error).__name__ == FINAL
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
    return FinishedTask(task, set_task_aside(work, task, message), 0.0, facts)
