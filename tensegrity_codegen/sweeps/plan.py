"""The plan of a sweep, known before it starts: cases, libraries, tasks, time and size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout


@dataclass(frozen=True)
class Task:
    """Consecutive cases that one worker computes: one chunk of every array of results.

    number: place among the tasks, from 0; first, last: cases first to last - 1; groups: numbers of the groups
    that these cases belong to: one unless keys vary that change the library.
    """

    number: int
    first: int
    last: int
    groups: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of cases."""
        return self.last - self.first


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """Cases, groups of cases that share a library, and tasks.

    groups: cases by library.
    tasks: consecutive cases, boxes of a grid of cases (`CaseLayout`).
    task_size: largest number of cases of a task.
    seconds: estimated time on one core [s]; None if it was not measured.
    bytes: estimated size of the results before compression; None if unknown.
    """

    cases: Cases
    groups: tuple[CaseGroup, ...]
    tasks: tuple[Task, ...]
    task_size: int
    seconds: float | None = None
    bytes: int | None = None

    @property
    def layout(self) -> CaseLayout:
        """How the cases lie in stored arrays."""
        return CaseLayout.of(self.cases.shape, self.task_size)

    def find_rows(self, task: Task) -> tuple[tuple[CaseGroup, NDArray[np.int64]], ...]:
        """Return the groups of a task, each with the numbers of its cases in this task."""
        return tuple(
            (self.groups[number], self.groups[number].rows_between(task.first, task.last))
            for number in task.groups
        )


def divide_cases(cases: Cases, groups: tuple[CaseGroup, ...], task_size: int) -> tuple[Task, ...]:
    """Return tasks of at most `task_size` consecutive cases, boxes of the grid of cases (`CaseLayout`)."""
    layout = CaseLayout.of(cases.shape, task_size)
    ranges = [layout.cases_of(number) for number in range(layout.n_tasks)]
    return tuple(
        Task(
            number,
            first,
            last,
            tuple(group.number for group in groups if len(group.rows_between(first, last))),
        )
        for number, (first, last) in enumerate(ranges)
    )
