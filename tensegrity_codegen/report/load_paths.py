"""Load paths as tables: points with all that the model computes there, and events."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table

from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.files import check_ending, replaced
from tensegrity_codegen.system.table_files import write_csv


def tabulate_path(path: LoadPath, model: ModelPath) -> dict[str, FloatArray]:
    """Return the columns of a table with one row a point, name -> (n_points,).

    Load factor, smallest eigenvalue, residual, coordinates by name, and where the model computes them
    length_<member> [m], tension_<member> [N] and distance_<pair> [m].
    """
    manifest = model.model.manifest
    columns = {
        "load_factor": path.load_factor,
        "smallest_eigenvalue": path.smallest_eigenvalue,
        "residual": path.residual,
    }
    columns |= _columns("", manifest.coordinate_name, path.coordinate)
    for prefix, quantity, names in (
        ("length_", "member_length", manifest.member_name),
        ("tension_", "member_tension", manifest.member_name),
        ("distance_", "bar_distance", manifest.bar_pair_name),
    ):
        if model.offers(quantity) and names:
            points = zip(path.coordinate, path.load_factor, strict=True)
            rows = [model.compute(quantity, coordinate, float(load)) for coordinate, load in points]
            columns |= _columns(prefix, names, np.array(rows))
    return columns


def write_path(columns: dict[str, FloatArray], path: LoadPath, file: Path, *, overwrite: bool) -> None:
    """Write a table of points, and to .json the events too, whole or not at all; OutputError if it fails."""
    check_ending(file, ".csv", ".json")
    if file.suffix.lower() == ".csv":
        rows = np.column_stack(list(columns.values())).tolist()
        write_csv(file, list(columns), rows, overwrite=overwrite)
        return
    data = path.as_evidence() | {"points": {name: values.tolist() for name, values in columns.items()}}
    with replaced(file, overwrite=overwrite) as temporary:
        text = json.dumps(_without_infinity(data), indent=1, allow_nan=False) + "\n"
        temporary.write_text(text, encoding="utf-8", newline="\n")


def events_table(events: Sequence[PathEvent]) -> Table:
    """Return a table of the events in order."""
    table = Table("load factor", "event", "of", title="events", box=box.SIMPLE, title_justify="left")
    table.columns[0].justify = "right"
    for event in events:
        table.add_row(f"{event.load_factor:.10g}", event.kind, ", ".join(event.names))
    return table


def _columns(prefix: str, names: Sequence[str], rows: FloatArray) -> dict[str, FloatArray]:
    table = rows.reshape(len(rows), len(names))
    return {f"{prefix}{name}": table[:, k] for k, name in enumerate(names)}


def _without_infinity(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_infinity(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinity(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
