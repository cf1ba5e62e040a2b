"""Actuators, sensors and limits of a scene, each checked against the structure."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.targets import Targets, check_new_name, refuse_members
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.schema.part_schema import (
    ActuatorTable,
    BodySensor,
    LimitsTable,
    MemberLimits,
    MemberSensor,
    NodeSensor,
)
from tensegrity_codegen.structure.actuators import UNLIMITED, Actuator, Sensor
from tensegrity_codegen.structure.bodies import Bar, BodySystem
from tensegrity_codegen.structure.limits import MEMBER_LIMITS, Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, UnknownNameError, suggest

Place = tuple[str | int, ...]


def build_actuators(
    stated: Sequence[ActuatorTable], input_name: Iterable[str], targets: Targets, rigid: NDArray[np.bool_]
) -> tuple[Actuator, ...]:
    """Return the actuators of a scene.

    input_name: names of the inputs; rigid: (n_members,), members that have no rest length to change.
    """
    owner_of_name = dict.fromkeys(input_name, "an input")
    built: list[Actuator] = []
    for number, actuator in enumerate(stated):
        keys = ("actuators", number)
        if actuator.name in owner_of_name:
            raise DuplicateNameError(
                f"the name is that of {owner_of_name[actuator.name]} already",
                where=key_path(targets.where, *keys, "name"),
                given=actuator.name,
                allowed="a name that no other input or actuator has; an actuator is an input too",
                hint="rename it, or remove the other one",
            )
        owner_of_name[actuator.name] = "another actuator"
        members = _find_members(actuator.members, targets, *keys, "members")
        problem = "a rigid bar has no rest length to change"
        refuse_members(members, rigid, problem, targets, (*keys, "members"))
        named = (actuator.members,) if isinstance(actuator.members, str) else actuator.members
        is_named = np.isin(targets.member_name, named)
        problem = "the rest length of a cable in pieces has no actuator, but an input or a single piece"
        refuse_members(members, ~is_named & (targets.share != 1.0), problem, targets, (*keys, "members"))
        limits = _find_range(actuator, key_path(targets.where, *keys, "range"))
        rate = Actuator.rate if actuator.rate is None else actuator.rate
        built.append(Actuator(actuator.name, members, rate, limits, actuator.delay, actuator.time_constant))
    return tuple(built)


def build_sensors(
    stated: Sequence[MemberSensor | NodeSensor | BodySensor],
    targets: Targets,
    find_point: Callable[..., int] | None = None,
    bodies: Sequence[str] = (),
) -> tuple[Sensor, ...]:
    """Return the sensors of a scene.

    find_point: returns the node of "body.point" in a scene of bodies with angles, None in one of nodes;
    bodies: names of those beside nodes.
    """
    built: list[Sensor] = []
    for number, sensor in enumerate(stated):
        name = sensor.name or ""
        if name:
            check_new_name(name, built, "sensors", key_path(targets.where, "sensors", number, "name"))
        if isinstance(sensor, MemberSensor):
            every = tuple(range(len(targets.member_name)))
            keys = ("sensors", number, "members")
            rows = every if sensor.members == "all" else _find_members(sensor.members, targets, *keys)
        elif isinstance(sensor, BodySensor):
            rows = _find_bodies(sensor, number, targets, bodies)
        else:
            rows = _find_nodes(sensor, number, targets, find_point)
        built.append(Sensor(sensor.kind, rows, sensor.noise, name))
    return tuple(built)


def _find_range(item: ActuatorTable, where: str) -> tuple[float, float]:
    if item.range is None:
        return UNLIMITED
    lower, upper = item.range
    if not lower < upper:
        problem = "the range of rest lengths is reversed or empty"
        allowed = "[least, largest] rest length [m], the first less than the second"
        hint = f"range = [{upper:g}, {lower:g}]" if upper < lower else "remove the key for no limit"
        raise InvalidValueError(problem, where=where, given=[lower, upper], allowed=allowed, hint=hint)
    return (lower, upper)


def _find_members(names: str | Sequence[str], targets: Targets, *place: str | int) -> tuple[int, ...]:
    def find(name: str) -> tuple[int, ...]:
        return targets.find_members([name], *place)

    return _find_each_once(names, find, targets.member_name, targets.where, place)


def _find_nodes(
    item: NodeSensor, number: int, targets: Targets, find_point: Callable[..., int] | None
) -> tuple[int, ...]:
    """Return the nodes of a sensor: named as nodes, or in a scene of bodies as points."""
    key, foreign_key = ("nodes", "points") if find_point is None else ("points", "nodes")
    requested = getattr(item, key)
    if getattr(item, foreign_key) not in (None, "all") or (getattr(item, foreign_key) and requested):
        kind = "nodes, which have no bodies" if find_point is None else "bodies, which have no nodes"
        problem, location = (
            f"this scene is one of {kind}",
            key_path(targets.where, "sensors", number, foreign_key),
        )
        hint = f"use {key} in place of {foreign_key}"
        value = getattr(item, foreign_key)
        raise InvalidValueError(problem, where=location, given=value, allowed=f"the key {key!r}", hint=hint)
    requested = requested or getattr(item, foreign_key)
    if requested is None:
        problem, location = "a needed key is missing", key_path(targets.where, "sensors", number, key)
        allowed = 'names of nodes, or "all"' if find_point is None else '"body.point"; nodes = "all"'
        raise InvalidValueError(problem, where=location, allowed=allowed, hint=f"add {key!r}")
    if requested == "all":
        return tuple(range(len(targets.node_name)))
    keys = ("sensors", number, key)

    def find(name: str) -> tuple[int, ...]:
        if find_point is None:
            return targets.find_nodes([name], *keys)
        return (find_point(name, *keys),)

    return _find_each_once(requested, find, targets.node_name, targets.where, keys)


def _find_bodies(item: BodySensor, number: int, targets: Targets, bodies: Sequence[str]) -> tuple[int, ...]:
    """Return the bodies of a gyro."""
    keys = ("sensors", number, "bodies")
    if item.bodies == "all" and bodies:
        return tuple(range(len(bodies)))

    def find(name: str) -> tuple[int, ...]:
        allowed = "names of bodies of kind rigid beside nodes and members"
        check_known(name, bodies, "the body is not defined", allowed, targets.where, *keys)
        return (bodies.index(name),)

    return _find_each_once(item.bodies, find, bodies, targets.where, keys)


def _find_each_once(
    names: str | Sequence[str],
    find: Callable[[str], tuple[int, ...]],
    row_name: Sequence[str],
    where: str,
    place: Place,
) -> tuple[int, ...]:
    """Return the rows that names stand for; raises DuplicateNameError if two names stand for one row."""
    names = (names,) if isinstance(names, str) else names
    source: dict[int, str] = {}
    for name in names:
        for row in find(name):
            if row in source:
                by = "" if name == source[row] else f", by {source[row]!r} and by {name!r}"
                problem = f"{row_name[row]!r} is listed twice{by}"
                allowed = "each member or node once, by its own name or by one group or class"
                hint = "remove one of the two" if by else f"remove one {name!r}"
                location, value = key_path(where, *place), list(names)
                raise DuplicateNameError(problem, where=location, given=value, allowed=allowed, hint=hint)
            source[row] = name
    if not source:
        problem = "the list stands for nothing: groups or classes without members"
        allowed = "at least one member or node"
        raise InvalidValueError(problem, where=key_path(where, *place), given=list(names), allowed=allowed)
    return tuple(source)


Subject = Structure | BodySystem


def with_section(subject: Subject) -> BoolArray:
    """Return which members have a section, (n_members,)."""
    is_round: BoolArray = subject.radius > 0
    return is_round


def find_limited(subject: Subject) -> dict[str, BoolArray]:
    """Return by limit the members that it applies to where a scene states it for all, (n_members,)."""
    round_one, stiff = with_section(subject), subject.mu > 0
    return {
        "least_tension": ~subject.is_bar,
        "most_tension": ~subject.is_bar,
        "yield_stress": round_one,
        "buckling": subject.is_bar & round_one & stiff,
    }


def build_limits(
    stated: LimitsTable, subject: Subject, classes: Mapping[str, Any], where: str, cables: Sequence[str] = ()
) -> Limits:
    """Return the limits of a structure or body system; cables: groups that are cables in segments."""
    if not stated.model_fields_set:
        return Limits()
    built = _MemberValues(subject, where)
    _check_all(stated, subject, where)
    for key, usual in find_limited(subject).items():
        limited = subject.is_bar if getattr(stated, key) is False else usual
        built.set(stated, key, np.flatnonzero(limited), "limits")
    of_class: dict[str, list[int]] = {}
    for row, owner in enumerate(subject.member_class):
        of_class.setdefault(owner, []).append(row)
    for name, table in stated.classes.items():
        _check_name(name, classes, "class", where, {"member": subject.member_name, "group": subject.groups})
        built.set_named(table, np.array(of_class.get(name, []), dtype=np.int64), "classes", name)
    rows_of: dict[str, tuple[int, ...]] = {name: (row,) for row, name in enumerate(subject.member_name)}
    rows_of |= {name: subject.groups[name] for name in cables}
    for name, table in stated.members.items():
        _check_name(name, rows_of, "member", where, {"class": classes, "group": subject.groups})
        built.set_named(table, np.array(rows_of[name]), "members", name)
    built.check_order()
    none = -math.inf
    clearance = none if stated.clearance is None else stated.clearance
    stiffness = none if stated.least_stiffness is None else stated.least_stiffness
    return Limits(**built.values, clearance=clearance, least_stiffness=stiffness)


class _MemberValues:
    """Limits of members while they are collected, and the keys that tensions come from."""

    def __init__(self, subject: Subject, where: str) -> None:
        self.member_name, self.where = subject.member_name, where
        self.is_bar, self.has_section, self.is_stiff = subject.is_bar, with_section(subject), subject.mu > 0
        self.values = {key: np.full(subject.n_members, none) for key, none in MEMBER_LIMITS.items()}
        self._source: dict[str, dict[int, str]] = {"least_tension": {}, "most_tension": {}}

    def set(self, table: MemberLimits, key: str, rows: NDArray[np.int64], *place: str) -> None:
        """Set one limit of the members `rows`, if the table states it."""
        value = getattr(table, key)
        if value is None:
            return
        self.values[key][rows] = -math.inf if value is False else float(value)
        if key in self._source:
            self._source[key].update(dict.fromkeys(rows.tolist(), key_path("", *place, key)))

    def set_named(self, table: MemberLimits, rows: NDArray[np.int64], section: str, name: str) -> None:
        """Set the limits of members that were named; raises InvalidValueError if one has no meaning."""
        keys = ("limits", section, name)
        for key in MEMBER_LIMITS:
            value = getattr(table, key)
            if value is not None and value is not False:
                self._check_members(key, rows, key_path(self.where, *keys, key), value)
            self.set(table, key, rows, *keys)

    def _check_members(self, key: str, rows: NDArray[np.int64], place: str, value: Any) -> None:
        """Raise InvalidValueError unless the limit has a meaning for each of these members."""
        bar = self.is_bar[rows]
        problem = "the member has no radius, so that its section is not known"
        section = (~self.has_section[rows], problem, "members with a radius", "give it a radius [m]")
        problem = "the bar has no stiffness, so that its Euler load is not known"
        stiff = (~self.is_stiff[rows], problem, "bars with a stiffness", "give it axial_stiffness [N]")
        rules: dict[str, list[tuple[BoolArray, str, str, str]]] = {
            "least_tension": [(bar, "a bar has no least tension", "cables", "use most_tension or buckling")],
            "yield_stress": [section],
            "buckling": [(~bar, "a cable does not buckle", "bars", "remove the key"), section, stiff],
        }
        for bad, problem, allowed, hint in rules.get(key, ()):
            if bad.any():
                name = self.member_name[int(rows[np.argmax(bad)])]
                problem, shown = f"{problem}: {name}", "true" if value is True else value
                raise InvalidValueError(problem, where=place, given=shown, allowed=allowed, hint=hint)

    def check_order(self) -> None:
        """Raise InvalidValueError for a least tension above the largest one of the same member."""
        lower, upper = self.values["least_tension"], self.values["most_tension"]
        wrong = np.flatnonzero(lower > upper)
        if not wrong.size:
            return
        row, others_text = int(wrong[0]), f" (and of {wrong.size - 1} more)" if wrong.size > 1 else ""
        problem = (
            f"the least tension of member {self.member_name[row]}{others_text} is above its largest tension"
        )
        location = f"{self.where}: {self._source['least_tension'][row]}"
        allowed = f"at most {upper[row]:g} N, the value of {self._source['most_tension'][row]}"
        hint = "lower least_tension, or raise most_tension"
        raise InvalidValueError(problem, where=location, given=float(lower[row]), allowed=allowed, hint=hint)


def _check_all(stated: LimitsTable, subject: Subject, where: str) -> None:
    """Raise InvalidValueError for a limit of all members that applies to none of them."""
    needs = {
        "least_tension": "no member is a cable",
        "most_tension": "no member is a cable",
        "yield_stress": "no member has a radius, so that no section is known",
        "buckling": "no member is a bar with a radius and a stiffness (bars that are bodies have none)",
    }
    for key, rows in find_limited(subject).items():
        if getattr(stated, key) not in (None, False) and not rows.any():
            raise InvalidValueError(
                f"the limit applies to no member: {needs[key]}",
                where=key_path(where, "limits", key),
                given=getattr(stated, key),
                allowed="a limit that some member can have",
                hint="remove the key"
                if "tension" in key
                else "give the members a radius [m], or remove the key",
            )
    bars, round_bars = _count_bars(subject)
    if stated.clearance is not None and bars > 1 and not round_bars:
        problem = "no bar has a radius, so that the distances between bars are not known"
        location, allowed = key_path(where, "limits", "clearance"), "a clearance of bars with a radius"
        hint = "give the bars a radius [m], or remove the key: clearances are of bars, not of bodies"
        raise InvalidValueError(problem, where=location, given=stated.clearance, allowed=allowed, hint=hint)


def _count_bars(subject: Subject) -> tuple[int, int]:
    """Return the numbers of bars and of bars with a radius."""
    if isinstance(subject, BodySystem):
        radii = [body.radius for body in subject.bodies if isinstance(body, Bar)]
        return len(radii), sum(radius > 0 for radius in radii)
    return int(subject.is_bar.sum()), int((subject.is_bar & with_section(subject)).sum())


def _check_name(
    name: str, known: Mapping[str, Any], what: str, where: str, others: Mapping[str, Any]
) -> None:
    if name in known:
        return
    section = {"class": "classes", "member": "members"}
    kind = next((section_kind for section_kind, names in others.items() if name in names), "")
    hint = suggest(name, known)
    if kind:
        hint = f"{name!r} is a {kind}: " + (
            f"[limits.{section[kind]}.{name}]" if kind in section else "name its class, or its members"
        )
    problem, location = f"there is no {what} of this name", key_path(where, "limits", section[what], name)
    allowed = "names of classes" if what == "class" else "names of members (in scenes of bodies: tendons)"
    raise UnknownNameError(problem, where=location, given=name, allowed=allowed, hint=hint)
