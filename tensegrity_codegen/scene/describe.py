"""From a structure back to a scene document: every node and member in full, nothing implied."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tensegrity_codegen.scene.describe_control import describe_control, share_values
from tensegrity_codegen.scene.describe_ground import describe_ground
from tensegrity_codegen.structure.bodies import BodyInput, BodySystem
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.tables.request import ModelRequest

_LETTERS = "xyz"
# Keys of the section `model` that are always written, and those that are where they are not as usual.
_MODEL_KEYS = ("formulation", "emitter", "quantities", "integrators")
_MORE_MODEL_KEYS = ("events", "keep", "precision", "flags", "batch_width", "solvers", "interfaces")
_MEMBER_COLUMNS = (
    *("spring_constant", "axial_stiffness", "damping", "member_mass", "radius", "inner_radius"),
    "thermal_expansion",
)
_NODE_PARAMETERS = ("node_mass", "node_load", "anchor_position")


def describe_structure(structure: Structure, request: ModelRequest | None = None) -> dict[str, Any]:
    """Return the flat scene document of `structure`: positions, stiffnesses and rest lengths [m] explicit.

    What all members of a class have alike stands in the class. Reading it back gives the same numbers bit by
    bit. `request` adds what is wanted of it.
    """
    document: dict[str, Any] = {"name": structure.name}
    document["axes"] = "".join(_LETTERS[axis] for axis in structure.axes)
    document["large"] = structure.is_large
    if np.any(structure.gravity):
        document["gravity"] = structure.gravity.tolist()
    if request is not None:
        document |= describe_request(request, structure.node_name, structure.member_name)
    kinds = {name: _kind(bar) for name, bar in zip(structure.member_class, structure.is_bar, strict=True)}
    document["classes"] = {name: {"kind": kind} for name, kind in kinds.items() if name}
    document["nodes"] = {name: _describe_node(structure, i) for i, name in enumerate(structure.node_name)}
    document["members"] = {
        name: _describe_member(structure, e) for e, name in enumerate(structure.member_name)
    }
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
    document["ground"] = describe_ground(structure, lambda i: structure.node_name[i])
    loaded = np.flatnonzero(np.any(structure.node_load != 0, axis=1))
    document["loads"] = [
        {"node": structure.node_name[i], "force": structure.node_load[i].tolist()} for i in loaded
    ]
    motors = {item.name for item in structure.actuators}
    document["inputs"] = [_describe_input(structure, u) for u in structure.inputs if u.name not in motors]
    document |= describe_control(structure, "nodes", lambda i: structure.node_name[i])
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


def _describe_member(structure: Structure, e: int) -> dict[str, Any]:
    owner = structure.member_class[e]
    member: dict[str, Any] = {"class": owner} if owner else {"kind": _kind(structure.is_bar[e])}
    member["nodes"] = [structure.node_name[i] for i in structure.path(e)]
    return member | describe_values(structure, e, two_sided=not structure.is_bar[e])


def describe_values(subject: Structure | BodySystem, e: int, *, two_sided: bool) -> dict[str, Any]:
    """Return the numbers and the law of member e; two_sided: whether to say that it is not tension_only."""
    values: dict[str, Any] = {"rest_length": float(subject.rest_length[e])}
    for name in _MEMBER_COLUMNS:
        column = getattr(subject, name, None)
        if column is not None and column[e]:
            values[name.removeprefix("member_")] = float(column[e])
    values |= subject.describe_law(e)
    return values | ({"tension_only": False} if two_sided and not subject.tension_only[e] else {})


def _describe_input(structure: Structure, item: ActuatedInput) -> dict[str, Any]:
    if item.kind != "force":
        return describe_rest_length_input(item, structure.member_name)
    names = [structure.node_name[i] for i in item.targets]
    return {"name": item.name, "kind": item.kind, "nodes": names, "direction": list(item.direction)}


def describe_rest_length_input(item: ActuatedInput | BodyInput, member_name: Sequence[str]) -> dict[str, Any]:
    """Return the table of an input of kind rest_length or temperature."""
    table = {"name": item.name, "kind": item.kind, "members": [member_name[e] for e in item.targets]}
    return table | ({"gain": list(item.gain)} if item.gain and item.kind == "rest_length" else {})


def describe_request(
    request: ModelRequest, node_name: Sequence[str], member_name: Sequence[str]
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
        if name == "ground":
            parameters[name] = [CHANGEABLE[index] for index in targets]
        elif name == "gravity" or len(targets) == len(owners):
            parameters[name] = "all"
        elif targets:
            parameters[name] = [owners[index] for index in targets]
    return {"model": model, "parameters": parameters}
