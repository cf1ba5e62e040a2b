"""Lines of drawings as bars and cables: ends that nearly coincide are one node."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES
from tensegrity_codegen.scene.formats.imported import ImportResult, Network, NetworkMember, build_result
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, StructureError

BARS = ("bar", "strut")  # beginnings of names, in any case
TOLERANCE = 1e-6  # of the size of the drawing
AXIAL_STIFFNESS = 1000.0  # N, of cables where none is given
LARGEST = 1e150  # of coordinates, whose squares are numbers too
MAX_NEIGHBOURS = 100  # of an end within the tolerance, on average


@dataclass(frozen=True)
class Line:
    """A line: its ends (2, 3), whether it is a bar, its place in the file, and its name, "" without one."""

    ends: Any
    is_bar: bool
    where: str
    name: str = ""


def is_bar(*names: str) -> bool:
    """Return whether one of the names of a layer, object or material begins like a bar's."""
    return any(name.lower().startswith(BARS) for name in names)


def build_lines(
    lines: Sequence[Line],
    path: Path,
    name: str | None,
    gravity: Sequence[float] | None,
    tolerance: float | None,
    axial_stiffness: float | None,
    named: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> ImportResult:
    """Return the scene document of lines, and notes; named: positions of the nodes that have names."""
    from scipy.spatial import cKDTree

    # Values in range, places that are numbers
    for key, value in (("tolerance", tolerance), ("axial_stiffness", axial_stiffness)):
        if value is not None and not 0 < value < LARGEST:
            raise InvalidValueError("the value is out of range", where=key, given=value, allowed="above 0")
    if not 0 < len(lines) <= MAX_ENTRIES:
        problem = "the file has too many lines" if lines else "the file has no lines"
        raise StructureError(problem, where=str(path), given=len(lines), allowed=f"1 to {MAX_ENTRIES}")
    ends = np.array([line.ends for line in lines], dtype=float)
    for number in np.flatnonzero(~(np.abs(ends) < LARGEST).all(axis=(1, 2)))[:1]:  # NaN neither
        shown, where = ends[number].tolist(), lines[number].where
        raise NonFiniteError("not a finite place", where=where, given=shown, allowed=f"up to {LARGEST:g}")
    # Ends as nodes, two for each line
    reach = float(np.ptp(ends, axis=(0, 1)).max()) * TOLERANCE if tolerance is None else tolerance
    nodes, positions = _merge(ends.reshape(-1, 3), reach, path)
    pairs = nodes.reshape(-1, 2)
    for number in np.flatnonzero(pairs[:, 0] == pairs[:, 1])[:1]:
        shown, allowed = ends[number].tolist(), f"ends that are more than {reach:g} apart"
        problem = "a line without length"
        raise InvalidValueError(problem, where=lines[number].where, given=shown, allowed=allowed)
    network = Network(notes=[*notes, "lines have no masses: motions need masses of nodes or bars"])
    moved = float(np.linalg.norm(ends.reshape(-1, 3) - positions[nodes], axis=1).max())
    if moved > 1e-3 * reach:
        network.notes.append(f"ends of lines were moved by up to {moved:g} to a node nearby")
    # Nodes by the names of the file, the others by their numbers
    keys = [""] * len(positions)
    node_positions = {
        key: position for key, position in (named or {}).items() if (np.abs(position) < LARGEST).all()
    }
    if node_positions:
        nearest = cKDTree(positions).query(list(node_positions.values()))
        for key, distance, number in zip(node_positions, *nearest, strict=True):
            if distance <= reach:
                keys[number], positions[number] = key, node_positions[key]
    fresh = (key for k in itertools.count(1) if (key := f"n{k}") not in node_positions)
    for number, position in enumerate(positions.tolist()):
        keys[number] = keys[number] or next(fresh)
        network.nodes[keys[number]] = {"position": position}
    # Members, with a stiffness for cables
    counts = {"bar": itertools.count(1), "cable": itertools.count(1)}
    stiffness = {"axial_stiffness": AXIAL_STIFFNESS if axial_stiffness is None else axial_stiffness}
    for line, (start, end) in zip(lines, pairs.tolist(), strict=True):
        kind = "bar" if line.is_bar else "cable"
        title = network.name_member(line.name or f"{kind}{next(counts[kind])}")
        values: dict[str, Any] = {"kind": kind, **({} if line.is_bar else stiffness)}
        network.members.append(NetworkMember(title, (keys[start], keys[end]), values, line.where))
    if axial_stiffness is None and not all(line.is_bar for line in lines):
        network.notes.append(
            f"lines have no stiffness: EA of cables is {AXIAL_STIFFNESS:g} N, `axial_stiffness` changes it"
        )
    return build_result(network, path, name, gravity)


def _merge(ends: FloatArray, reach: float, path: Path) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the node of each end, and the positions of nodes; ends in steps up to `reach` are one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    different, row = np.unique(ends, axis=0, return_inverse=True)
    tree, count = cKDTree(different), len(different)
    some = different[:: count // 1000 + 1]
    if tree.query_ball_point(some, reach, return_length=True).mean() > MAX_NEIGHBOURS:
        raise InvalidValueError("the tolerance merges nearly all ends", where=str(path), given=reach)
    pairs = tree.query_pairs(reach, output_type="ndarray")
    joined = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    group = connected_components(joined, directed=False)[1][row.ravel()]
    first_row, node = np.unique(group, return_index=True, return_inverse=True)[1:]
    order = np.argsort(first_row)
    return np.argsort(order)[node], ends[first_row[order]]
