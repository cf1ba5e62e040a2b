"""From a structure or body system back to a scene document: all in full, nothing implied."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tensegrity_codegen.scene.assemble.control import find_limited
from tensegrity_codegen.structure.actuators import (
    BODY_SENSORS,
    MEMBER_SENSORS,
    REST_LENGTH_KINDS,
    UNLIMITED,
    Actuator,
    Sensor,
)
from tensegrity_codegen.structure.bodies import Bar, Body, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.structure.contact_estimates import Subject, find_bar_radius, find_surface_nodes
from tensegrity_codegen.structure.free_bodies import BodyPart, FreeBody
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.body_places import compute_spins, place_bodies
from tensegrity_codegen.tables.request import ModelRequest


def describe_control(subject: Subject, key: str, name_node: Callable[[int], str]) -> dict[str, Any]:
    """Return the sections actuators, sensors and limits; key: of nodes of a sensor; name_node: by index."""
    return {
        "actuators": [_describe_actuator(subject, entry) for entry in subject.actuators],
        "sensors": [_describe_sensor(subject, entry, key, name_node) for entry in subject.sensors],
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
    elif item.kind in BODY_SENSORS:
        table["bodies"] = [subject.bodies[k].name for k in item.targets]
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
            if key not in ("class", "nodes", "points") and all(table.get(key) == value for table in members):
                shared.setdefault(owner, {})[key] = value
                for table in members:
                    del table[key]
    return shared


def _describe_value(key: str, value: float) -> float | bool:
    """Return a limit of members as scenes state it."""
    return False if key == "buckling" and value < 0 else float(value)


def describe_ground(subject: Subject, name_node: Callable[[int], str]) -> dict[str, Any]:
    """Return the table [ground] in full, bit by bit, {} without a ground; name_node: names by index."""
    ground = subject.ground
    if ground is None:
        return {}
    bodies = subject.bodies if isinstance(subject, Structure) else ()
    is_all = np.array_equal(ground.node, find_surface_nodes(subject, ground.normal))
    is_all &= not any(np.isnan(body.point_radius).all() for body in bodies)  # of which "all" asks for one
    table: dict[str, Any] = {
        "normal": ground.normal.tolist(),
        "offset": float(ground.offset),
        "velocity": ground.velocity.tolist() if ground.velocity.any() else None,
        "contacts": "all" if is_all else [name_node(int(node)) for node in ground.node],
        "stiffness": float(ground.stiffness),
        "exponent": float(ground.exponent),
        "dissipation": float(ground.dissipation),
        "friction": float(ground.friction),
        "static_friction": ground.static_friction,
        "stick_stiffness": float(ground.stick_stiffness) or None,
        "stick_damping": float(ground.stick_damping) or None,
    }
    own = np.ones(ground.n_contacts, dtype=np.bool_)
    if isinstance(subject, Structure):
        own = ~np.isin(ground.node, _find_points_with_radius(subject))
    radius = ground.radius[own]
    table["radius"] = float(radius[0]) if radius.size else 0.0
    if radius.size and (radius != radius[0]).any():
        if not np.array_equal(radius, find_bar_radius(subject)[ground.node[own]]):
            problem, location = "radii of contacts that a scene cannot state", "ground.radius"
            allowed = "one radius, or those of the bars that end at the contacts"
            raise InvalidValueError(problem, where=location, given=ground.radius.tolist(), allowed=allowed)
        table["radius"] = "bar"
    return {key: value for key, value in table.items() if value is not None}


_LETTERS = "xyz"
# Keys of the section `model` that are always written, and those that are where they are not as usual.
_MODEL_KEYS = ("formulation", "emitter", "quantities", "integrators")
_MORE_MODEL_KEYS = (
    *("events", "keep", "precision", "flags", "checks", "batch_width", "solvers", "interfaces"),
)
_MEMBER_COLUMNS = (
    *("spring_constant", "axial_stiffness", "damping", "member_mass", "radius", "inner_radius"),
    "thermal_expansion",
)
_NODE_PARAMETERS = ("node_mass", "node_load", "anchor_position")


def describe_structure(structure: Structure, request: ModelRequest | None = None) -> dict[str, Any]:
    """Return the flat scene document of `structure`, bit by bit; `request` adds its sections."""
    document: dict[str, Any] = {"name": structure.name}
    node_name = name_points(structure)
    document["axes"] = "".join(_LETTERS[axis] for axis in structure.axes)
    document["large"] = structure.is_large
    if np.any(structure.gravity):
        document["gravity"] = structure.gravity.tolist()
    if request is not None:
        names = [body.name for body in structure.bodies]
        document |= describe_request(request, node_name, structure.member_name, names)
    kinds = {name: _kind(bar) for name, bar in zip(structure.member_class, structure.is_bar, strict=True)}
    document["classes"] = {name: {"kind": kind} for name, kind in kinds.items() if name}
    inside = {node for body in structure.bodies for node in (*body.corner, *body.point)}
    document["nodes"] = {
        name: _describe_node(structure, i) for i, name in enumerate(node_name) if i not in inside
    }
    document["members"] = {
        name: _describe_member(structure, e, node_name)
        for e, name in enumerate(structure.member_name)
        if not structure.is_edge[e]
    }
    document["bodies"] = {body.name: _describe_free_body(structure, body) for body in structure.bodies}
    for owner, values in share_values(document["members"], structure).items():
        document["classes"][owner] |= values
    document["groups"] = {
        name: [structure.member_name[e] for e in members]
        for name, members in structure.groups.items()
        if members
    }
    document["sliding"] = {
        cable.name: {
            "strands": [structure.member_name[e] for e in cable.members],
            "friction": list(cable.friction),
            "wrap_deg": list(cable.wrap_deg),
        }
        for cable in structure.sliding
    }
    document["interference"] = asdict(structure.collision) if structure.collision else {}
    if structure.interference is not None:
        name = structure.member_name
        document["interference"]["pairs"] = [[name[i], name[j]] for i, j in structure.interference]
    document["ground"] = describe_ground(structure, lambda i: node_name[i])
    loaded = np.flatnonzero(np.any(structure.node_load != 0, axis=1))
    document["loads"] = [{"node": node_name[i], "force": structure.node_load[i].tolist()} for i in loaded]
    motors = {actuator.name for actuator in structure.actuators}
    inputs = [u for u in structure.inputs if u.name not in motors]
    document["inputs"] = [_describe_input(structure, u, node_name) for u in inputs]
    document |= describe_control(structure, "nodes", lambda i: node_name[i])
    return {key: value for key, value in document.items() if value}


def _kind(is_bar: bool | np.bool_) -> str:
    return "bar" if is_bar else "cable"


def _describe_node(structure: Structure, i: int) -> dict[str, Any]:
    node: dict[str, Any] = {"position": structure.node_position[i].tolist()}
    if structure.node_mass[i]:
        node["mass"] = float(structure.node_mass[i])
    held = "".join(_LETTERS[axis] for axis in structure.axes if structure.node_anchored[i, axis])
    if held:
        node["anchored"] = True if len(held) == len(structure.axes) else held
    if np.any(structure.node_velocity[i]):
        node["velocity"] = structure.node_velocity[i].tolist()
    return node


def name_points(structure: Structure) -> tuple[str, ...]:
    """Return the names of nodes as scenes write them, points of bodies as "body.point"."""
    names = list(structure.node_name)
    for body in structure.bodies:
        for node in body.point:
            names[node] = f"{body.name}.{names[node].removeprefix(f'{body.name}_')}"
    return tuple(names)


def _find_points_with_radius(structure: Structure) -> list[int]:
    return [
        node
        for body in structure.bodies
        for node, radius in zip(body.point, body.point_radius, strict=True)
        if not math.isnan(radius)
    ]


def _describe_free_body(structure: Structure, body: FreeBody) -> dict[str, Any]:
    """Return the table of a rigid body; its place is exact to rounding."""
    table: dict[str, Any] = {"kind": "rigid", "mass": body.mass, "inertia": body.inertia.tolist()}
    if body.centre.any():
        table["centre_of_mass"] = body.centre.tolist()
    points: dict[str, Any] = {}
    for node, local, radius in zip(body.point, body.point_local.tolist(), body.point_radius, strict=True):
        name = structure.node_name[node].removeprefix(f"{body.name}_")
        points[name] = local if math.isnan(radius) else {"position": local, "radius": float(radius)}
    table |= {"points": points} if points else {}
    table |= {"parts": [describe_part(part) for part in body.parts]} if body.parts else {}
    place = body.place()
    (centre,), (axes,) = place_bodies([place], structure.node_position)
    table |= {"centre": centre.tolist(), "matrix": axes.tolist()}
    velocity = np.array(place.centre) @ structure.node_velocity[list(body.corner)]
    spin = compute_spins([place], structure.node_position, structure.node_velocity)[0]
    table |= {"centre_velocity": velocity.tolist()} if velocity.any() else {}
    return table | ({"angular_velocity": spin.tolist()} if spin.any() else {})


def describe_part(part: BodyPart) -> dict[str, Any]:
    """Return the table of a shape without its mass, which the body states."""
    table: dict[str, Any] = {"kind": part.kind}
    if part.kind in ("ball", "box"):
        table["position"] = part.position.tolist()
        if part.kind == "ball":
            return table | {"radius": part.size[0]}
        return table | {"size": list(part.size), "quaternion": find_quaternion(part.axes)}
    half = part.axes[:, 2] * part.size[-1] / 2.0
    table |= {"radius": part.size[0]} | ({"inner_radius": part.size[1]} if part.kind == "tube" else {})
    return table | {"from": (part.position - half).tolist(), "to": (part.position + half).tolist()}


def find_quaternion(axes: FloatArray) -> list[float]:
    """Return w, x, y, z of a rotation matrix: an eigenvector, its largest number above 0."""
    r = axes
    square = np.array(
        [
            [np.trace(r), r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0.0, 2 * r[0, 0] - np.trace(r), r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0.0, 0.0, 2 * r[1, 1] - np.trace(r), r[1, 2] + r[2, 1]],
            [0.0, 0.0, 0.0, 2 * r[2, 2] - np.trace(r)],
        ]
    )
    vector = np.linalg.eigh(square, UPLO="U")[1][:, -1]
    sign = np.copysign(1.0, vector[np.abs(vector).argmax()])
    return [float(value) + 0.0 for value in sign * vector]


def _describe_member(structure: Structure, e: int, node_name: Sequence[str]) -> dict[str, Any]:
    owner = structure.member_class[e]
    member: dict[str, Any] = {"class": owner} if owner else {"kind": _kind(structure.is_bar[e])}
    member["nodes"] = [node_name[i] for i in structure.path(e)]
    return member | describe_values(structure, e, two_sided=not structure.is_bar[e])


def describe_values(subject: Structure | BodySystem, e: int, *, two_sided: bool) -> dict[str, Any]:
    """Return the numbers and the law of member e; two_sided: whether to say that it is not tension_only."""
    values: dict[str, Any] = {"rest_length": float(subject.rest_length[e])}
    for name in _MEMBER_COLUMNS:
        column = getattr(subject, name, None)
        if column is not None and column[e]:
            values[name.removeprefix("member_")] = float(column[e])
    values |= {p.name: float(subject.member_value(p.name)[e]) for p in subject.law_of(e).parameters}
    return values | ({"tension_only": False} if two_sided and not subject.tension_only[e] else {})


def _describe_input(structure: Structure, item: ActuatedInput, node_name: Sequence[str]) -> dict[str, Any]:
    if item.kind != "force":
        return describe_rest_length_input(item, structure.member_name)
    names = [node_name[i] for i in item.targets]
    return {"name": item.name, "kind": item.kind, "nodes": names, "direction": list(item.direction)}


def describe_rest_length_input(item: ActuatedInput | BodyInput, member_name: Sequence[str]) -> dict[str, Any]:
    """Return the table of an input of kind rest_length or temperature."""
    table = {"name": item.name, "kind": item.kind, "members": [member_name[e] for e in item.targets]}
    return table | ({"gain": list(item.gain)} if item.gain and item.kind == "rest_length" else {})


def describe_request(
    request: ModelRequest,
    node_name: Sequence[str],
    member_name: Sequence[str],
    body_name: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the sections `model` and `parameters` of a scene document."""
    usual = ModelRequest(())
    model: dict[str, Any] = {}
    for key in (*_MODEL_KEYS, *_MORE_MODEL_KEYS):
        value = getattr(request, key)
        if key in _MODEL_KEYS or value != getattr(usual, key):
            model[key] = list(value) if isinstance(value, tuple) else value
    if request.options:
        model["options"] = dict(request.options)
    parameters: dict[str, Any] = {}
    for name, targets in request.parameters.items():
        owners = node_name if name in _NODE_PARAMETERS else member_name
        owners = body_name if name.startswith("body_") else owners
        if name == "ground":
            parameters[name] = [CHANGEABLE[index] for index in targets]
        elif name == "gravity" or len(targets) == len(owners):
            parameters[name] = "all"
        elif targets:
            parameters[name] = [owners[index] for index in targets]
    return {"model": model, "parameters": parameters}


def describe_subject(subject: Subject, request: ModelRequest) -> dict[str, Any]:
    """Return the scene document of a structure or a body system and its request."""
    if isinstance(subject, BodySystem):
        return describe_bodies(subject, request)
    return describe_structure(subject, request)


def describe_bodies(system: BodySystem, request: ModelRequest | None = None) -> dict[str, Any]:
    """Return the scene document of `system`, angles in degrees; `request` adds its sections."""
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
