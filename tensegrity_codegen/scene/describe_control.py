"""From a structure or body system back to the scene's actuators, sensors and limits."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.scene.assemble.control import find_limited
from tensegrity_codegen.structure.actuators import MEMBER_SENSORS, UNLIMITED, Actuator, Sensor
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.structure import Structure

Subject = Structure | BodySystem


def describe_control(subject: Subject, key: str, name_node: Callable[[int], str]) -> dict[str, Any]:
    """Return the sections `actuators`, `sensors` and `limits` of a scene document.

    key: that of the nodes of a sensor, `nodes` or `points`; name_node: their names by index.
    """
    return {
        "actuators": [_describe_actuator(subject, item) for item in subject.actuators],
        "sensors": [_describe_sensor(subject, item, key, name_node) for item in subject.sensors],
        "limits": _describe_limits(subject),
    }


def _describe_actuator(subject: Subject, item: Actuator) -> dict[str, Any]:
    table: dict[str, Any] = {"name": item.name, "members": [subject.member_name[e] for e in item.members]}
    if math.isfinite(item.rate):
        table["rate"] = float(item.rate)
    if tuple(item.range) != UNLIMITED:
        table["range"] = [float(value) for value in item.range]
    times = {"delay": float(item.delay), "time_constant": float(item.time_constant)}
    return table | {name: value for name, value in times.items() if value}


def _describe_sensor(
    subject: Subject, item: Sensor, key: str, name_node: Callable[[int], str]
) -> dict[str, Any]:
    table: dict[str, Any] = {"name": item.name} if item.name else {}
    table["kind"] = item.kind
    if item.kind in MEMBER_SENSORS:
        table["members"] = [subject.member_name[e] for e in item.targets]
    else:
        table[key] = [name_node(node) for node in item.targets]
    return table | ({"noise": float(item.noise)} if item.noise else {})


def _describe_limits(subject: Subject) -> dict[str, Any]:
    """Return the limits: once where all members that can have one share it, else member by member."""
    limits = subject.limits
    document: dict[str, Any] = {}
    members: dict[int, dict[str, float | bool]] = {}
    usual = find_limited(subject)
    if (limits.buckling[subject.is_bar] == -math.inf).all():
        usual["buckling"] = subject.is_bar
    for key, none in MEMBER_LIMITS.items():
        values = getattr(limits, key)
        shared = np.unique(values[usual[key]])
        is_shared = len(shared) == 1 and shared[0] != none
        if is_shared:
            document[key] = _describe_value(key, shared[0])
        for e in np.flatnonzero((values != none) & ~(usual[key] & is_shared)).tolist():
            members.setdefault(e, {})[key] = _describe_value(key, values[e])
    for key in ("clearance", "least_stiffness"):
        if math.isfinite(getattr(limits, key)):
            document[key] = float(getattr(limits, key))
    by_name = {subject.member_name[e]: members[e] for e in sorted(members)}
    document["classes"] = share_values(by_name, subject)
    document["members"] = {name: table for name, table in by_name.items() if table}
    return {key: value for key, value in document.items() if value not in ({}, None)}


def share_values(tables: Mapping[str, dict[str, Any]], subject: Subject) -> dict[str, dict[str, Any]]:
    """Move the values that all members of a class have alike out of their tables; return them by class."""
    of_class: dict[str, list[dict[str, Any]]] = {}
    for name, owner in zip(subject.member_name, subject.member_class, strict=True):
        if owner:
            of_class.setdefault(owner, []).append(tables.get(name, {}))
    shared: dict[str, dict[str, Any]] = {}
    for owner, members in of_class.items():
        for key, value in list(members[0].items()) if len(members) > 1 else ():
            if key not in ("class", "nodes", "points") and all(item.get(key) == value for item in members):
                shared.setdefault(owner, {})[key] = value
                for item in members:
                    del item[key]
    return shared


def _describe_value(key: str, value: float) -> float | bool:
    """Return a limit of members as scenes state it."""
    return False if key == "buckling" and value < 0 else float(value)
