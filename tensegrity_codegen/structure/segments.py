"""Cables with mass in segments: members cut into chains of equal pieces, and what a chain says of its cable.

n pieces have n times the spring constant and damping, and 1/n of rest length and mass. A chain errs by
O(1/n^2) against the catenary.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.laws import LAWS

# Exponent of n in the values of a piece; others are those of the member.
_POWER = {"rest_length": -1, "spring_constant": 1, "damping": 1, "member_mass": -1} | {
    item.name: -1 for law in LAWS for item in law.parameters if item.unit == "m"
}

# Fields of Structure that are about members and are not called member_...
_OF_MEMBERS = (
    *("connectivity", "is_bar", "tension_only", "rest_length", "spring_constant", "axial_stiffness"),
    *("damping", "radius", "inner_radius", "thermal_expansion", "law_parameter"),
)

Arrays = Mapping[str, Any]  # fields of Structure that are about nodes, or about members


@dataclass(frozen=True)
class CutMembers:
    """Nodes and members after some members were cut.

    node, member: fields of Structure; owner: (n_members,) the member that each piece was; pieces: the pieces
    of each member that was cut, by its name.
    """

    node: dict[str, Any]
    member: dict[str, Any]
    owner: IntArray
    pieces: dict[str, tuple[int, ...]]


def cut_members(
    node: Arrays, member: Arrays, counts: IntArray, place: Callable[[int, int], FloatArray]
) -> CutMembers:
    """Return nodes and members with member e as a chain of counts[e] equal pieces.

    Pieces are NAME_1 to NAME_n, at the place of the member; the nodes between them, NAME_node_1 to
    NAME_node_(n - 1), come after all others. place(e, n): positions of the inner nodes of e, (n - 1, 3) [m].
    """
    owner = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)  # in the chain, from 0
    first_new = len(node["node_name"]) + np.cumsum(counts - 1) - (counts - 1)
    ends = member["connectivity"][owner].copy()
    inner = first_new[owner] + number
    ends[number > 0, 0] = inner[number > 0] - 1
    ends[number < counts[owner] - 1, 1] = inner[number < counts[owner] - 1]
    # Values of pieces.
    names = member["member_name"]
    parts = {key: _cut_values(key, value, owner, counts) for key, value in member.items()}
    parts["connectivity"] = ends
    parts["member_name"] = tuple(
        names[e] if counts[e] == 1 else f"{names[e]}_{k + 1}"
        for e, k in zip(owner.tolist(), number.tolist(), strict=True)
    )
    # Inner nodes, cable by cable.
    cut = np.flatnonzero(counts > 1).tolist()
    share = [np.arange(1, counts[e])[:, None] / counts[e] for e in cut]
    ends_of = [member["connectivity"][e] for e in cut]
    velocity = node["node_velocity"]
    more = {
        "node_name": tuple(f"{names[e]}_node_{k}" for e in cut for k in range(1, int(counts[e]))),
        "node_position": [place(e, int(counts[e])) for e in cut],
        "node_velocity": [
            (1 - part) * velocity[i] + part * velocity[j] for part, (i, j) in zip(share, ends_of, strict=True)
        ],
    }
    nodes = {key: _extend(value, more.get(key), int((counts - 1).sum())) for key, value in node.items()}
    pieces = {names[e]: tuple(np.flatnonzero(owner == e).tolist()) for e in cut}
    return CutMembers(nodes, parts, owner, pieces)


def _cut_values(key: str, value: Any, owner: IntArray, counts: IntArray) -> Any:
    if isinstance(value, Mapping):
        return {name: _cut_values(name, values, owner, counts) for name, values in value.items()}
    if isinstance(value, tuple):
        return tuple(value[e] for e in owner.tolist())
    power = _POWER.get(key, 0)
    return value if value is None else value[owner] * counts[owner] ** float(power) if power else value[owner]


def _extend(value: Any, more: Any, count: int) -> Any:
    """Return values of nodes with those of `count` inner nodes behind them, zero where none are given."""
    if isinstance(value, tuple):
        return (*value, *more)
    added = np.zeros((count, *value.shape[1:]), dtype=value.dtype) if not more else np.concatenate(more)
    return np.concatenate([value, added])


def find_chains(structure: Structure) -> dict[str, tuple[int, ...]]:
    """Return the groups that are cables in segments: cables with mass, each from the end of the last one."""
    found = {}
    for name, members in structure.groups.items():
        rows = list(members)
        heavy = ~structure.is_bar[rows] & (structure.member_mass[rows] > 0)
        ends = structure.connectivity[rows]
        if len(rows) > 1 and heavy.all() and (ends[:-1, 1] == ends[1:, 0]).all():
            found[name] = tuple(rows)
    return found


def halve_segments(structure: Structure) -> Structure:
    """Return the structure with each segment of its cables cut in two, without sensors and limits."""
    counts = np.ones(structure.n_members, dtype=np.int64)
    for rows in find_chains(structure).values():
        counts[list(rows)] = 2

    def place(e: int, n: int) -> FloatArray:
        return np.asarray(structure.node_position[structure.connectivity[e]].mean(axis=0, keepdims=True))

    fields = vars(structure)
    node = {key: fields[key] for key in fields if key.startswith("node_")}
    member = {key: fields[key] for key in fields if key.startswith("member_") or key in _OF_MEMBERS}
    cut = cut_members(node, member, counts, place)

    def spread(rows: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(k for e in rows for k in np.flatnonzero(cut.owner == e).tolist())

    inputs = [
        item
        if item.kind == "force"
        else replace(
            item,
            targets=spread(tuple(item.rest_length_gain)),
            gain=tuple(
                g / int(counts[e]) for e, g in item.rest_length_gain.items() for _ in range(counts[e])
            ),
        )
        for item in structure.inputs
    ]
    pairs = structure.interference
    return structure.with_changes(
        **cut.node,
        **cut.member,
        groups={name: spread(rows) for name, rows in structure.groups.items()},
        inputs=tuple(inputs),
        actuators=(),
        sensors=(),
        limits=Limits(),
        interference=None if pairs is None else tuple((spread((i,))[0], spread((j,))[0]) for i, j in pairs),
    )


@dataclass(frozen=True)
class ChainShape:
    """A cable in segments at rest: its larger end tension [N], its largest distance from the chord [m]."""

    n_segments: int
    end_tension: float
    sag: float


def measure_chains(
    structure: Structure, node_position: FloatArray, member_tension: FloatArray
) -> dict[str, ChainShape]:
    """Return the shapes of all cables in segments, from positions (n_nodes, 3) [m] and tensions [N]."""
    return {
        name: _measure(structure, list(rows), node_position, member_tension)
        for name, rows in find_chains(structure).items()
    }


def _measure(structure: Structure, rows: list[int], position: FloatArray, tension: FloatArray) -> ChainShape:
    # Half of the weight of the last piece stands at the end itself: with it the tension errs by O(1/n^2).
    ends = structure.connectivity[rows]
    pull = []
    for row, here, there in ((rows[0], ends[0, 0], ends[0, 1]), (rows[-1], ends[-1, 1], ends[-1, 0])):
        vector = position[there] - position[here]
        weight = structure.member_mass[row] / 2 * structure.gravity
        pull.append(float(np.linalg.norm(tension[row] * vector / np.linalg.norm(vector) + weight)))
    # The largest distance from the chord, by a parabola through the farthest node and its neighbours.
    path = position[np.append(ends[:, 0], ends[-1, 1])]
    chord = path[-1] - path[0]
    unit = chord / max(float(np.linalg.norm(chord)), 1e-300)
    offset = path - path[0]
    distance: NDArray[np.float64] = np.linalg.norm(offset - np.outer(offset @ unit, unit), axis=1)
    k = int(distance[1:-1].argmax()) + 1
    before, peak, after = distance[k - 1 : k + 2]
    bend = 2 * peak - before - after
    sag = peak + (after - before) ** 2 / (8 * bend) if bend > 0 else peak
    return ChainShape(len(rows), max(pull), float(sag))
