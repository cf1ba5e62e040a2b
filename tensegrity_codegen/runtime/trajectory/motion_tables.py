"""Motions as tables with a row for each sample, as objects of pandas and xarray, and as files."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.extras import TABLES, import_extra
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.table_files import require_packages, write_csv, write_mat, write_parquet
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS

MOTION_COLUMN = "motion"  # column of the number of each motion of a batch
# Arrays of a motion, their axes after the samples, units and meanings.
VARIABLES = {
    "node_position": (("node", "axis"), "m", "position"),
    "node_velocity": (("node", "axis"), "m/s", "velocity"),
    "member_tension": (("member",), "N", "tension, positive in tension"),
    "kinetic_energy": ((), "J", "kinetic energy"),
    "total_energy": ((), "J", "total energy"),
}
BODY_VARIABLES = {
    "body_position": (("body", "axis"), "m", "centre of mass"),
    "body_axes": (("body", "axis", "frame_axis"), "1", "axes of the frame, as columns"),
    "body_angular_velocity": (("body", "frame_axis"), "rad/s", "angular velocity in the frame"),
}


def list_columns(motion: Any) -> dict[str, NDArray[Any]]:
    """Return the columns of one motion, or of a batch with numbers of motions, by names with units."""
    if motion.node_position.ndim == 3:
        return _list_one(motion)
    motions = list(motion)
    tables = [_list_one(single) for single in motions]
    numbers = [np.full(len(single.time), number) for number, single in enumerate(motions)]
    joined = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {MOTION_COLUMN: np.concatenate(numbers), **joined}


def list_input_units(structure: Structure | BodySystem | None) -> Mapping[str, str]:
    """Return the unit of each input by its name; empty if the structure is not known."""
    return {} if structure is None else {input.name: INPUT_UNITS[input.kind] for input in structure.inputs}


def _list_one(motion: Any) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {"time [s]": motion.time}
    for values, prefix, unit in ((motion.node_position, "", "m"), (motion.node_velocity, "v", "m/s")):
        for k, node in enumerate(motion.node_name):
            for axis, letter in enumerate("xyz"):
                columns[f"{node}.{prefix}{letter} [{unit}]"] = values[:, k, axis]
    for k, member in enumerate(motion.member_name):
        columns[f"{member}.tension [N]"] = motion.member_tension[:, k]
    for k, body in enumerate(motion.body_name):
        for axis, letter in enumerate("xyz"):
            columns[f"body.{body}.{letter} [m]"] = motion.body_position[:, k, axis]
        for row, column in np.ndindex(3, 3):
            columns[f"body.{body}.e{column + 1}{'xyz'[row]}"] = motion.body_axes[:, k, row, column]
        for axis in range(3):
            name = f"body.{body}.w{axis + 1} [rad/s]"
            columns[name] = motion.body_angular_velocity[:, k, axis]
    columns["kinetic_energy [J]"] = motion.kinetic_energy
    columns["total_energy [J]"] = motion.total_energy
    units = list_input_units(motion.structure)
    if getattr(motion, "input", None) is not None:
        for k, name in enumerate(motion.input_name):
            unit = f" [{units[name]}]" if name in units else ""
            columns[f"input.{name}{unit}"] = motion.input[:, k]
    return columns


def build_frame(motion: Any) -> Any:
    """Return a Trajectory as a pandas.DataFrame over time, a BatchTrajectory over motion and time."""
    pandas = import_extra("pandas", TABLES)
    columns = list_columns(motion)
    names = [name for name in (MOTION_COLUMN, "time [s]") if name in columns]
    index = [columns.pop(name) for name in names]
    if len(index) == 1:
        return pandas.DataFrame(columns, index=pandas.Index(index[0], name=names[0]))
    return pandas.DataFrame(columns, index=pandas.MultiIndex.from_arrays(index, names=names))


def build_dataset(motion: Any) -> Any:
    """Return a Trajectory as an xarray.Dataset; a BatchTrajectory has the axis `motion` first."""
    xarray = import_extra("xarray", TABLES)
    sample_axes = ("time",) if motion.node_position.ndim == 3 else (MOTION_COLUMN, "time")
    variables = VARIABLES | (BODY_VARIABLES if motion.body_name else {})
    data: dict[str, Any] = {
        name: ((*sample_axes, *axes), getattr(motion, name), {"units": unit, "long_name": meaning})
        for name, (axes, unit, meaning) in variables.items()
    }
    coords: dict[str, Any] = {
        "time": ("time", motion.time, {"units": "s"}),
        "node": list(motion.node_name),
        "member": list(motion.member_name),
        "axis": ["x", "y", "z"],
    }
    if motion.body_name:
        coords |= {"body": list(motion.body_name), "frame_axis": ["e1", "e2", "e3"]}
    if len(sample_axes) == 2:
        coords[MOTION_COLUMN] = np.arange(len(motion.node_position))
    values, names = getattr(motion, "input", None), getattr(motion, "input_name", ())
    if values is not None:
        units = list_input_units(motion.structure)
        coords["input_name"] = list(names)
        data["input"] = (
            (*sample_axes, "input_name"),
            values,
            {"units": ", ".join(units.get(name, "?") for name in names)},
        )
    attributes = {"method": motion.method, "status": _join(motion.status), "message": _join(motion.message)}
    return xarray.Dataset(data, coords=coords, attrs=attributes)


def _join(words: str | tuple[str, ...], separator: str = "; ") -> str:
    return words if isinstance(words, str) else separator.join(words)


def _write_csv(motion: Any, path: Path, overwrite: bool) -> None:
    columns = list_columns(motion)
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    write_csv(path, list(columns), rows, overwrite=overwrite)


def _write_parquet(motion: Any, path: Path, overwrite: bool) -> None:
    texts = {name: _join(getattr(motion, name), "\n") for name in ("status", "message", "method")}
    write_parquet(path, list_columns(motion), texts, overwrite=overwrite)


# Kinds of files by their endings, the usual one first.
WRITERS: Mapping[str, Callable[[Any, Path, bool], None]] = {
    ".npz": lambda motion, path, overwrite: write_arrays(path, motion.arrays(), overwrite=overwrite),
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mat": lambda motion, path, overwrite: write_mat(path, motion.arrays(), overwrite=overwrite),
}
MOTION_ENDINGS = tuple(WRITERS)


def check_motion_file(path: str | Path) -> None:
    """Raise OutputError for a name with another ending, MissingExtraError if its package is missing."""
    check_ending(path, *MOTION_ENDINGS)
    require_packages(path)


def write_motion(motion: Any, path: str | Path, *, overwrite: bool) -> None:
    """Write a Trajectory or BatchTrajectory in the format of the path's ending; without one as .npz."""
    check_motion_file(path)
    WRITERS.get(Path(path).suffix.lower(), WRITERS[".npz"])(motion, Path(path), overwrite)
