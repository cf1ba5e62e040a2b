"""A file of starts: initial states and run-time arguments of many motions, by name."""

from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.array_file import UNREADABLE, read_arrays, read_names
from tensegrity_codegen.runtime.model.named_inputs import unify_name
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneSyntaxError,
    UnknownNameError,
    describe_reason,
    suggest,
)
from tensegrity_codegen.tables.manifest import Manifest

OF_NODES = {"node_position": "coordinate", "node_velocity": "velocity"}
HELD_TOLERANCE = 1e-9  # of the largest entry, by which what is held may differ from the scene


def read_starts(path: str | Path, manifest: Manifest) -> dict[str, Any]:
    """Return coordinate, velocity and arguments for `simulate_batch` from an .npz file.

    It holds one or more of coordinate and velocity (n_batch, n_coordinates), node_position and node_velocity
    (n_batch, n_nodes, 3), and run-time arguments and inputs by name, those without a leading axis for all
    motions.
    Raises SceneSyntaxError for what is no such file, UnknownNameError for another name, InvalidValueError for
    nodes that are moved where they are held.
    """
    arguments = [item.name for item in manifest.arguments if item.name not in OF_NODES.values()]
    arguments += [name for name in manifest.input_name if unify_name(manifest, name) != name]
    states = [*OF_NODES.values(), *(OF_NODES if manifest.coordinate_node_axis else ())]
    try:
        for name in read_names(Path(path)):
            if name not in (*states, *arguments):
                raise UnknownNameError(
                    "neither a state nor a run-time argument",
                    where=str(path),
                    given=name,
                    allowed=", ".join((*states, *arguments)),
                    hint=suggest(name, (*states, *arguments)),
                )
        data = read_arrays(Path(path), (*states, *arguments))
    except UNREADABLE as error:
        raise SceneSyntaxError(
            "not a file of initial states",
            where=str(path),
            given=describe_reason(error),
            allowed="an .npz file of NumPy arrays",
        ) from error
    found: dict[str, Any] = {"arguments": {}}
    for name, array in data.items():
        if name in arguments:
            found["arguments"][name] = array
            continue
        key = OF_NODES.get(name, name)
        if key in found:
            of_nodes = next(known for known, state in OF_NODES.items() if state == key)
            raise InvalidValueError(
                "two arrays give the same state",
                where=str(path),
                given=f"{of_nodes} and {key}",
                allowed=f"one of {of_nodes} and {key}",
            )
        found[key] = _pick(array, name, manifest, str(path)) if name in OF_NODES else array
    return found


def _pick(array: FloatArray, name: str, manifest: Manifest, where: str) -> FloatArray:
    """Return the free coordinates (n_batch, n_coordinates) of all nodes' values (n_batch, n_nodes, 3)."""
    stated = manifest.stated_position if name == "node_position" else np.zeros((len(manifest.node_name), 3))
    if array.ndim != 3 or array.shape[1:] != stated.shape or array.dtype.kind not in "fiu":
        raise InvalidValueError(
            "wrong shape",
            where=f"{where}: {name}",
            given=f"{array.dtype} {array.shape}",
            allowed=f"numbers (n_batch, {len(stated)}, 3)",
        )
    places = manifest.coordinate_place
    is_held = np.ones(stated.shape, dtype=bool)
    is_held[places[:, 0], places[:, 1]] = False
    apart = np.where(is_held, np.abs(array - stated), 0.0)
    if not np.all(apart <= HELD_TOLERANCE * max(1.0, float(np.abs(stated).max()))):
        motion, node, _ = (int(k) for k in np.argwhere(~(apart <= HELD_TOLERANCE))[0])
        raise InvalidValueError(
            "an anchored node cannot start at another position",
            where=f"{where}: {name}",
            given=f"motion {motion}, node {manifest.node_name[node]}: {array[motion, node].tolist()}",
            allowed=f"{stated[node].tolist()} on the anchored axes",
        )
    return np.ascontiguousarray(array[:, places[:, 0], places[:, 1]], dtype=np.float64)
