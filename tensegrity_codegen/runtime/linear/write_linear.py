"""Files of linear models: the ending of the name says which kind."""

from collections.abc import Iterator
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
LINEAR_ENDINGS = (".npz", ".mat", ".csv")  # the usual one first
CSV_HEADER = ("matrix", "row", "column", "value")


def _list_entries(linear: Any) -> Iterator[tuple[str, str, str, float]]:
    """Yield each non-zero entry of the matrices and every entry of the vectors, with its names."""
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


def write_linear_model(linear: Any, path: str | Path, *, overwrite: bool) -> None:
    """Write a LinearModel in the format of the path's ending; without one as .npz."""
    check_ending(path, *LINEAR_ENDINGS)
    path = Path(path)
    if path.suffix.lower() == ".csv":
        write_csv(path, CSV_HEADER, _list_entries(linear), overwrite=overwrite)
        return
    values = {name: getattr(linear, name) for name in (*VECTORS, *FREQUENCIES)}
    if path.suffix.lower() == ".mat":
        # Sparse matrices as such, vectors as columns, names as cells.
        matrices: dict[str, Any] = {
            name: scipy.sparse.csc_matrix(matrix) for name, matrix in _matrices(linear)
        }
        cells = {name: list(getattr(linear, name)) for name in NAMES}
        write_mat(path, matrices | values | cells, overwrite=overwrite)
        return
    # Sparse matrices as row, column, value.
    arrays: dict[str, Any] = {}
    for name, matrix in _matrices(linear):
        entries = matrix.tocoo()
        arrays |= {f"{name}_row": entries.row, f"{name}_column": entries.col, f"{name}_value": entries.data}
        arrays[f"{name}_shape"] = np.array(entries.shape)
    names = {name: np.array(getattr(linear, name), dtype=str) for name in NAMES}
    write_arrays(path, arrays | values | names, overwrite=overwrite)
