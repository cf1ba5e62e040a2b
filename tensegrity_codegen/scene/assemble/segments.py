"""Cables in segments: each becomes a chain of pieces, whose nodes start on its catenary."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.catenary import find_catenary
from tensegrity_codegen.structure.segments import cut_members
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, TensegrityError

LEAST_SPAN = 1e-2  # of the length: a cable that hangs in a loop starts with its ends so far apart


@dataclass(frozen=True)
class SegmentedParts:
    """Nodes, members and groups of a scene whose cables are cut.

    node, member: fields of Structure; groups: by name, with one more for each cable; share: (n_members,) the
    part of its cable that a member is; cables: names of the cables.
    """

    node: dict[str, Any]
    member: dict[str, Any]
    groups: Mapping[str, Sequence[str]]
    share: FloatArray
    cables: tuple[str, ...] = field(default=())


def cut_cables(
    node: dict[str, Any],
    member: dict[str, Any],
    groups: Mapping[str, Sequence[str]],
    gravity: FloatArray,
    axes: tuple[int, ...],
    where: str,
) -> SegmentedParts:
    """Return the nodes, members and groups of a scene with its cables in segments.

    node, member: what `build_node_arrays` and `build_member_arrays` return; the latter has `segments` too.

    Raises InvalidValueError for segments of a bar or of a cable without mass, DuplicateNameError where pieces
    have the names of other nodes or members.
    """
    member = dict(member)
    counts = member.pop("segments")
    _check_segments(member, counts, where)
    if (counts == 1).all():
        return SegmentedParts(node, member, groups, np.ones(len(counts)))

    def place(e: int, n: int) -> FloatArray:
        first, second = node["node_position"][member["connectivity"][e]]
        return _place_inner(first, second, {key: member[key][e] for key in _OF_SHAPE}, gravity, axes, n)

    cut = cut_members(node, member, counts, place)
    known = {"nodes": node["node_name"], "members": member["member_name"], "groups": tuple(groups)}
    made = {
        "nodes": cut.node["node_name"][len(known["nodes"]) :],
        "members": [cut.member["member_name"][e] for rows in cut.pieces.values() for e in rows],
        "groups": list(cut.pieces),
    }
    for section, names in made.items():
        for name in sorted(set(names) & set(known[section])):
            raise DuplicateNameError(
                f"segments of a cable make {section} of this name",
                where=key_path(where, section, name),
                given=name,
                allowed="names that no cable in segments makes: CABLE, CABLE_1, CABLE_node_1",
                hint="rename it",
            )
    pieces = {name: [cut.member["member_name"][e] for e in rows] for name, rows in cut.pieces.items()}
    spread = {
        name: [piece for one in names for piece in pieces.get(one, [one])] for name, names in groups.items()
    }
    return SegmentedParts(cut.node, cut.member, spread | pieces, 1.0 / counts[cut.owner], tuple(pieces))


_OF_SHAPE = ("rest_length", "spring_constant", "axial_stiffness", "member_mass")


def _check_segments(member: Mapping[str, Any], counts: IntArray, where: str) -> None:
    rules = (
        (member["is_bar"], "a bar has no segments", "only for cables", "take it out"),
        (
            ~member["is_bar"] & (member["member_mass"] == 0),
            "a cable in segments without a mass",
            "segments of a cable with mass_per_length or mass",
            "add mass_per_length [kg/m]",
        ),
    )
    for bad, problem, allowed, hint in rules:
        refuse(
            (counts > 1) & bad, InvalidValueError, problem, section="members", names=member["member_name"],
            where=where, key="segments", given=counts, allowed=allowed, hint=hint,
        )  # fmt: skip


def _place_inner(
    first: FloatArray,
    second: FloatArray,
    cable: Mapping[str, float],
    gravity: FloatArray,
    axes: tuple[int, ...],
    n: int,
) -> FloatArray:
    """Return n - 1 places on the catenary of a cable between two points, on the chord where there is none."""
    part = np.arange(1, n)[:, None] / n
    chord, pull = second - first, float(np.linalg.norm(gravity))
    straight = first + part * chord
    if pull == 0.0:
        return np.asarray(straight)
    up, length = -gravity / pull, float(cable["rest_length"])
    across = chord - (chord @ up) * up
    span = float(np.linalg.norm(across))
    if span < LEAST_SPAN * length:  # nearly vertical: towards the axis that is most across
        unit = np.eye(3)[min(axes, key=lambda axis: abs(up[axis]))]
        across = unit - (unit @ up) * up
    least = LEAST_SPAN * length if length > np.linalg.norm(chord) and across.any() else 0.0
    stiffness = float(cable["axial_stiffness"] + cable["spring_constant"] * length)
    try:
        weight = float(cable["member_mass"]) * pull / length
        found = find_catenary(max(span, least), float(chord @ up), length, weight, stiffness)
    except TensegrityError:
        return np.asarray(straight)
    x, z = found.points(n)[1:-1].T[:, :, None]
    size = float(np.linalg.norm(across))
    unit = across / size if size and math.isfinite(size) else across
    return np.asarray(first + (x - (found.span - span) * part) * unit + z * up)
