"""Cables in segments: each becomes a chain of equal pieces, whose nodes start on its catenary.

n pieces have n times the spring constant and damping, and 1/n of rest length and mass. A chain errs by
O(1/n^2) against the catenary.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tensegrity_codegen.scene.names import check_names
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.catenary import find_catenary
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError
from tensegrity_codegen.tables.laws import LAWS

# Exponent of n in the values of a piece; others are those of the member.
_POWER = {"rest_length": -1.0, "spring_constant": 1.0, "damping": 1.0, "member_mass": -1.0} | {
    item.name: -1.0 for law in LAWS for item in law.parameters if item.unit == "m"
}
LEAST_SPAN = 1e-2  # of the length: so far apart a cable that hangs in a loop starts with its ends


class SegmentedParts(NamedTuple):
    """Nodes, members and groups of a scene whose cables are cut.

    node, member: fields of Structure; groups: by name, with one more for each cable; share: (n_members,) the
    part of its cable that a member is; cables: names of the cables.
    """

    node: dict[str, Any]
    member: dict[str, Any]
    groups: Mapping[str, Sequence[str]]
    share: FloatArray
    cables: tuple[str, ...] = ()


def cut_cables(
    node: dict[str, Any],
    member: dict[str, Any],
    groups: Mapping[str, Sequence[str]],
    gravity: FloatArray,
    axes: tuple[int, ...],
    where: str,
) -> SegmentedParts:
    """Return the nodes, members and groups of a scene with its cables in segments.

    Pieces are NAME_1 to NAME_n, at the place of the cable; the nodes between them, NAME_node_1 to
    NAME_node_(n - 1), come after all others. node, member: what `build_node_arrays` and `build_member_arrays`
    return; the latter has `segments` too.

    Raises InvalidValueError for segments of a cable without mass, DuplicateNameError where pieces have the
    names of other nodes, members or groups.
    """
    counts, names = member["segments"], member["member_name"]
    member = {key: value for key, value in member.items() if key != "segments"}
    if (counts == 1).all():
        return SegmentedParts(node, member, groups, np.ones(len(counts)))
    refuse(
        (counts > 1) & (member["member_mass"] == 0), InvalidValueError, "a cable in segments without a mass",
        section="members", names=names, where=where, key="segments", given=counts,
        allowed="segments of a cable with mass_per_length or mass", hint="add mass_per_length [kg/m]",
    )  # fmt: skip
    cut = np.flatnonzero(counts > 1).tolist()
    pieces = {names[e]: [f"{names[e]}_{k + 1}" for k in range(counts[e])] for e in cut}
    inner = [f"{names[e]}_node_{k}" for e in cut for k in range(1, counts[e])]
    nodes: dict[str, Any] = {"node_name": (*node["node_name"], *inner)}
    own = {"member_name": tuple(piece for name in names for piece in pieces.get(name, [name]))}
    made = (nodes["node_name"], "nodes"), (own["member_name"], "members"), ((*groups, *pieces), "groups")
    for new, section in made:
        check_names(new, section, where)
    # The ends of all pieces, and their values.
    ends: list[tuple[int, int]] = []
    owner, first = np.repeat(np.arange(len(counts)), counts), len(node["node_name"])
    for (i, j), count in zip(member["connectivity"].tolist(), counts.tolist(), strict=True):
        ends += itertools.pairwise([i, *range(first, first + count - 1), j])
        first += count - 1
    values = {key: _cut(key, value, owner, counts) for key, value in member.items()}
    values |= own | {"connectivity": np.array(ends, dtype=np.int64)}
    # Inner nodes move with the ends of their cable; their masses are those of members, and they are free.
    fresh: dict[str, list[FloatArray]] = {"node_position": [], "node_velocity": []}
    for e in cut:
        part, pair = np.arange(1, counts[e])[:, None] / counts[e], member["connectivity"][e]
        cable = {key: float(member[key][e]) for key in _OF_SHAPE}
        fresh["node_position"].append(_place(node["node_position"][pair], cable, gravity, axes, part))
        speed = node["node_velocity"][pair]
        fresh["node_velocity"].append(speed[0] + part * (speed[1] - speed[0]))
    for key in node.keys() - nodes.keys():
        value = node[key]
        added = fresh.get(key, [np.zeros((len(inner), *value.shape[1:]), value.dtype)])
        nodes[key] = np.concatenate([value, *added])
    spread = {
        name: [piece for one in group for piece in pieces.get(one, [one])] for name, group in groups.items()
    }
    return SegmentedParts(nodes, values, spread | pieces, 1.0 / counts[owner], tuple(pieces))


_OF_SHAPE = ("rest_length", "spring_constant", "axial_stiffness", "member_mass")


def _cut(key: str, value: Any, owner: IntArray, counts: IntArray) -> Any:
    """Return the values of pieces from those of members."""
    if isinstance(value, Mapping):
        return {name: _cut(name, values, owner, counts) for name, values in value.items()}
    if isinstance(value, tuple):  # no rings at all are ()
        return tuple(value[e] for e in owner.tolist()) if value else value
    if value is None or key not in _POWER:
        return value if value is None else value[owner]
    return value[owner] * counts[owner] ** _POWER[key]


def _place(
    ends: FloatArray, cable: Mapping[str, float], gravity: FloatArray, axes: tuple[int, ...], part: FloatArray
) -> FloatArray:
    """Return places at parts (n, 1) of a cable on its catenary, on the chord where there is none, (n, 3)."""
    chord, pull, length = ends[1] - ends[0], float(np.linalg.norm(gravity)), cable["rest_length"]
    straight: FloatArray = ends[0] + part * chord
    up = -gravity / (pull or 1.0)
    across = chord - (chord @ up) * up
    span = least = float(np.linalg.norm(across))
    if span < LEAST_SPAN * length and length > np.linalg.norm(chord):  # to the axis that is most across
        unit = np.eye(3)[min(axes, key=lambda axis: abs(up[axis]))]
        across = unit - (unit @ up) * up
        least = LEAST_SPAN * length if across.any() else span
    try:
        weight = cable["member_mass"] * pull / length
        stiffness = cable["axial_stiffness"] + cable["spring_constant"] * length
        found = find_catenary(least, float(chord @ up), length, weight, stiffness)
    except TensegrityError:
        return straight
    x, z = found.position(part[:, 0] * length).T[:, :, None]
    unit = across / (float(np.linalg.norm(across)) or 1.0)
    return np.asarray(ends[0] + (x - (least - span) * part) * unit + z * up)
