"""Import of a network of COMPAS (JSON): nodes and edges with the attributes of its form-finding packages.

    {"dtype": "compas.datastructures/Network",
     "data": {"node": {"0": {"x": 0, "y": 0, "z": 0, "is_anchor": true}, "1": {"x": 1, "y": 0, "z": 0}},
              "edge": {"0": {"1": {"q": -2.0, "E": 2.1e11, "A": 1e-4}}}}}

Of version 1 (class Network, keys as Python literals) and 2 (class Graph), and of classes of other packages
that are made from them (FDNetwork, CableNetwork). docs/import.md has every attribute.
"""

import ast
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.files.documents import MAX_JSON_BYTES, read_json
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import (
    STIFFNESSES,
    ImportResult,
    Network,
    NetworkMember,
    build_result,
    read_text,
)
from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, name_list

WHAT = "a network of COMPAS"
SECTIONS = ("data", "value")  # the latter of the encoder of version 1
_CLASS_KEY = re.compile(r'"d(?:ata)?type"\s*:\s*"(?:compas|[\w.]+/\w)')
ANCHORS = ("is_anchor", "is_anchored", "is_fixed", "is_support", "anchored")
LOADS = ("px", "py", "pz")
REACTIONS = ("rx", "ry", "rz")  # results of an analysis, which are not read
SOFTEST = 1000.0  # axial stiffness by largest force, in files without any stiffness
BARS, CABLES = ("bar", "strut", "compression"), ("cable", "tie", "tension", "string")
KINDS = ("kind", "type", "is_strut", "is_bar")
# Attributes of edges by the keys of a scene.
NUMBERS = {
    **dict.fromkeys(("l0", "linit", "rest_length"), "rest_length"),
    **dict.fromkeys(("k", "spring_constant"), "spring_constant"),
    **dict.fromkeys(("EA", "axial_stiffness"), "axial_stiffness"),
    **{key: key for key in ("mass", "density", "radius", "damping")},
    **dict.fromkeys(("f", "force", "prestress"), "prestress"),
}
OTHERS = ("q", "E", "A", "length")


def import_compas(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of a COMPAS network, and notes on attributes that are not read."""
    path = Path(path)
    content = _table(read_json(path, WHAT), str(path))
    where = str(path)
    data = content
    section = next((key for key in SECTIONS if key in content), None)
    if section is not None:
        where = key_path(where, section)
        data = _table(content[section], where)
    if "node" not in data:
        value = str(content.get("dtype", content.get("datatype", "the sections " + ", ".join(data))))[:80]
        allowed = "Network, Graph, FDNetwork or another class with the sections node and edge"
        hint = "save the edges of a mesh as a graph: Graph.from_lines(mesh.to_lines())"
        raise InvalidValueError(
            "not a network", where=key_path(str(path), "dtype"), given=value, allowed=allowed, hint=hint
        )
    network, ignored = Network(), dict[str, int]()
    defaults = [
        _table(data.get(short, data.get(long)) or {}, f"{where}.{long}")
        for short, long in (("dna", "default_node_attributes"), ("dea", "default_edge_attributes"))
    ]
    nodes = _table(data["node"], f"{where}.node")
    names = {key: _name(key) for key in nodes}
    if len(set(names.values())) < len(names):  # keys that would become one: all stay as they are
        names = {key: key for key in nodes}
    for key, values in nodes.items():
        location = f"{where}.node.{key[:80]}"
        _read_node(network, names[key], {**defaults[0], **_table(values or {}, location)}, location, ignored)
    for start, row in _table(data.get("edge", {}), f"{where}.edge").items():
        for end, values in _table(row or {}, f"{where}.edge.{start[:80]}").items():
            location = f"{where}.edge.{start[:80]}.{end[:80]}"
            attributes = {**defaults[1], **_table(values or {}, location)}
            _read_edge(network, (names.get(start, start), names.get(end, end)), attributes, location, ignored)
    if ignored:
        listed = name_list([f"{key[:40]} ({count})" for key, count in ignored.items()], 10)
        network.notes.append(f"attributes that are not read, with the number of nodes and edges: {listed}")
    _complete_stiffness(network)
    return build_result(network, path, name, gravity)


def _complete_stiffness(network: Network) -> None:
    """Give members an axial stiffness where the file has none at all, as after a force density method."""
    forces = [abs(member.values.get("prestress", 0.0)) for member in network.members]
    stated = any(key in member.values for member in network.members for key in STIFFNESSES)
    if stated or not any(forces):
        return
    stiffness = SOFTEST * max(forces)
    network.members = [
        replace(member, values={**member.values, "axial_stiffness": stiffness}) for member in network.members
    ]
    network.notes.append(
        f"the file has no stiffness: all members have the axial stiffness {stiffness:g} N, {SOFTEST:g} times "
        "the largest force; give edges an attribute EA for another one"
    )


def is_compas(path: Path) -> bool:
    """Return whether a JSON file names a class of COMPAS, or has the sections of a network or mesh."""
    text = read_text(path, MAX_JSON_BYTES, WHAT)
    return _CLASS_KEY.search(text) is not None or any(
        f'"{nodes}"' in text and f'"{edges}"' in text
        for nodes, edges in (("node", "edge"), ("vertex", "face"), ("vertex", "edge"))
    )


def _name(key: str) -> str:
    """Return the name that a key stands for: version 1 writes keys as Python literals."""
    try:
        value = ast.literal_eval(key) if len(key) < 200 else key
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return key
    return str(value) if isinstance(value, str | int | tuple) else key


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        allowed = "an object, { ... }"
        raise InvalidValueError("not a table", where=where, given=type(value).__name__, allowed=allowed)
    return value


def _number(values: Mapping[str, Any], key: str, where: str) -> float | None:
    """Return a number, None if it is missing or null."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        problem, allowed = "not a number", "a number, such as 0.25"
        raise InvalidValueError(problem, where=f"{where}.{key}", given=str(value)[:80], allowed=allowed)
    if abs(value) >= 1e300 or not math.isfinite(value):
        raise NonFiniteError("the number is too large", where=f"{where}.{key}", allowed="up to 1e300")
    return float(value)


def _flag(values: Mapping[str, Any], key: str, where: str) -> bool:
    """Return a Boolean, False if it is missing or null; 0 and 1 are Booleans too."""
    value = values.get(key)
    if value is None or isinstance(value, bool) or (isinstance(value, int | float) and value in (0, 1)):
        return bool(value)
    allowed = "true or false, without quotes"
    raise InvalidValueError("not a Boolean", where=f"{where}.{key}", given=str(value)[:80], allowed=allowed)


def _count(ignored: dict[str, int], values: Mapping[str, Any], known: Sequence[str]) -> None:
    for key, value in values.items():
        if key not in known and value not in (None, 0):
            ignored[key] = ignored.get(key, 0) + 1


def _read_node(
    network: Network, name: str, values: Mapping[str, Any], where: str, ignored: dict[str, int]
) -> None:
    node: dict[str, Any] = {"position": [_number(values, axis, where) or 0.0 for axis in "xyz"]}
    flags = [_flag(values, key, where) for key in ANCHORS]  # wrong ones are refused, all of them
    if any(flags):
        node["anchored"] = True
    if any(axis in values and values[axis] is None for axis in "xyz"):
        ignored["null coordinates, which are 0"] = ignored.get("null coordinates, which are 0", 0) + 1
    mass = _number(values, "mass", where)
    if mass:
        node["mass"] = mass
    force = [_number(values, key, where) or 0.0 for key in LOADS]
    if any(force):
        network.loads.append((name, force))
    network.nodes[name] = node
    _count(ignored, values, ("x", "y", "z", "mass", *ANCHORS, *LOADS, *REACTIONS))


def _read_edge(
    network: Network, ends: tuple[str, str], values: Mapping[str, Any], where: str, ignored: dict[str, int]
) -> None:
    member: dict[str, Any] = {"kind": ""}
    for key, target in NUMBERS.items():
        value = _number(values, key, where)
        if value is not None and not (target == "prestress" and value == 0 and values.get("q")):
            member[target] = value
    density = _number(values, "q", where)
    if density is not None and "prestress" not in member and "rest_length" not in member:
        positions = [network.nodes[end]["position"] for end in ends if end in network.nodes]
        length = math.dist(*positions) if len(positions) == 2 else 0.0  # a missing node is an error later
        member["prestress"] = density * length
    modulus, area = _number(values, "E", where), _number(values, "A", where)
    if modulus is not None and area is not None and "axial_stiffness" not in member:
        member["axial_stiffness"] = modulus * area
    member["kind"] = _find_kind(values, member, where)
    if member["kind"] == "cable" and member.get("prestress", 0.0) < 0:
        member["tension_only"] = False
    name = str(values.get("name") or network.name_member(f"{ends[0]}_{ends[1]}"))
    network.members.append(NetworkMember(name, ends, member, where))
    _count(ignored, values, ("name", *KINDS, *NUMBERS, *OTHERS))


def _find_kind(values: Mapping[str, Any], member: Mapping[str, Any], where: str) -> str:
    """Return bar or cable: by an attribute, else by the sign of force or force density."""
    for key in ("is_strut", "is_bar"):
        if values.get(key) is not None:
            return "bar" if _flag(values, key, where) else "cable"
    for key in ("kind", "type"):
        kind = values.get(key)
        if isinstance(kind, str) and kind.lower() in (*BARS, *CABLES):
            return "bar" if kind.lower() in BARS else "cable"
    force = member.get("prestress") or _number(values, "q", where)
    if force:
        return "bar" if force < 0 else "cable"
    problem = "neither a bar nor a cable"
    allowed = f'an attribute "kind" ({", ".join((*BARS, *CABLES))}), "is_strut", "q" or "f"'
    value = ", ".join(sorted(values))[:80] or "no attributes"
    raise InvalidValueError(problem, where=where, given=value, allowed=allowed)


FORMAT = Format(
    title="networks of COMPAS (JSON)", sources=("network.json",), endings=(".json",), read=import_compas,
    order=4, recognises=is_compas,
)  # fmt: skip
