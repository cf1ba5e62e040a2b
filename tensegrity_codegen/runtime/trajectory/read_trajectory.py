"""Result files of the verb `simulate`, read back."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.arrays import UNREADABLE, read_arrays
from tensegrity_codegen.runtime.trajectory.sampled import SAMPLED, WORDS
from tensegrity_codegen.runtime.trajectory.trajectory import ContactSamples, Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_names
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneSyntaxError,
    StructureError,
    describe_reason,
)

CONTACTS = ("contact_force", "penetration")
DRIVEN = ("input", "node_load", "internal", *CONTACTS)  # what only files of motions with some of these hold


def read_trajectory(path: str | Path, structure: Structure) -> Trajectory:
    """Read a result file of the verb simulate back, for the structure that it was made from."""
    try:
        data = read_arrays(Path(path), ("time", *SAMPLED, *WORDS, *DRIVEN, "input_name"))
        names = tuple(data["node_name"].tolist()), tuple(data["member_name"].tolist())
        node_axis = structure.coordinate_node_axis
        fields: dict[str, Any] = {name: data[name] for name in ("time", *SAMPLED)}
        status, message, method = (str(data[name]) for name in ("status", "message", "method"))
        driven = {name: data[name] for name in DRIVEN if name in data}
        input_name = check_names(data["input_name"], "input_name") if "input" in data else ()
    except (*UNREADABLE, InvalidValueError) as error:
        raise SceneSyntaxError(
            "not a result file",
            where=str(path),
            given=describe_reason(error),
            allowed="an .npz file that the verb simulate wrote",
        ) from error
    if names != (structure.node_name, structure.member_name):
        raise StructureError(
            "the result belongs to another structure",
            where=str(path),
            given=f"{len(names[0])} nodes, {len(names[1])} members",
            allowed=f"the {structure.n_nodes} nodes and {structure.n_members} members of {structure.name}",
        )
    # Arrays of the right shapes, then contacts with the ground.
    ground = structure.ground
    if ground is not None and driven.get("internal", np.zeros(0)).shape[-1:] > (
        len(structure.internal_name),
    ):
        structure = structure.with_changes(ground=replace(ground, balances_energy=True))
    _check_shapes(fields | driven, structure, len(input_name), str(path))
    fields = {name: np.asarray(array, float) for name, array in fields.items()}
    driven = {name: np.asarray(array, float) for name, array in driven.items()}
    position, velocity = fields["node_position"], fields["node_velocity"]
    contacts = None
    if structure.ground is not None and all(name in driven for name in CONTACTS):
        touching = position[:, structure.ground.node]
        contact_arrays = (driven[name] for name in CONTACTS)
        contacts = ContactSamples(fields["time"], structure.contact_name, touching, *contact_arrays)
    return Trajectory(
        coordinate=position[:, node_axis[:, 0], node_axis[:, 1]],
        velocity=velocity[:, node_axis[:, 0], node_axis[:, 1]],
        node_name=names[0],
        member_name=names[1],
        status=status,
        message=message,
        method=method,
        structure=structure,
        input_name=input_name,
        input=driven.get("input"),
        node_load=driven.get("node_load"),
        contacts=contacts,
        bodies=structure.body_places,
        internal=driven.get("internal"),
        internal_name=structure.internal_name if "internal" in driven else (),
        **fields,
    )


def _check_shapes(
    fields: Mapping[str, NDArray[Any]], structure: Structure, n_inputs: int, where: str
) -> None:
    """Raise SceneSyntaxError unless all arrays are finite numbers of one count of samples."""
    n_t = fields["time"].size
    nodes, members = (n_t, structure.n_nodes, 3), (n_t, structure.n_members)
    shapes = {"node_position": nodes, "node_velocity": nodes, "member_tension": members}
    shapes |= {"input": (n_t, n_inputs), "node_load": nodes, "internal": (n_t, len(structure.internal_name))}
    shapes["penetration"] = n_t, len(structure.contact_name)
    shapes["contact_force"] = *shapes["penetration"], 3
    for name, array in fields.items():
        shape = shapes.get(name, (n_t,))
        if n_t == 0 or array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
            raise SceneSyntaxError(
                "an array of the result file has the wrong type or shape",
                where=where,
                given=f"{name}: {array.dtype} {array.shape}",
                allowed=f"{name}: finite floating-point numbers {shape}, one row a sample",
                hint="simulate again",
            )
