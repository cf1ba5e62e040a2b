"""Files that a study reads: plans and weights."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
from tensegrity_codegen.runtime.model.arrays import UNREADABLE, read_arrays
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, SceneSyntaxError, describe_reason, name_list

REAL = "fiu"  # kinds of NumPy: floating, signed and unsigned integers


def read_path(path: str | Path, model: CompiledModel) -> EquilibriumPath:
    """Read the path of a plan that `write_plan` wrote."""
    needed = ("change", "progress", "actuator_name", "member_name", "status")
    data = _read(path, needed, "that the verb plan wrote", optional=("coordinate",))
    status = str(data["status"])
    if status != "found" or len(data["progress"]) < 2:
        raise InvalidValueError(
            "the plan has no path to its target",
            where=str(path),
            given=f"status {status!r}, {max(len(data['progress']) - 1, 0)} steps",
            allowed="a plan of status 'found' with at least one step",
        )
    names = tuple(str(name) for name in data["actuator_name"].tolist())
    members = tuple(str(name) for name in data["member_name"].tolist())
    count = len(model.manifest.coordinate_name)
    has_others = "coordinate" in data and data["coordinate"].shape[1:] != (count,)
    if members != model.manifest.member_name or has_others:
        raise InvalidValueError(
            "the plan belongs to another structure",
            where=str(path),
            given=f"{len(members)} members: {name_list(members, 3)}",
            allowed=f"a plan of {model.manifest.name} with {len(model.manifest.member_name)} members and "
            f"{count} coordinates",
        )
    return EquilibriumPath(data["change"], data.get("coordinate"), data["progress"], names)


def read_weights(path: str | Path) -> tuple[FloatArray, FloatArray]:
    """Read the weights Q and R of `design_lqr` from an ``.npz`` file."""
    data = _read(path, ("Q", "R"), "with arrays Q and R")
    for name in ("Q", "R"):
        kind = data[name].dtype
        if kind.kind not in REAL:
            raise SceneSyntaxError(
                "the weights are not real numbers",
                where=f"{path}: {name}",
                given=f"an array of {kind.name}",
                allowed="arrays Q and R of real numbers",
            )
    return np.asarray(data["Q"], dtype=float), np.asarray(data["R"], dtype=float)


def _read(
    path: str | Path, names: tuple[str, ...], source: str, optional: tuple[str, ...] = ()
) -> dict[str, NDArray[Any]]:
    try:
        data = read_arrays(Path(path), (*names, *optional))
        for name in names:
            data[name]
    except UNREADABLE as error:
        reason = f"no array {error}" if isinstance(error, KeyError) else describe_reason(error)
        raise SceneSyntaxError(
            "the file cannot be read", where=str(path), given=reason, allowed=f"an .npz file {source}"
        ) from error
    return data
