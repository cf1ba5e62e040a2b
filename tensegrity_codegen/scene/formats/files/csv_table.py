"""A table in a CSV file as people and spreadsheets write it: header, cells, and their lines and columns.

Accepted: byte-order mark, CRLF, spaces around cells, quoted cells, blank lines, trailing empty columns, and
`,`, `;` or tab as separator (the one that the header uses). Decimal commas are read where cells are separated
by something else and no number of the table has a decimal point.
"""

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES
from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.scene.names import unknown_key
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneSyntaxError,
)

MAX_TABLE_BYTES = 64 * 2**20  # bytes
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(_NUMBER.pattern.replace("\\.", ","))


@dataclass(frozen=True)
class Row:
    """One row of a table: cells by column name, stripped, "" if absent; decimal_comma: in its numbers."""

    path: Path
    line: int
    cells: dict[str, str]
    decimal_comma: bool = False

    def where(self, column: str = "") -> str:
        """Return the place of a cell for messages."""
        return f"{self.path}: line {self.line}" + (f", column {column}" if column else "")

    def text(self, column: str) -> str:
        """Return a cell that must not be empty; raises InvalidValueError."""
        value = self.cells.get(column, "")
        if not value:
            raise InvalidValueError("the cell is empty", where=self.where(column), allowed="a value")
        return value

    def number(self, column: str) -> float | None:
        """Return a cell as a number, None if it is empty."""
        value = self.cells.get(column, "")
        if not value:
            return None
        if self.decimal_comma and _COMMA_NUMBER.fullmatch(value):
            value = value.replace(",", ".")
        if _NUMBER.fullmatch(value):
            number = float(value)
            if math.isfinite(number):
                return number
            raise NonFiniteError("the number is too large", where=self.where(column), given=value)
        if value.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise NonFiniteError("not a finite number", where=self.where(column), given=value)
        comma = re.fullmatch(r"[+-]?\d+,\d+", value)
        problem, allowed = "not a number", "a number with a decimal point, such as 0.25 or 1e-3"
        hint = "write the decimal comma as a point in all of the table" if comma else ""
        raise InvalidValueError(problem, where=self.where(column), given=value, allowed=allowed, hint=hint)


def read_table(
    path: Path, columns: Sequence[str], needed: Sequence[str], other_names: Mapping[str, str] | None = None
) -> list[Row]:
    """Return the rows of a CSV file whose header names some of `columns`, among them all `needed` ones.

    other_names: columns by other names, in lower case, for headers of upper or lower case; None: there are
    none, and case matters.
    """
    text = read_text(path, MAX_TABLE_BYTES, "a CSV table")
    n_rows = text.count("\n")
    if n_rows > MAX_ENTRIES:
        problem = "the table has too many rows for a scene"
        raise SceneSyntaxError(problem, where=str(path), given=n_rows, allowed=f"up to {MAX_ENTRIES} rows")
    lines = read_lines(text, path)
    header_line = next(lines, None)
    if header_line is None:
        raise SceneSyntaxError("the file has no header", where=str(path), allowed="a CSV table")
    names = header_line[1]
    if other_names is not None:
        names = [other_names.get(name.lower(), name.lower()) for name in names]
    header = _check_header((header_line[0], names), path, columns, needed)
    rows = [make_row(path, number, cells, header, len(header_line[1])) for number, cells in lines]
    if _find_separator(text) != "," and _has_decimal_commas(rows):
        return [replace(row, decimal_comma=True) for row in rows]
    return rows


def _has_decimal_commas(rows: Sequence[Row]) -> bool:
    """Return whether numbers have commas, and none a point: beside points a comma may divide thousands."""
    cells = [cell for row in rows for cell in row.cells.values()]
    has_point = any("." in cell and _NUMBER.fullmatch(cell) for cell in cells)
    return not has_point and any("," in cell and _COMMA_NUMBER.fullmatch(cell) for cell in cells)


def _find_separator(text: str) -> str:
    header = next(line for line in text.split("\n") if line.strip())
    return max(",;\t", key=header.count)


def read_lines(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and stripped cells of every line that is not blank."""
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=_find_separator(text), skipinitialspace=True, strict=True
    )
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                yield reader.line_num, stripped
    except csv.Error as error:
        location = f"{path}: line {reader.line_num}"
        raise SceneSyntaxError(f"not a CSV table: {error}", where=location, allowed="a CSV table") from None


def _check_header(
    line: tuple[int, list[str]], path: Path, columns: Sequence[str], needed: Sequence[str]
) -> list[str]:
    number, header = line[0], list(line[1])
    while header and not header[-1]:
        header.pop()
    where = f"{path}: line {number}"
    for name in header:
        if name not in columns:
            raise unknown_key(name, columns, where, "unknown column")
        if header.count(name) > 1:
            problem = "a column appears twice"
            raise DuplicateNameError(problem, where=where, given=name, allowed="each column once")
    missing = [name for name in needed if name not in header]
    if missing:
        problem = f"the table lacks the column {missing[0]}"
        allowed = f"a header with {', '.join(needed)}, and any of {', '.join(columns)}"
        raise InvalidValueError(problem, where=where, given=", ".join(header), allowed=allowed)
    return header


def make_row(path: Path, line: int, cells: list[str], header: list[str], width: int) -> Row:
    """Return a row; as many empty cells at its end are dropped as the header has: more may be a shift."""
    if len(cells) == width and not any(cells[len(header) :]):
        cells = cells[: len(header)]
    if len(cells) != len(header):
        few = len(cells) < len(header)
        problem, location = f"the row has too {'few' if few else 'many'} cells", f"{path}: line {line}"
        allowed = f"{len(header)} cells: {', '.join(header)}"
        hint = "an empty cell still needs its separator; a decimal comma splits a cell in two"
        raise SceneSyntaxError(problem, where=location, given=len(cells), allowed=allowed, hint=hint)
    return Row(path, line, dict(zip(header, cells, strict=True)))
