"""Files of linear models: the ending of the name says which kind."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.table_files import write_csv, write_mat

MATRICES = ("A", "B", "variation")
VECTORS = ("c", "residual_rate", "state", "input")
NAMES = ("state_name", "input_name")
FREQUENCIES = ("natural_frequency", "damping_ratio")
CSV_HEADER = ("matrix", "row", "column", "value")


def _write_npz(linear: Any, path: Path, overwrite: bool) -> None:
    """Write sparse matrices as row, column, value; names and vectors."""
    arrays: dict[str, Any] = {}
    for name, matrix in _matrices(linear):
        entries = matrix.tocoo()
        arrays |= {f"{name}_row": entries.row, f"{name}_column": entries.col, f"{name}_value": entries.data}
        arrays[f"{name}_shape"] = np.array(entries.shape)
    arrays |= {name: getattr(linear, name) for name in (*VECTORS, *FREQUENCIES)}
    arrays |= {name: np.array(getattr(linear, name), dtype=str) for name in NAMES}
    write_arrays(path, arrays, overwrite=overwrite)


def _write_mat(linear: Any, path: Path, overwrite: bool) -> None:
    """Write sparse matrices as such, vectors as columns, names as cells."""
    variables: dict[str, Any] = {name: scipy.sparse.csc_matrix(matrix) for name, matrix in _matrices(linear)}
    variables |= {name: getattr(linear, name) for name in (*VECTORS, *FREQUENCIES)}
    variables |= {name: list(getattr(linear, name)) for name in NAMES}
    write_mat(path, variables, overwrite=overwrite)


def _write_csv(linear: Any, path: Path, overwrite: bool) -> None:
    """Write every non-zero entry of the matrices and every entry of the vectors, with names, a line each."""
    write_csv(path, CSV_HEADER, _list_entries(linear), overwrite=overwrite)


def _list_entries(linear: Any) -> Iterator[tuple[str, str, str, float]]:
    states, inputs = linear.state_name, linear.input_name
    variations = [f"p{k}" for k in range(0 if linear.variation is None else linear.variation.shape[1])]
    columns = {"A": states, "B": inputs, "variation": variations}
    for name, matrix in _matrices(linear):
        entries = matrix.tocoo()
        for row, column, value in zip(entries.row, entries.col, entries.data, strict=True):
            yield name, states[row], columns[name][column], float(value)
    for name in VECTORS:
        rows = inputs if name == "input" else states
        for row, value in zip(rows, getattr(linear, name), strict=True):
            yield name, row, "", float(value)


def _matrices(linear: Any) -> list[tuple[str, Any]]:
    return [(name, getattr(linear, name)) for name in MATRICES if getattr(linear, name) is not None]


# Kinds of files by their endings, the usual one first.
WRITERS: Mapping[str, Callable[[Any, Path, bool], None]] = {
    ".npz": _write_npz,
    ".mat": _write_mat,
    ".csv": _write_csv,
}
LINEAR_ENDINGS = tuple(WRITERS)


def write_linear_model(linear: Any, path: str | Path, *, overwrite: bool) -> None:
    """Write a LinearModel in the format of the path's ending; without one as .npz."""
    check_ending(path, *LINEAR_ENDINGS)
    WRITERS.get(Path(path).suffix.lower(), _write_npz)(linear, Path(path), overwrite)
