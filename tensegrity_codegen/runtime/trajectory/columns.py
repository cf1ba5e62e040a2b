"""Motions as one table: a row for each sample, columns named with their units."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS

FIRST_OF_BATCH = "motion"


def list_columns(motion: Any) -> dict[str, NDArray[Any]]:
    """Return the columns of a Trajectory, or of the motions of a BatchTrajectory, by their names.

    The names have their units: ``time [s]``, ``t1.x [m]``, ``t1.vx [m/s]``, ``bar1.tension [N]``, and those
    of inputs where the structure is known. The table of a batch starts with a column ``motion``, the number
    of each motion from 0 on, and has the samples that each motion reached.
    """
    if motion.node_position.ndim == 3:
        return _list_one(motion)
    motions = list(motion)
    tables = [_list_one(one) for one in motions]
    numbers = [np.full(len(one.time), number) for number, one in enumerate(motions)]
    joined = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {FIRST_OF_BATCH: np.concatenate(numbers), **joined}


def list_input_units(structure: Structure | BodySystem | None) -> Mapping[str, str]:
    """Return the unit of each input by its name; empty where the structure is not known."""
    return {} if structure is None else {item.name: INPUT_UNITS[item.kind] for item in structure.inputs}


def _list_one(motion: Any) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {"time [s]": motion.time}
    for values, prefix, unit in ((motion.node_position, "", "m"), (motion.node_velocity, "v", "m/s")):
        for k, node in enumerate(motion.node_name):
            for axis, letter in enumerate("xyz"):
                columns[f"{node}.{prefix}{letter} [{unit}]"] = values[:, k, axis]
    for k, member in enumerate(motion.member_name):
        columns[f"{member}.tension [N]"] = motion.member_tension[:, k]
    columns["kinetic_energy [J]"] = motion.kinetic_energy
    columns["total_energy [J]"] = motion.total_energy
    units = list_input_units(motion.structure)
    if getattr(motion, "input", None) is not None:
        for k, name in enumerate(motion.input_name):
            unit = f" [{units[name]}]" if name in units else ""
            columns[f"input.{name}{unit}"] = motion.input[:, k]
    return columns
