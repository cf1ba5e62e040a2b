"""The scalar results of a sweep as a table, a row a case: CSV or Parquet, written piece by piece."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.statuses import NOT_COMPUTED, STATUSES
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
    MESSAGE,
    RECORD,
    STATUS,
    check_not_damaged,
    read_stored_sweep,
)
from tensegrity_codegen.sweeps.store.store import open_group
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.extras import TABLES, import_extra
from tensegrity_codegen.system.files import check_ending, check_output, replaced

TABLE_FORMATS = ("csv", "parquet")
MOST_COLUMNS = 100  # of one quantity over the names of members, nodes or others
GROUP_ROWS = 2**16  # rows of a row group of Parquet


def check_table(path: str | Path, format: str, *, overwrite: bool = False) -> Path:
    """Return the file that a table is written to, before any work.

    Raises
    ------
    UnknownNameError
        An unknown format.
    MissingExtraError
        Parquet without pyarrow.
    OutputError
        The file cannot be written, or exists (without `overwrite`).
    """
    check_choice(format, TABLE_FORMATS, "format", "format")
    check_ending(path, f".{format}")
    if format == "parquet":
        import_extra("pyarrow.parquet", TABLES)
    return check_output(path, overwrite=overwrite)


def write_sweep_table(
    store: str | Path, path: str | Path, format: str = "csv", *, overwrite: bool = False
) -> tuple[str, ...]:
    """Write a table with a row a case: number, status, values of the keys, results, message.

    Parameters
    ----------
    store : str or Path
        The folder of a sweep, finished or not.
    path : str or Path
        The file.
    format : str
        ``"csv"`` or ``"parquet"``.
    overwrite : bool
        Whether a file that exists is replaced.

    Returns
    -------
    tuple of str
        Results that no table can hold: those over time, and matrices.

    Raises
    ------
    OutputError
        The folder is not a sweep, files in it are damaged, or the file cannot be written or exists.
    UnknownNameError, MissingExtraError
        As for `check_table`.
    """
    target = check_table(path, format, overwrite=overwrite)
    table = _SweepTable.of(store)
    pieces = table.pieces()
    if format == "csv":
        with (
            replaced(target, overwrite=overwrite) as temporary,
            temporary.open("w", encoding="utf-8", newline="") as file,
        ):
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(table.header)
            for piece in pieces:
                writer.writerows(zip(*(column.tolist() for column in piece), strict=True))
    else:
        with replaced(target, overwrite=overwrite) as temporary:
            _write_parquet(temporary, table.header, pieces)
    return table.absent


@dataclass(frozen=True, eq=False)
class _Column:
    """An array of the store, and the headings of its columns."""

    array: Any
    headings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _SweepTable:
    layout: CaseLayout
    keys: tuple[tuple[str, int, NDArray[np.float64]], ...]  # key, dimension, values along it
    results: tuple[_Column, ...]
    status: Any
    message: Any
    absent: tuple[str, ...]

    @classmethod
    def of(cls, path: str | Path) -> "_SweepTable":
        """Return the table of a store; values of keys are read, results when they are written."""
        stored = read_stored_sweep(path)
        check_not_damaged(stored)
        group = open_group(stored)
        own, status = stored.attributes[ATTRIBUTE], group[STATUS]
        dims = tuple(own["case_dims"])
        keys = []
        for key, name in own["keys"].items():
            place = dims.index(name) if name in dims else len(dims) - 1
            keys.append((key, place, np.asarray(group[name][...], dtype=np.float64)))
        known = {STATUS, MESSAGE, RECORD, *own["keys"].values()}
        results, absent = [], []
        for name, array in sorted(group.arrays()):
            names = tuple(array.metadata.dimension_names or ())
            if name in known or names[: len(dims)] != dims:
                continue
            headings = _find_headings(group, name, array, names[len(dims) :])
            if headings:
                results.append(_Column(array, headings))
            else:
                absent.append(name)
        return cls(stored.layout, tuple(keys), tuple(results), status, group[MESSAGE], tuple(absent))

    @property
    def header(self) -> tuple[str, ...]:
        """Headings of all columns."""
        results = (heading for column in self.results for heading in column.headings)
        return ("case", "status", *(key for key, _, _ in self.keys), *results, "message")

    def pieces(self) -> Iterator[list[NDArray[Any]]]:
        """Give the columns of the cases of one task after the other."""
        words = np.array([*STATUSES, NOT_COMPUTED], dtype=object)
        for task in range(self.layout.n_tasks):
            box, (first, last) = self.layout.box_of(task), self.layout.cases_of(task)
            shape = tuple(part.stop - part.start for part in box)
            columns: list[NDArray[Any]] = [np.arange(first, last), words[self.status[box].ravel()]]
            for _, place, values in self.keys:
                spread = [1] * len(shape)
                spread[place] = shape[place]
                columns.append(np.broadcast_to(values[box[place]].reshape(spread), shape).ravel())
            for column in self.results:
                found = np.asarray(column.array[box]).reshape(last - first, -1)
                columns += list(found.T)
            yield [*columns, np.asarray(self.message[box], dtype=object).ravel()]


def _find_headings(group: Any, name: str, array: Any, dims: Sequence[str]) -> tuple[str, ...]:
    """Return the headings of a scalar, or of a quantity over names; () for anything else."""
    unit = f" [{array.attrs.get('units', '1')}]"
    if not dims:
        return (f"{name}{unit}",)
    if len(dims) > 1 or dims[0] == "time" or dims[0] not in group or array.shape[-1] > MOST_COLUMNS:
        return ()
    return tuple(f"{name}.{label}{unit}" for label in group[dims[0]][...].tolist())


def _write_parquet(path: Path, header: Sequence[str], pieces: Iterator[list[NDArray[Any]]]) -> None:
    pyarrow, parquet = import_extra("pyarrow", TABLES), import_extra("pyarrow.parquet", TABLES)
    first = pyarrow.table(dict(zip(header, next(pieces), strict=True)))
    schema = first.schema
    waiting = [first]
    with parquet.ParquetWriter(path, schema) as writer:
        for piece in pieces:
            waiting.append(pyarrow.table(dict(zip(header, piece, strict=True)), schema=schema))
            if sum(len(table) for table in waiting) >= GROUP_ROWS:
                writer.write_table(pyarrow.concat_tables(waiting))
                waiting.clear()
        if waiting:
            writer.write_table(pyarrow.concat_tables(waiting))
