"""The actuators and sensors of a scene: names resolved, each checked against the structure."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.targets import Targets, refuse_members
from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.schema.control_schema import ActuatorTable, MemberSensor, NodeSensor
from tensegrity_codegen.structure.actuators import UNLIMITED, Actuator, Sensor
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

Place = tuple[str | int, ...]


def build_actuators(
    stated: Sequence[ActuatorTable], input_name: Iterable[str], targets: Targets, rigid: NDArray[np.bool_]
) -> tuple[Actuator, ...]:
    """Return the actuators of a scene.

    input_name: names of the inputs; rigid: (n_members,), members that have no rest length to change.
    Raises DuplicateNameError, UnknownNameError or InvalidValueError, with file and key.
    """
    taken = dict.fromkeys(input_name, "an input")
    built: list[Actuator] = []
    for number, item in enumerate(stated):
        place = ("actuators", number)
        if item.name in taken:
            raise DuplicateNameError(
                f"the name is that of {taken[item.name]} already",
                where=key_path(targets.where, *place, "name"),
                given=item.name,
                allowed="a name that no other input or actuator has; an actuator is an input too",
                hint="rename it, or remove the other one",
            )
        taken[item.name] = "another actuator"
        members = _find_members(item.members, targets, *place, "members")
        problem = "a rigid bar has no rest length to change"
        refuse_members(members, rigid, problem, targets, (*place, "members"))
        named = (item.members,) if isinstance(item.members, str) else item.members
        own = np.isin(targets.member_name, named)
        problem = "the rest length of a cable in pieces has no actuator, but an input or a single piece"
        refuse_members(members, ~own & (targets.share != 1.0), problem, targets, (*place, "members"))
        limits = _find_range(item, key_path(targets.where, *place, "range"))
        rate = Actuator.rate if item.rate is None else item.rate
        built.append(Actuator(item.name, members, rate, limits, item.delay, item.time_constant))
    return tuple(built)


def build_sensors(
    stated: Sequence[MemberSensor | NodeSensor],
    targets: Targets,
    find_point: Callable[..., int] | None = None,
) -> tuple[Sensor, ...]:
    """Return the sensors of a scene.

    find_point: returns the node of "body.point" in a scene of bodies, None in one of nodes.
    Raises DuplicateNameError, UnknownNameError or InvalidValueError, with file and key.
    """
    built: list[Sensor] = []
    for number, item in enumerate(stated):
        name = item.name or ""
        if name and any(name == other.name for other in built):
            problem = "two sensors under one name"
            location, hint = key_path(targets.where, "sensors", number, "name"), "rename one of the two"
            raise DuplicateNameError(problem, where=location, given=name, allowed="each name once", hint=hint)
        if isinstance(item, MemberSensor):
            every = tuple(range(len(targets.member_name)))
            place = ("sensors", number, "members")
            rows = every if item.members == "all" else _find_members(item.members, targets, *place)
        else:
            rows = _find_nodes(item, number, targets, find_point)
        built.append(Sensor(item.kind, rows, item.noise, name))
    return tuple(built)


def _find_range(item: ActuatorTable, where: str) -> tuple[float, float]:
    if item.range is None:
        return UNLIMITED
    least, most = item.range
    if not least < most:
        problem = "the range of rest lengths is reversed or empty"
        allowed = "[least, largest] rest length [m], the first less than the second"
        hint = f"range = [{most:g}, {least:g}]" if most < least else "remove the key for no limit"
        raise InvalidValueError(problem, where=where, given=[least, most], allowed=allowed, hint=hint)
    return (least, most)


def _find_members(names: str | Sequence[str], targets: Targets, *place: str | int) -> tuple[int, ...]:
    def find(name: str) -> tuple[int, ...]:
        return targets.find_members([name], *place)

    return _find_each_once(names, find, targets.member_name, targets.where, place)


def _find_nodes(
    item: NodeSensor, number: int, targets: Targets, find_point: Callable[..., int] | None
) -> tuple[int, ...]:
    """Return the nodes of a sensor: named as nodes, or in a scene of bodies as points."""
    key, other = ("nodes", "points") if find_point is None else ("points", "nodes")
    wanted = getattr(item, key)
    if getattr(item, other) not in (None, "all") or (getattr(item, other) and wanted):
        what = "nodes, which have no bodies" if find_point is None else "bodies, which have no nodes"
        problem, location = f"this scene is one of {what}", key_path(targets.where, "sensors", number, other)
        hint = f"use {key} in place of {other}"
        raise InvalidValueError(
            problem, where=location, given=getattr(item, other), allowed=f"the key {key!r}", hint=hint
        )
    wanted = wanted or getattr(item, other)
    if wanted is None:
        problem, location = "a needed key is missing", key_path(targets.where, "sensors", number, key)
        allowed = 'names of nodes, or "all"' if find_point is None else '"body.point"; nodes = "all"'
        raise InvalidValueError(problem, where=location, allowed=allowed, hint=f"add {key!r}")
    if wanted == "all":
        return tuple(range(len(targets.node_name)))
    place = ("sensors", number, key)

    def find(name: str) -> tuple[int, ...]:
        if find_point is None:
            return targets.find_nodes([name], *place)
        return (find_point(name, *place),)

    return _find_each_once(wanted, find, targets.node_name, targets.where, place)


def _find_each_once(
    names: str | Sequence[str],
    find: Callable[[str], tuple[int, ...]],
    row_name: Sequence[str],
    where: str,
    place: Place,
) -> tuple[int, ...]:
    """Return the rows that names stand for; raises DuplicateNameError where two names stand for one row."""
    names = (names,) if isinstance(names, str) else names
    source: dict[int, str] = {}
    for name in names:
        for row in find(name):
            if row in source:
                by = "" if name == source[row] else f", by {source[row]!r} and by {name!r}"
                raise DuplicateNameError(
                    f"{row_name[row]!r} is listed twice{by}",
                    where=key_path(where, *place),
                    given=list(names),
                    allowed="each member or node once, by its own name or by one group or class",
                    hint="remove one of the two" if by else f"remove one {name!r}",
                )
            source[row] = name
    if not source:
        problem = "the list stands for nothing: groups or classes without members"
        allowed = "at least one member or node"
        raise InvalidValueError(problem, where=key_path(where, *place), given=list(names), allowed=allowed)
    return tuple(source)
