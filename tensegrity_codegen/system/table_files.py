"""Files of tables and arrays besides .npz: CSV, Parquet and MATLAB's .mat, written whole or not at all."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.extras import TABLES, import_extra
from tensegrity_codegen.system.files import check_ending, replaced

PARQUET = ".parquet"
MAT_HEADER = 116  # bytes of text at the start of a .mat file
MAX_MAT_BYTES = 2**31 - 2**16  # bytes of one array of a .mat file (level 5)


def require_packages(path: str | Path) -> None:
    """Raise MissingExtraError if the ending of `path` needs a package that is not installed."""
    if Path(path).suffix.lower() == PARQUET:
        import_extra("pyarrow.parquet", TABLES)


def write_csv(
    path: str | Path, header: Sequence[str], rows: Iterable[Sequence[Any]], *, overwrite: bool
) -> None:
    """Write a table as CSV, numbers by their shortest text that reads back bit-equal."""
    with (
        replaced(path, overwrite=overwrite) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_parquet(
    path: str | Path, columns: Mapping[str, NDArray[Any]], facts: Mapping[str, str], *, overwrite: bool
) -> None:
    """Write columns of one length as Parquet, `facts` as its metadata."""
    check_ending(path, PARQUET)
    pyarrow, parquet = import_extra("pyarrow", TABLES), import_extra("pyarrow.parquet", TABLES)
    metadata = {key: value.encode("utf-8") for key, value in facts.items()}
    table = pyarrow.table(dict(columns)).replace_schema_metadata(metadata)
    with replaced(path, overwrite=overwrite) as temporary:
        parquet.write_table(table, temporary)


def write_mat(path: str | Path, variables: Mapping[str, Any], *, overwrite: bool) -> None:
    """Write variables as a MATLAB file (level 5): vectors are columns, lists of texts cells."""
    from scipy.io import savemat

    check_ending(path, ".mat")
    for name, value in variables.items():
        size = getattr(value, "nbytes", 0)
        if size > MAX_MAT_BYTES:
            problem, allowed = "the array is too large for a .mat file", f"up to {MAX_MAT_BYTES >> 20} MB"
            hint = "write an .npz file"
            raise InvalidValueError(problem, where=name, given=f"{size >> 20} MB", allowed=allowed, hint=hint)
    with replaced(path, overwrite=overwrite) as temporary:
        converted = {name: _to_matlab(value) for name, value in variables.items()}
        savemat(str(temporary), converted, appendmat=False, oned_as="column")
        with temporary.open("r+b") as file:
            file.write("MATLAB 5.0 MAT-file, written by tensegrity_codegen".ljust(MAT_HEADER).encode("ascii"))


def _to_matlab(value: Any) -> Any:
    """Return texts of an array as a cell array, numbers in types of MATLAB."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return value.item() if value.ndim == 0 else value.astype(object)
    if isinstance(value, tuple | list) and all(isinstance(entry, str) for entry in value):
        return np.array(value, dtype=object)
    return value
