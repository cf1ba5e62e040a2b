"""Arrays as constant tables in C."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.codegen.print.printer import print_numbers
from tensegrity_codegen.control.embedded.knots import Knots
from tensegrity_codegen.tables.precision import Precision

UNLIMITED = {"double": 1e300, "single": 1e30}  # in place of infinite bounds
INT = "int"


@dataclass(frozen=True)
class Table:
    """A constant array: name, C type, entries as C text, comment; an empty one has a zero in its place."""

    name: str
    c_type: str
    values: list[str]
    comment: str


@dataclass(frozen=True)
class TablePrinter:
    """Prints arrays as C text."""

    precision: Precision

    def real(self, name: str, values: ArrayLike, comment: str) -> Table:
        """Return a table of numbers, row by row; infinite ones become very large."""
        most = UNLIMITED[self.precision.name]
        numbers = np.clip(np.asarray(values, dtype=np.float64).ravel(), -most, most)
        return Table(name, self.precision.c_type, print_numbers(numbers, self.precision, name), comment)

    def whole(self, name: str, values: ArrayLike, comment: str, c_type: str = INT) -> Table:
        """Return a table of whole numbers."""
        numbers = np.asarray(values, dtype=np.int64).ravel().tolist()
        return Table(name, c_type, list(map(str, numbers)) or ["0"], comment)

    def knots(self, time: str, rows: str, knots: Knots, comment: str) -> list[Table]:
        """Return the tables of the times of knots and of their rows."""
        return [self.real(time, knots.time, "times of the knots [s]"), self.real(rows, knots.row, comment)]
