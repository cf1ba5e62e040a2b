"""Cases from a table: a CSV file with a column for each key and a row for each case."""

import hashlib
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.files.csv_table import make_row, read_lines
from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneSyntaxError,
    StructureError,
)

LARGEST_TABLE = 512 * 2**20  # bytes


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of values that a file states."""

    keys: tuple[str, ...]  # columns, which are keys of the scene
    rows: NDArray[np.float64] = field(repr=False)  # (count, n_keys) the values; read-only
    source: str = "table"  # the file, for messages

    method = "table"
    seed = None

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.rows)

    def values(self, first: int, last: int) -> NDArray[np.float64]:
        """Return rows first to last - 1, (last - first, n_keys)."""
        return self.rows[first:last]

    def describe(self) -> dict[str, Any]:
        """Return all that the rows follow from, as plain values: their hash, not the name of the file."""
        little = np.ascontiguousarray(self.rows.astype("<f8"))
        return {"method": "table", "n": self.count, "sha256": hashlib.sha256(little.data).hexdigest()}


def read_table(path: str | Path) -> Table:
    """Read a CSV file (commas, semicolons or tabs): a header with keys, then a row of numbers a case."""
    file = Path(path)
    lines = read_lines(read_text(file, LARGEST_TABLE, "a table of cases"), file)
    header_line = next(lines, None)
    if header_line is None:
        raise SceneSyntaxError("the file has no header", where=str(file), allowed="a CSV table")
    header = _read_header(header_line, file)
    numbers = array("d")
    for line, cells in lines:
        _add_row(numbers, line, cells, header, len(header_line[1]), file)
    if not numbers:
        raise StructureError("the table has no cases", where=str(file), allowed="a row below the header")
    rows = np.frombuffer(numbers, dtype=np.float64).reshape(-1, len(header))
    rows.flags.writeable = False
    return Table(tuple(header), rows, f"{file}: line {header_line[0]}")


def _read_header(line: tuple[int, list[str]], file: Path) -> list[str]:
    number, header = line[0], list(line[1])
    location = f"{file}: line {number}"
    while header and not header[-1]:
        header.pop()
    for column, name in enumerate(header, 1):
        if not name:
            problem, value = "a column without a name", f"column {column}"
            raise InvalidValueError(problem, where=location, given=value, allowed="a key of the scene")
        if header.count(name) > 1:
            problem = "a column appears twice"
            raise DuplicateNameError(problem, where=location, given=name, allowed="each column once")
    return header


def _add_row(
    numbers: "array[float]", line: int, cells: Sequence[str], header: list[str], width: int, file: Path
) -> None:
    """Add the numbers of a row; raises what `make_row` raises, with the place, for a cell that is none."""
    if len(cells) == len(header) and _add_plain(numbers, cells):
        return
    row = make_row(file, line, list(cells), header, width)
    for name in header:
        row.text(name)
        number = row.number(name)
        assert number is not None
        numbers.append(number)


def _add_plain(numbers: "array[float]", cells: Iterable[str]) -> bool:
    """Add cells that are finite numbers as people write them; return whether all are."""
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return False
    if not all(-1e308 < value < 1e308 for value in values) or "_" in "".join(cells):
        return False
    numbers.extend(values)
    return True


def build_table(rows: Any, keys: Sequence[str], where: str = "table") -> Table:
    """Return a table of values that Python has already, (count, n_keys)."""
    try:
        values = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.ndim != 2 or values.shape[1] != len(keys) or not len(values):
        problem = "not a table of numbers"
        raise InvalidValueError(problem, where=where, given=rows, allowed=f"rows of {len(keys)} numbers")
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        location, value = f"{where}: row {row}, column {keys[column]}", float(values[row, column])
        raise InvalidValueError("not a finite number", where=location, given=value, allowed="finite numbers")
    values.flags.writeable = False
    return Table(tuple(keys), values, where)


def to_table(table: Any, where: str = "table") -> Table:
    """Return a table given as a mapping of key to column, a pandas DataFrame, or a file."""
    if isinstance(table, Table):
        return table
    if isinstance(table, str | Path):
        return read_table(table)
    names = list(table.keys()) if hasattr(table, "keys") else []
    if not names or not all(isinstance(name, str) for name in names):
        allowed = "a CSV file, a dictionary of key and column, or a DataFrame with keys as columns"
        raise InvalidValueError("not a table", where=where, given=type(table).__name__, allowed=allowed)
    try:
        rows = np.stack([np.asarray(table[name], dtype=np.float64) for name in names], axis=1)
    except (TypeError, ValueError) as error:
        problem = f"columns that do not make a table: {error}"
        raise InvalidValueError(problem, where=where, allowed="numbers, equally many a key") from None
    return build_table(rows, names, where)
