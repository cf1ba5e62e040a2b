"""The cases of a sweep: which keys vary, and their values in each case."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.compilation.fingerprint import hash_text
from tensegrity_codegen.sweeps.cases.sampled import Sample
from tensegrity_codegen.sweeps.cases.table import Table
from tensegrity_codegen.system.errors import InvalidValueError

MOST_LISTED = 1000  # values of an axis that a description lists; of longer ones it has the hash


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a grid."""

    key: str  # path of the number in the scene, as ``"classes.cable.spring_constant"``
    values: NDArray[np.float64]  # (n_values,) its values, in order; read-only

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64).reshape(-1)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.values)


Points = Sample | Table  # rows of values of some keys, computed on demand


@dataclass(frozen=True, eq=False)
class Cases:
    """The cases of a sweep: each point of a grid with each row of a sample or table.

    The last axis varies fastest, and a sample or table faster than all axes, so that case number
    ``k * n_rows + i`` is row i at point k of the grid.

    Attributes
    ----------
    axes : tuple of Axis
        Axes of the grid, the slowest first; empty for a sample or table alone.
    points : Points or None
        A sample or a table; None for a grid alone.

    Examples
    --------
    >>> from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
    >>> cases = Cases((Axis("shape.height", [0.2, 0.3]), Axis("gravity[2]", [0.0, -9.81])))
    >>> cases.count, cases.values(1, 3).tolist()
    (4, [[0.2, -9.81], [0.3, 0.0]])
    """

    axes: tuple[Axis, ...] = ()
    points: Points | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys that vary: those of the grid, then those of the sample or table."""
        return (*(axis.key for axis in self.axes), *(self.points.keys if self.points else ()))

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes, then the number of rows of the sample or table, if there is one."""
        return (*map(len, self.axes), *([self.points.count] if self.points else []))

    @property
    def count(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    @property
    def method(self) -> str:
        """``"grid"``, or the method of the sample or table, also if a grid is combined with it."""
        return self.points.method if self.points else "grid"

    @property
    def seed(self) -> int | None:
        """Seed of the sample; None without one."""
        return self.points.seed if self.points else None

    def values(self, first: int = 0, last: int | None = None) -> NDArray[np.float64]:
        """Return the values of cases first to last - 1, by default all, (last - first, n_keys)."""
        last = self.count if last is None else last
        if not 0 <= first <= last <= self.count:
            problem, value = "not a range of cases", (first, last)
            raise InvalidValueError(problem, where="first, last", given=value, allowed=f"0 to {self.count}")
        return self.select(np.arange(first, last, dtype=np.int64))

    def select(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the values of the cases of these numbers, (n, n_keys)."""
        rows = self.points.count if self.points else 1
        result = np.empty((len(numbers), len(self.keys)))
        grid = numbers // rows
        for column, axis in reversed(list(enumerate(self.axes))):
            grid, index = np.divmod(grid, len(axis))
            result[:, column] = axis.values[index]
        if self.points is not None and len(numbers):
            result[:, len(self.axes) :] = _read_rows(self.points, numbers % rows)
        return result

    def describe(self) -> dict[str, Any]:
        """Return the sources of the cases as plain values: equal for equal sweeps, and for no others."""
        axes = [{"key": axis.key, "count": len(axis), **_describe_values(axis.values)} for axis in self.axes]
        points = {"points": self.points.describe()} if self.points else {}
        return {"method": self.method, "count": self.count, "keys": list(self.keys), "axes": axes, **points}


def _read_rows(points: Points, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return rows of a sample in any order, reading it in as few ranges as they span."""
    ends = np.flatnonzero(np.diff(rows) != 1) + 1
    pieces = np.split(rows, ends)
    return np.concatenate([points.values(int(piece[0]), int(piece[-1]) + 1) for piece in pieces])


def _describe_values(values: NDArray[np.float64]) -> dict[str, Any]:
    if len(values) <= MOST_LISTED:
        return {"values": values.tolist()}
    return {
        "first": float(values[0]),
        "last": float(values[-1]),
        "sha256": hash_text(*(value.hex() for value in values.tolist())),
    }
