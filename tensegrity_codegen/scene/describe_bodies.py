"""From a body system back to a scene document: every body and tendon in full, nothing implied."""

import math
from typing import Any

import numpy as np

from tensegrity_codegen.scene.describe import (
    describe_control,
    describe_ground,
    describe_request,
    describe_rest_length_input,
    describe_structure,
    describe_values,
    share_values,
)
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.actuators import REST_LENGTH_KINDS
from tensegrity_codegen.structure.bodies import Bar, Body, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.tables.request import ModelRequest


def describe_subject(subject: Subject, request: ModelRequest) -> dict[str, Any]:
    """Return the scene document of a structure or a body system and what is wanted of it."""
    if isinstance(subject, BodySystem):
        return describe_bodies(subject, request)
    return describe_structure(subject, request)


def describe_bodies(system: BodySystem, request: ModelRequest | None = None) -> dict[str, Any]:
    """Return the scene document of `system`, angles in degrees; `request` adds what is wanted of it.

    Reading it back gives the same numbers, angles to the last digit or two.
    """
    document: dict[str, Any] = {"name": system.name}
    if np.any(system.gravity):
        document["gravity"] = system.gravity.tolist()
    if request is not None:
        document |= describe_request(request, system.node_name, system.member_name)
    document["classes"] = {name: {"kind": "cable"} for name in system.member_class if name}
    document["bodies"] = {
        entry.name: _describe(system, row, entry) for row, entry in enumerate(system.bodies)
    }
    document["tendons"] = {name: _tendon(system, e) for e, name in enumerate(system.member_name)}
    for name, values in share_values(document["tendons"], system).items():
        document["classes"][name] |= values
    document["groups"] = {
        name: [system.member_name[e] for e in members] for name, members in system.groups.items() if members
    }
    document["joint_friction"] = [
        {"bodies": [system.bodies[k].name for k in joint.bodies], "coefficient": joint.coefficient}
        for joint in system.friction
    ]
    if system.interference is not None:
        pairs = [[system.bodies[k].name for k in pair] for pair in system.interference]
        document["interference"] = {"pairs": pairs}
    document["ground"] = describe_ground(system, lambda node: _point(system, node))
    document["loads"] = _loads(system)
    motors = {entry.name for entry in system.actuators}
    document["inputs"] = [_input(system, entry) for entry in system.inputs if entry.name not in motors]
    document |= describe_control(system, "points", lambda node: _point(system, node))
    return {key: value for key, value in document.items() if value}


def _point(system: BodySystem, node: int) -> str:
    body = system.bodies[int(system.node_body[node])].name
    return f"{body}.{system.node_name[node].removeprefix(f'{body}_')}"


def _points(system: BodySystem, row: int) -> dict[str, list[float]]:
    nodes = [int(node) for node in np.flatnonzero(system.node_body == row)]
    return {_point(system, node).partition(".")[2]: system.node_local[node].tolist() for node in nodes}


def _describe(system: BodySystem, row: int, body: Body) -> dict[str, Any]:
    start = system.coordinate_start[row]
    if isinstance(body, Bar):
        return _bar(system, body, start)
    if not isinstance(body, RigidBody):
        return {"kind": "fixed", "points": _points(system, row)}
    points = {name: position for name, position in _points(system, row).items() if name != "centre"}
    angles = dict(zip(("psi", "phi", "theta"), range(start, start + 3), strict=True))
    table: dict[str, Any] = {"kind": "rigid", "mass": body.mass, "inertia": [list(x) for x in body.inertia]}
    table |= {"points": points} if points else {}
    table["centre"] = system.coordinate[start + 3 : start + 6].tolist()
    table |= {f"{name}_deg": math.degrees(system.coordinate[k]) for name, k in angles.items()}
    table |= {
        f"{name}_rate_deg": math.degrees(system.velocity[k])
        for name, k in angles.items()
        if system.velocity[k]
    }
    if np.any(system.velocity[start + 3 : start + 6]):
        table["centre_velocity"] = system.velocity[start + 3 : start + 6].tolist()
    return table


def _bar(system: BodySystem, bar: Bar, start: int) -> dict[str, Any]:
    table: dict[str, Any] = {"kind": "bar", "length": bar.length, "mass": bar.mass, "inertia": bar.inertia}
    table |= {"radius": bar.radius} if bar.radius else {}
    if bar.held:
        table |= {"anchor": _point(system, bar.anchor), "end": bar.held}
    else:
        table["centre"] = system.coordinate[start : start + 3].tolist()
        if np.any(system.velocity[start : start + 3]):
            table["centre_velocity"] = system.velocity[start : start + 3].tolist()
        start += 3
    chart = bar.chart
    table |= {"polar_axis": "xyz"[chart.axis], "spin": bar.spin}
    table |= {"azimuth_offset_deg": math.degrees(chart.offset)} if chart.offset else {}
    table[f"{chart.polar}_deg"] = math.degrees(system.coordinate[start])
    table["azimuth_deg"] = math.degrees(system.coordinate[start + 1])
    rates = {"polar": system.velocity[start], "azimuth": system.velocity[start + 1]}
    return table | {f"{name}_rate_deg": math.degrees(rate) for name, rate in rates.items() if rate}


def _tendon(system: BodySystem, e: int) -> dict[str, Any]:
    table: dict[str, Any] = {"class": system.member_class[e]} if system.member_class[e] else {}
    table["points"] = [_point(system, int(node)) for node in system.connectivity[e]]
    return table | describe_values(system, e, two_sided=True)


def _loads(system: BodySystem) -> list[dict[str, Any]]:
    steady = [
        {"point": _point(system, int(node)), "force": system.node_load[node].tolist()}
        for node in np.flatnonzero(np.any(system.node_load != 0, axis=1))
    ]
    turning = [
        {"point": _point(system, load.target), "force": list(load.vector), "frame": load.frame}
        if load.kind == "force"
        else {"body": system.bodies[load.target].name, "torque": list(load.vector), "frame": load.frame}
        for load in system.loads
    ]
    return [*steady, *turning]


def _input(system: BodySystem, item: BodyInput) -> dict[str, Any]:
    if item.kind in REST_LENGTH_KINDS:
        return describe_rest_length_input(item, system.member_name)
    direction = {"direction": list(item.direction), "frame": item.frame}
    if item.kind == "force":
        points = [_point(system, node) for node in item.targets]
        return {"name": item.name, "kind": "point_force", "points": points} | direction
    bodies = [system.bodies[body].name for body in item.targets]
    return {"name": item.name, "kind": "torque", "bodies": bodies} | direction
