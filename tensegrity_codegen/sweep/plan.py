"""What a sweep will do, known before it starts: cases, libraries, tasks, time and size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweep.apply.group import CaseGroup
from tensegrity_codegen.sweep.cases.cases import Cases

__all__ = ["SweepPlan", "Task", "divide_cases"]


@dataclass(frozen=True)
class Task:
    """Consecutive cases that one worker computes: one chunk of every array of results along ``case``.

    Attributes
    ----------
    number : int
        Place among the tasks, from 0.
    first, last : int
        Cases first to last - 1.
    groups : tuple of int
        Numbers of the groups that these cases belong to: one unless keys vary that change the library.
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

    Attributes
    ----------
    cases : Cases
        The cases.
    groups : tuple of CaseGroup
        Cases by library.
    tasks : tuple of Task
        Consecutive cases, all of equal number but the last.
    task_size : int
        Number of cases of a task.
    seconds : float or None
        Estimated time on one core [s]; None if it was not measured.
    bytes : int or None
        Estimated size of the results before compression; None if unknown.
    """

    cases: Cases
    groups: tuple[CaseGroup, ...]
    tasks: tuple[Task, ...]
    task_size: int
    seconds: float | None = None
    bytes: int | None = None

    def find_rows(self, task: Task) -> tuple[tuple[CaseGroup, NDArray[np.int64]], ...]:
        """Return the groups of a task, each with the numbers of its cases in this task."""
        return tuple(
            (self.groups[number], self.groups[number].rows_between(task.first, task.last))
            for number in task.groups
        )


def divide_cases(cases: Cases, groups: tuple[CaseGroup, ...], task_size: int) -> tuple[Task, ...]:
    """Return the tasks of equal numbers of consecutive cases, the last one shorter if need be."""
    firsts = range(0, cases.count, task_size)
    ranges = [(first, min(first + task_size, cases.count)) for first in firsts]
    return tuple(
        Task(
            number,
            first,
            last,
            tuple(group.number for group in groups if len(group.rows_between(first, last))),
        )
        for number, (first, last) in enumerate(ranges)
    )
