"""The layout of the cases of a sweep in stored arrays, and of its tasks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

LANES = 8  # a task is a whole number of these, which the batch functions compute side by side


@dataclass(frozen=True)
class CaseLayout:
    """A grid of cases, cut into boxes of consecutive cases: a task computes one box, a chunk stores it.

    The last axis varies fastest. A box spans the last axes as a whole, a part of the axis before them, and
    one place on each axis before that one; so its cases are consecutive, and chunks of stored arrays, which
    must lie on a regular grid, hold the cases of one task each.

    Attributes
    ----------
    shape : tuple of int
        Lengths of the axes.
    chunk : tuple of int
        Lengths of a box along the axes; boxes at the end of an axis may be shorter.

    Examples
    --------
    >>> from tensegrity_codegen.sweeps.cases.layout import CaseLayout
    >>> layout = CaseLayout.of((3, 10, 4), task_size=20)
    >>> layout.chunk, layout.n_tasks, layout.cases_of(3)
    ((1, 5, 4), 6, (60, 80))
    """

    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @classmethod
    def of(cls, shape: Sequence[int], task_size: int) -> "CaseLayout":
        """Return the layout whose tasks have at most `task_size` cases and are of about equal size."""
        chunk, inner = [1] * len(shape), 1
        for axis in reversed(range(len(shape))):
            if inner * shape[axis] > task_size:
                # Parts that are about equal and of whole lanes.
                n, limit = shape[axis], max(task_size // inner, 1)
                length = -(-n // -(-n // limit))
                rounded = -(-length // LANES) * LANES
                chunk[axis] = rounded if rounded <= limit else length
                break
            chunk[axis] = shape[axis]
            inner *= shape[axis]
        return cls(tuple(shape), tuple(chunk))

    @property
    def count(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    @property
    def grid(self) -> tuple[int, ...]:
        """Number of boxes along each axis."""
        return tuple(-(-n // c) for n, c in zip(self.shape, self.chunk, strict=True))

    @property
    def n_tasks(self) -> int:
        """Number of tasks."""
        return math.prod(self.grid)

    @property
    def task_size(self) -> int:
        """Number of cases of the largest task."""
        return math.prod(self.chunk)

    def place_of(self, task: int) -> tuple[int, ...]:
        """Return the place of a task's box on the grid of boxes; IndexError for no task."""
        if not 0 <= task < self.n_tasks:
            raise IndexError(task)
        position = []
        for n in reversed(self.grid):
            task, index = divmod(task, n)
            position.append(index)
        return tuple(reversed(position))

    def box_of(self, task: int) -> tuple[slice, ...]:
        """Return the box of a task, one slice an axis."""
        rows = zip(self.place_of(task), self.chunk, self.shape, strict=True)
        return tuple(slice(index * c, min((index + 1) * c, n)) for index, c, n in rows)

    def cases_of(self, task: int) -> tuple[int, int]:
        """Return the cases (first, last) of a task, which are first to last - 1."""
        start, stop = 0, 0
        for span, n in zip(self.box_of(task), self.shape, strict=True):
            start, stop = start * n + span.start, stop * n + span.stop - 1
        return start, stop + 1
