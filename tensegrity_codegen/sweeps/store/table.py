"""The scalar results of a sweep as a table, a row a case: CSV or Parquet, written piece by piece."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED, STATUSES
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
    MESSAGE,
    STATUS,
    StoredSweep,
    open_sweep,
    read_stored_sweep,
)
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.extras import TABLES, import_extra
from tensegrity_codegen.system.files import check_ending, check_output, replaced

TABLE_FORMATS = ("csv", "parquet")
MOST_COLUMNS = 100  # of one quantity over the names of members, nodes or others
GROUP_ROWS = 2**16  # rows of a row group of Parquet


def check_table(path: str | Path, format: str, *, overwrite: bool = False) -> Path:
    """Return the file that a table is written to, before any work."""
    check_choice(format, TABLE_FORMATS, "format", "format")
    check_ending(path, f".{format}")
    if format == "parquet":
        import_extra("pyarrow.parquet", TABLES)
    return check_output(path, overwrite=overwrite)


def write_sweep_table(
    store: str | Path, path: str | Path, format: str = "csv", *, overwrite: bool = False
) -> tuple[str, ...]:
    """Write a table with a row a case: number, status, values of the keys, results, message.

    store: the folder of a sweep, finished or not; path: the file; format: ``"csv"`` or ``"parquet"``;
    overwrite: whether a file that exists is replaced.
    Returns results that no table can hold: those over time, and matrices. Raises OutputError: the folder is
    not a sweep, files in it are damaged, or the file cannot be written or exists; UnknownNameError,
    MissingExtraError: as for `check_table`.
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
class _SweepTable:
    """The columns of a sweep: of keys, and of results by their headings."""

    stored: StoredSweep
    found: Any  # xarray.Dataset, whose arrays are read when they are used
    keys: dict[str, str]  # key -> name of its values
    headings: dict[str, tuple[str, ...]]  # result -> a heading for each of its numbers

    @classmethod
    def of(cls, path: str | Path) -> "_SweepTable":
        """Return the table of a store."""
        stored, dataset = read_stored_sweep(path), open_sweep(path)
        return cls(stored, dataset, stored.attributes[ATTRIBUTE]["keys"], {
            name: _find_headings(dataset[name], len(stored.layout.shape))
            for name in sorted(set(stored.results) - {STATUS, MESSAGE})
        })  # fmt: skip

    @property
    def absent(self) -> tuple[str, ...]:
        """Results that have no columns."""
        return tuple(name for name, headings in self.headings.items() if not headings)

    @property
    def header(self) -> tuple[str, ...]:
        """Headings of all columns."""
        results = (heading for headings in self.headings.values() for heading in headings)
        return ("case", "status", *self.keys, *results, "message")

    def pieces(self) -> Iterator[list[NDArray[Any]]]:
        """Give the columns of the cases of one task after the other."""
        statuses = np.array([*STATUSES, NOT_COMPUTED], dtype=object)
        dims, layout = self.found[STATUS].dims, self.stored.layout
        for task in range(layout.n_tasks):
            start, stop = layout.cases_of(task)
            cases = self.found.isel(dict(zip(dims, layout.box_of(task), strict=True)))
            status = cases[STATUS]
            columns: list[NDArray[Any]] = [np.arange(start, stop), statuses[status.values.ravel()]]
            for name in self.keys.values():
                columns.append(
                    cases[name].astype(float).broadcast_like(status).transpose(*dims).values.ravel()
                )
            for name, headings in self.headings.items():
                if headings:
                    columns += list(cases[name].values.reshape(stop - start, -1).T)
            yield [*columns, cases[MESSAGE].values.astype(object).ravel()]


def _find_headings(array: Any, lead: int) -> tuple[str, ...]:
    """Return the headings of a scalar, or of a quantity over names; () for anything else."""
    dims, unit = array.dims[lead:], f" [{array.attrs.get('units', '1')}]"
    if not dims:
        return (f"{array.name}{unit}",)
    if len(dims) > 1 or dims[0] == "time" or dims[0] not in array.coords or array.shape[-1] > MOST_COLUMNS:
        return ()
    return tuple(f"{array.name}.{label}{unit}" for label in array[dims[0]].values.tolist())


def _write_parquet(path: Path, header: Sequence[str], pieces: Iterator[list[NDArray[Any]]]) -> None:
    pyarrow, parquet = import_extra("pyarrow", TABLES), import_extra("pyarrow.parquet", TABLES)
    head = pyarrow.table(dict(zip(header, next(pieces), strict=True)))
    schema = head.schema
    waiting = [head]
    with parquet.ParquetWriter(path, schema) as writer:
        for piece in pieces:
            waiting.append(pyarrow.table(dict(zip(header, piece, strict=True)), schema=schema))
            if sum(len(table) for table in waiting) >= GROUP_ROWS:
                writer.write_table(pyarrow.concat_tables(waiting))
                waiting.clear()
        if waiting:
            writer.write_table(pyarrow.concat_tables(waiting))
