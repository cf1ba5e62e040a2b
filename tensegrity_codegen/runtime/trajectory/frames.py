"""Motions as objects of pandas and xarray, which are optional packages."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.trajectory.columns import FIRST_OF_BATCH, list_columns, list_input_units
from tensegrity_codegen.system.extras import TABLES, import_extra

# Arrays of a motion, their axes after the samples, units and meanings.
VARIABLES = {
    "node_position": (("node", "axis"), "m", "position"),
    "node_velocity": (("node", "axis"), "m/s", "velocity"),
    "member_tension": (("member",), "N", "tension, positive in tension"),
    "kinetic_energy": ((), "J", "kinetic energy"),
    "total_energy": ((), "J", "total energy"),
}


def build_frame(motion: Any) -> Any:
    """Return a Trajectory as a pandas.DataFrame over time, a BatchTrajectory over motion and time.

    Raises MissingExtraError where pandas is not installed.
    """
    pandas = import_extra("pandas", TABLES)
    columns = list_columns(motion)
    names = [name for name in (FIRST_OF_BATCH, "time [s]") if name in columns]
    index = [columns.pop(name) for name in names]
    if len(index) == 1:
        return pandas.DataFrame(columns, index=pandas.Index(index[0], name=names[0]))
    return pandas.DataFrame(columns, index=pandas.MultiIndex.from_arrays(index, names=names))


def build_dataset(motion: Any) -> Any:
    """Return a Trajectory as an xarray.Dataset; a BatchTrajectory has the axis `motion` first.

    Raises MissingExtraError where xarray is not installed.
    """
    xarray = import_extra("xarray", TABLES)
    first = ("time",) if motion.node_position.ndim == 3 else (FIRST_OF_BATCH, "time")
    data: dict[str, Any] = {
        name: ((*first, *axes), getattr(motion, name), {"units": unit, "long_name": meaning})
        for name, (axes, unit, meaning) in VARIABLES.items()
    }
    coords: dict[str, Any] = {
        "time": ("time", motion.time, {"units": "s"}),
        "node": list(motion.node_name),
        "member": list(motion.member_name),
        "axis": ["x", "y", "z"],
    }
    if len(first) == 2:
        coords[FIRST_OF_BATCH] = np.arange(len(motion.node_position))
    values, names = getattr(motion, "input", None), getattr(motion, "input_name", ())
    if values is not None:
        units = list_input_units(motion.structure)
        coords["input_name"] = list(names)
        data["input"] = (
            (*first, "input_name"),
            values,
            {"units": ", ".join(units.get(name, "?") for name in names)},
        )
    attributes = {"method": motion.method, "status": _join(motion.status), "message": _join(motion.message)}
    return xarray.Dataset(data, coords=coords, attrs=attributes)


def _join(words: str | tuple[str, ...]) -> str:
    return words if isinstance(words, str) else "; ".join(words)
