"""The interface of engines: each takes tasks and returns their results, each once, in any order."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol

from tensegrity_codegen.sweeps.engines.work import SweepWork
from tensegrity_codegen.sweeps.plan import Task
from tensegrity_codegen.sweeps.tasks.operation import TaskResult

MOST_ATTEMPTS = 2  # a task whose process ended so many times is set aside


@dataclass(frozen=True, eq=False)
class FinishedTask:
    """A task and its results.

    Attributes
    ----------
    task : Task
        The task.
    result : TaskResult
        Its results.
    seconds : float
        Time that a worker took for it [s].
    facts : dict
        What else goes into the record of the task: attempts, and where it was computed.
    """

    task: Task
    result: TaskResult
    seconds: float
    facts: dict[str, Any] = field(default_factory=dict)


class Engine(Protocol):
    """Where tasks run."""

    def run(self, work: SweepWork, tasks: Sequence[Task]) -> AbstractContextManager[Iterator[FinishedTask]]:
        """Start work on the tasks and give their results as they end.

        Leaving the context ends all that still runs. A task whose worker is killed runs again; one that ends
        two workers is set aside. Errors of this package that a worker raises are raised here.
        """
        ...
