"""Cables in segments: each becomes a chain of equal pieces, whose nodes start on its catenary.

n pieces have n times the spring constant and damping, and 1/n of rest length and mass. A chain errs by
O(1/n^2) against the catenary.

Cables with friction at rings become a member for each of their segments between rings, which slip into one
another. These share the rest length in proportion to their lengths, so that they begin with one tension, and
have the axial stiffness EA of the cable. A change of the rest length of the cable by its name, group or class
is one of its first segment: there the winch stands.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tensegrity_codegen.scene.names import check_known, check_names, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.scene.schema.part_schema import Member
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.catenary import find_catenary
from tensegrity_codegen.structure.sliding import MAX_RINGS, SlidingCable
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, TensegrityError
from tensegrity_codegen.tables.laws import LAWS

# Exponent of n in the values of a piece; others are those of the member.
_POWER = {"rest_length": -1.0, "spring_constant": 1.0, "damping": 1.0, "member_mass": -1.0} | {
    item.name: -1.0 for law in LAWS for item in law.parameters if item.unit == "m"
}
MIN_SPAN = 1e-2  # of the length: so far apart a cable that hangs in a loop starts with its ends


class SegmentedParts(NamedTuple):
    """Fields of Structure for nodes and members whose cables are cut; share: of its cable; cables: names."""

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
    changed = {"member_name": tuple(piece for name in names for piece in pieces.get(name, [name]))}
    made = (nodes["node_name"], "nodes"), (changed["member_name"], "members"), ((*groups, *pieces), "groups")
    for new, section in made:
        check_names(new, section, where)
    # The ends of all pieces, and their values.
    ends: list[tuple[int, int]] = []
    owner, node_start = np.repeat(np.arange(len(counts)), counts), len(node["node_name"])
    for (i, j), count in zip(member["connectivity"].tolist(), counts.tolist(), strict=True):
        ends += itertools.pairwise([i, *range(node_start, node_start + count - 1), j])
        node_start += count - 1
    values = {key: _cut(key, value, owner, counts) for key, value in member.items()}
    values |= changed | {"connectivity": np.array(ends, dtype=np.int64)}
    # Inner nodes move with the ends of their cable; their masses are those of members, and they are free.
    fresh: dict[str, list[FloatArray]] = {"node_position": [], "node_velocity": []}
    for e in cut:
        fraction, pair = np.arange(1, counts[e])[:, None] / counts[e], member["connectivity"][e]
        cable = {key: float(member[key][e]) for key in _OF_SHAPE}
        fresh["node_position"].append(_place(node["node_position"][pair], cable, gravity, axes, fraction))
        speed = node["node_velocity"][pair]
        fresh["node_velocity"].append(speed[0] + fraction * (speed[1] - speed[0]))
    for key in node.keys() - nodes.keys():
        value = node[key]
        added = fresh.get(key, [np.zeros((len(inner), *value.shape[1:]), value.dtype)])
        nodes[key] = np.concatenate([value, *added])
    spread = {
        name: [piece for member_name in group for piece in pieces.get(member_name, [member_name])]
        for name, group in groups.items()
    }
    return SegmentedParts(nodes, values, spread | pieces, 1.0 / counts[owner], tuple(pieces))


_OF_SHAPE = ("rest_length", "spring_constant", "axial_stiffness", "member_mass")


def _cut(key: str, value: Any, owner: IntArray, counts: IntArray) -> Any:
    """Return the values of pieces from those of members."""
    if isinstance(value, Mapping):
        return {name: _cut(name, values, owner, counts) for name, values in value.items()}
    spread = _spread(value, owner)
    return spread * counts[owner] ** _POWER[key] if key in _POWER else spread


def _place(
    ends: FloatArray, cable: Mapping[str, float], gravity: FloatArray, axes: tuple[int, ...], part: FloatArray
) -> FloatArray:
    """Return places at parts (n, 1) of a cable on its catenary, on the chord where there is none, (n, 3)."""
    chord, pull, length = ends[1] - ends[0], float(np.linalg.norm(gravity)), cable["rest_length"]
    straight: FloatArray = ends[0] + part * chord
    up = -gravity / (pull or 1.0)
    across = chord - (chord @ up) * up
    span = min_span = float(np.linalg.norm(across))
    if span < MIN_SPAN * length and length > np.linalg.norm(chord):  # to the axis that is most across
        unit = np.eye(3)[min(axes, key=lambda axis: abs(up[axis]))]
        across = unit - (unit @ up) * up
        min_span = MIN_SPAN * length if across.any() else span
    try:
        weight = cable["member_mass"] * pull / length
        stiffness = cable["axial_stiffness"] + cable["spring_constant"] * length
        catenary = find_catenary(min_span, float(chord @ up), length, weight, stiffness)
    except TensegrityError:
        return straight
    x, z = catenary.position(part[:, 0] * length).T[:, :, None]
    unit = across / (float(np.linalg.norm(across)) or 1.0)
    return np.asarray(ends[0] + (x - (min_span - span) * part) * unit + z * up)


MAX_EXPONENT = 40.0  # friction times wrap: beyond it a ring is a clamp

Values = tuple[str, tuple[str, ...], Any, Any]  # place of its keys, strands, friction, wrap


def cut_at_rings(
    parts: SegmentedParts, scene: Scene, members: Mapping[str, Member], where: str
) -> tuple[SegmentedParts, tuple[SlidingCable, ...]]:
    """Return the parts of a scene with its cables cut at rings with friction, and these cables.

    parts: what `cut_cables` returns; members: of the scene, by name. Strands are NAME_1 and so on, at the
    place of the cable, and group NAME holds them.
    """
    stated = _find_stated(scene, members, where)
    cables: dict[str, Values] = {}
    index = {name: e for e, name in enumerate(parts.member["member_name"])}
    rings = parts.member["ring_nodes"]
    for name, (friction, wrap) in stated.items():
        count = len(rings[index[name]]) if rings and name in index else 0
        path = key_path(where, "members", name)
        if not count:
            problem, location = "friction of a member that passes no ring", f"{path}.friction"
            allowed = "cables in one piece with more than two nodes"
            hint = "leave friction out, or list the rings among its nodes"
            raise InvalidValueError(problem, where=location, given=friction, allowed=allowed, hint=hint)
        strands = tuple(f"{name}_{k + 1}" for k in range(count + 1))
        cables[name] = (path, strands, friction, wrap)
    if cables:
        parts = _cut_at_strands(parts, {name: strands for name, (_, strands, _, _) in cables.items()}, where)
    for name, table in scene.sliding.items():
        path = key_path(where, "sliding", name)
        if name in cables:
            problem = "a cable of this name has friction already"
            raise DuplicateNameError(problem, where=path, given=name, allowed="another name")
        cables[name] = (path, table.strands, table.friction, table.wrap_deg)
    _refuse_shared(cables)
    return parts, tuple(_build(name, values, parts) for name, values in cables.items())


def _refuse_shared(found: Mapping[str, Values]) -> None:
    """Raise DuplicateNameError for a strand of two cables."""
    owner: dict[str, str] = {}
    for name, (location, strands, *_) in found.items():
        for strand in dict.fromkeys(strands):
            if strand in owner:
                problem = f"the strand belongs to the cable {owner[strand]!r} already"
                allowed = "strands of no other cable"
                raise DuplicateNameError(problem, where=f"{location}.strands", given=strand, allowed=allowed)
            owner[strand] = name


def _find_stated(scene: Scene, members: Mapping[str, Member], where: str) -> dict[str, tuple[Any, Any]]:
    """Return friction and wrap of the members that have friction by themselves or, at rings, by class."""
    stated: dict[str, tuple[Any, Any]] = {}
    for name, row in members.items():
        shared = scene.classes.get(row.class_name or "")
        friction, wrap = row.friction, row.wrap_deg
        if shared is not None and len(row.nodes) > 2:
            friction = shared.friction if friction is None else friction
            wrap = shared.wrap_deg if wrap is None else wrap
        if friction is None and row.wrap_deg is not None:
            problem = "an angle of wrap without friction"
            location = f"{key_path(where, 'members', name)}.wrap_deg"
            raise InvalidValueError(problem, where=location, given=row.wrap_deg, allowed="only with friction")
        if friction is not None and np.any(friction):
            stated[name] = (friction, wrap)
    return stated


def _cut_at_strands(
    parts: SegmentedParts, pieces: Mapping[str, tuple[str, ...]], where: str
) -> SegmentedParts:
    """Return the parts with these cables cut into strands of these names."""
    member, names = parts.member, parts.member["member_name"]
    new_names = tuple(itertools.chain.from_iterable(pieces.get(name, (name,)) for name in names))
    check_names(new_names, "members", where)
    check_names((*parts.groups, *pieces), "groups", where)
    counts = np.array([len(pieces.get(name, (name,))) for name in names])
    owner = np.repeat(np.arange(len(names)), counts)
    values = {key: _spread(value, owner) for key, value in member.items()}
    fraction, stiffness = np.ones(len(owner)), values["axial_stiffness"]
    stiffness = np.where(np.isin(owner, [names.index(name) for name in pieces]), 0.0, stiffness)
    position, ends, start = parts.node["node_position"], values["connectivity"].copy(), 0
    for e, (name, count) in enumerate(zip(names, counts.tolist(), strict=True)):
        rows = slice(start, start + count)
        if name in pieces:
            i, j = member["connectivity"][e].tolist()
            path = np.array([i, *member["ring_nodes"][e], j])
            ends[rows] = np.stack([path[:-1], path[1:]], axis=1)
            length = np.linalg.norm(np.diff(position[path], axis=0), axis=1)
            fraction[rows] = length / length.sum()
            rest_length = member["rest_length"][e]
            stiffness[rows] = member["axial_stiffness"][e] + member["spring_constant"][e] * rest_length
            values["spring_constant"][rows] = 0.0
        start += count
    rings = member["ring_nodes"]
    changed = {
        "member_name": new_names,
        "connectivity": ends,
        "axial_stiffness": stiffness,
        "rest_length": values["rest_length"] * fraction,
        "damping": values["damping"] / fraction,
        "ring_nodes": tuple(() if names[e] in pieces else rings[e] for e in owner.tolist()),
    }
    if not any(changed["ring_nodes"]):
        changed["ring_nodes"] = ()
    groups = {
        name: [piece for member_name in group for piece in pieces.get(member_name, (member_name,))]
        for name, group in parts.groups.items()
    }
    # A change of the rest length of a cable is one of its first strand
    acts = parts.share[owner] * np.r_[True, owner[1:] != owner[:-1]]
    cables = (*parts.cables, *pieces)
    return SegmentedParts(parts.node, values | changed, groups | dict(pieces), acts, cables)


def _spread(value: Any, owner: Any) -> Any:
    """Return the values of strands from those of members."""
    if isinstance(value, Mapping):
        return {name: _spread(values, owner) for name, values in value.items()}
    if isinstance(value, tuple):  # no rings at all are ()
        return tuple(value[e] for e in owner.tolist()) if value else value
    return value if value is None else value[owner]


def _build(name: str, values: Values, parts: SegmentedParts) -> SlidingCable:
    """Return a cable with friction from its strands; raises for strands that cannot slip."""
    location, strands, *stated = values
    names, member = parts.member["member_name"], parts.member
    index = {member_name: e for e, member_name in enumerate(names)}
    for strand in strands:
        check_known(strand, index, "the strand is no member", "names of members", f"{location}.strands")
    rows = [index[strand] for strand in strands]
    laws = np.array(list(member["law_parameter"].values())).reshape(-1, len(names))
    previous_end, next_start = member["connectivity"][rows[:-1], 1], member["connectivity"][rows[1:], 0]
    rings = member["ring_nodes"]
    problems = {
        f"more than {MAX_RINGS} rings with friction in one cable": len(rows) > MAX_RINGS + 1,
        "strands that do not follow each other": bool((next_start != previous_end).any())
        or len(set(rows)) < len(rows)
        or any(rings[e] for e in rows if rings),
        "friction at rings without damping, by which the cable comes to rest as it slips": bool(
            (member["damping"][rows] == 0).any()
        ),
        "friction at rings of what is no cable that only pulls": not member["tension_only"][rows].all(),
        "friction at rings of a cable that is not linear": bool(laws[:, rows].any()),
        "friction at rings of a cable with mass": bool(member["member_mass"][rows].any()),
        "friction at rings of strands without axial_stiffness": not member["axial_stiffness"][rows].all(),
    }
    allowed = "linear cables without mass, with axial_stiffness or spring_constant, and damping above 0"
    for problem, is_there in problems.items():
        if is_there:
            hint = "give damping [N s/m]: slip comes to rest within about damping / stiffness seconds"
            hint = hint if "damping," in problem else ""
            raise InvalidValueError(problem, where=location, given=list(strands), allowed=allowed, hint=hint)
    friction, wrap = (
        _of_rings(value, len(rows) - 1, f"{location}.{key}")
        for key, value in zip(("friction", "wrap_deg"), stated, strict=True)
    )
    largest = max(mu * np.radians(angle or 180.0) for mu, angle in zip(friction, wrap, strict=True))
    if largest > MAX_EXPONENT:
        problem = "friction times the angle of wrap is so large that nothing slips"
        allowed, hint = f"up to {MAX_EXPONENT:g} rad", "end the cable there, and begin another one"
        raise InvalidValueError(
            problem, where=f"{location}.friction", given=f"{largest:.6g} rad", allowed=allowed, hint=hint
        )
    return SlidingCable(name, strands, tuple(rows), friction, wrap)


def _of_rings(value: Any, count: int, place: str) -> tuple[float, ...]:
    """Return a number for each ring."""
    values = (float(value or 0.0),) * count if not isinstance(value, tuple) else value
    if len(values) != count:
        problem = "not one number for each ring"
        allowed = "one number" if count == 1 else f"{count} numbers, or one for all"
        raise InvalidValueError(problem, where=place, given=list(values), allowed=allowed)
    return values
