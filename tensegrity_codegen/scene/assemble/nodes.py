"""From nodes and loads of a scene to the node arrays of a structure."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.part_schema import Load, Node
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError


def build_node_arrays(nodes: Mapping[str, Node], axes: tuple[int, ...], where: str) -> dict[str, Any]:
    """Return the fields of Structure that are about nodes, by name, without loads.

    Raises InvalidValueError (a vector of the wrong size, an axis that is not modelled).
    """
    names = tuple(nodes)
    rows = list(nodes.values())
    places = [("nodes", name) for name in names]
    position = spread_vectors([row.position for row in rows], axes, [(*p, "position") for p in places], where)
    velocity = spread_vectors([row.velocity for row in rows], axes, [(*p, "velocity") for p in places], where)
    return {
        "node_name": names,
        "node_position": position,
        "node_velocity": velocity,
        "node_mass": np.array([row.mass or 0.0 for row in rows], dtype=np.float64),
        "node_anchored": _anchored(names, rows, axes, where),
    }


def spread_vectors(
    vectors: Sequence[tuple[float, ...] | None],
    axes: tuple[int, ...],
    places: Sequence[tuple[str | int, ...]],
    where: str,
) -> FloatArray:
    """Return (n, 3) from vectors of 3 numbers or of one number for each modelled axis; None is zero."""
    table = np.zeros((len(vectors), 3))
    width = np.array([-1 if vector is None else len(vector) for vector in vectors], dtype=np.int64)
    wrong = np.flatnonzero((width != -1) & (width != 3) & (width != len(axes)))
    if wrong.size:
        full = "" if len(axes) == 3 else f" or {len(axes)}"
        problem, location = "a vector of the wrong size", key_path(where, *places[wrong[0]])
        allowed = f"3{full} numbers"
        raise InvalidValueError(problem, where=location, given=list(vectors[wrong[0]] or ()), allowed=allowed)
    for size, columns in ((3, (0, 1, 2)), (len(axes), axes)):
        rows = np.flatnonzero(width == size).tolist()
        if rows:
            table[np.ix_(rows, columns)] = np.array([vectors[row] for row in rows])
    return table


def _anchored(
    names: tuple[str, ...], rows: list[Node], axes: tuple[int, ...], where: str
) -> NDArray[np.bool_]:
    modelled = "".join("xyz"[axis] for axis in axes)
    letters = ["xyz" if row.anchored is True else (row.anchored or "") for row in rows]
    for name, row in zip(names, rows, strict=True):
        if isinstance(row.anchored, str) and not set(row.anchored) <= set(modelled):
            problem = "anchored on an axis that the scene does not model"
            location = key_path(where, "nodes", name, "anchored")
            allowed = f"true, false, or some of {modelled!r}"
            raise InvalidValueError(problem, where=location, given=row.anchored, allowed=allowed)
    flags = {word: tuple(axis in word for axis in "xyz") for word in set(letters)}
    return np.array([flags[word] for word in letters], dtype=np.bool_).reshape(-1, 3)


def build_node_load(
    names: tuple[str, ...], loads: Sequence[Load], axes: tuple[int, ...], where: str
) -> FloatArray:
    """Return the load on each node, (n_nodes, 3) [N]; loads on one node add up.

    Raises InvalidValueError (a vector of the wrong size) or UnknownNameError (a load on an unknown node).
    """
    index = {name: row for row, name in enumerate(names)}
    for number, load in enumerate(loads):
        problem, allowed = "a load on a node that is not defined", "the name of a node"
        check_known(load.node, index, problem, allowed, where, "loads", number, "node")
    places = [("loads", number, "force") for number in range(len(loads))]
    total = np.zeros((len(names), 3))
    target = np.array([index[load.node] for load in loads], dtype=np.int64)
    np.add.at(total, target, spread_vectors([load.force for load in loads], axes, places, where))
    return total
