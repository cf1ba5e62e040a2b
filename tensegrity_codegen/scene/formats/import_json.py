"""Import of a structure from a JSON file of nodes and members.

    {"nodes": {"a": [0, 0, 0], "b": {"position": [0, 0, 1], "mass": 0.1}},
     "members": [{"from": "a", "to": "b", "kind": "cable", "axial_stiffness": 100, "prestress": 2}],
     "anchors": ["a"], "loads": {"b": [0, 0, -1]}, "gravity": [0, 0, -9.81]}

Nodes and members may be lists too; then they go by their numbers. SI units; docs/import.md has every key.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES
from tensegrity_codegen.scene.formats.files.documents import read_json
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import (
    CONTROL_SECTIONS,
    POSITIVE,
    ImportResult,
    Network,
    NetworkMember,
    build_result,
    check_ends,
)
from tensegrity_codegen.scene.names import check_known, check_scene_name, key_path, unknown_key
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
)

SECTIONS = ("name", "gravity", "nodes", "members", "anchors", "loads", *CONTROL_SECTIONS)
NODE_KEYS = ("name", "position", "velocity", "mass", "anchored")
NUMBERS = (*POSITIVE, "damping", "prestress")
MEMBER_KEYS = ("name", "from", "to", "kind", *NUMBERS, "tension_only")
AXES = ("x", "y", "z", "xy", "xz", "yz", "xyz")


def import_json(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document that a JSON file of nodes and members states, and notes."""
    path = Path(path)
    content = _Place(read_json(path, "a JSON file of nodes and members"), str(path), ()).table(SECTIONS)
    if name is None and "name" in content:
        name = content["name"].text()
        check_scene_name(name, content["name"].where)
    nodes = _list_entries(content, "nodes", NODE_KEYS, path)
    members = _list_entries(content, "members", MEMBER_KEYS, path)
    network = Network({key: _read_node(entry) for key, entry in nodes.items()})
    if gravity is None and "gravity" in content:
        network.gravity = content["gravity"].vector()
    _anchor(content.get("anchors"), network.nodes)
    network.members = [_read_member(key, entry, nodes) for key, entry in members.items()]
    network.loads = _read_loads(content.get("loads"), nodes)
    network.control = {key: content[key].value for key in CONTROL_SECTIONS if key in content}
    return build_result(network, path, name, gravity)


class _Place:
    """A value and the path that leads to it, for checks that name it in their errors."""

    def __init__(self, value: Any, file: str, path: tuple[str | int, ...]) -> None:
        self.value, self.file, self.path = value, file, path

    @property
    def where(self) -> str:
        return key_path(self.file, *self.path)

    def inner(self, key: str | int) -> "_Place":
        return _Place(self.value[key], self.file, (*self.path, key))

    def table(self, known: Sequence[str] = ()) -> "dict[str, _Place]":
        """Return the entries of a table; raises UnknownKeyError for one that is not `known`."""
        if not isinstance(self.value, dict):
            raise self.wrong("not a table", "an object, { ... }")
        for key in self.value if known else ():
            if key not in known:
                raise unknown_key(key, known, self.where)
        return {key: self.inner(key) for key in self.value}

    def items(self) -> "Iterator[tuple[str | int, _Place]]":
        """Yield the entries of a table or list, with their keys or numbers."""
        if not isinstance(self.value, dict | list):
            raise self.wrong("neither a table nor a list", "{ ... } or [ ... ]")
        if len(self.value) > MAX_ENTRIES:
            raise self.wrong("too many entries", f"up to {MAX_ENTRIES}")
        for key in self.value if isinstance(self.value, dict) else range(len(self.value)):
            yield key, self.inner(key)

    def text(self) -> str:
        if not isinstance(self.value, str) or not self.value:
            raise self.wrong("not a text", 'a text in quotes, "..."')
        return self.value

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.wrong("not a number", "a number, such as 0.25 or 1e-3")
        if (isinstance(self.value, int) and abs(self.value) >= 10**300) or not math.isfinite(self.value):
            problem = "the number is too large"
            raise NonFiniteError(problem, where=self.where, given=self.shown, allowed="up to 1e300")
        return float(self.value)

    def vector(self) -> list[float]:
        if not isinstance(self.value, list) or len(self.value) != 3:
            raise self.wrong("not a vector", "[x, y, z]")
        return [self.inner(axis).number() for axis in range(3)]

    def wrong(self, problem: str, allowed: str, hint: str = "") -> InvalidValueError:
        return InvalidValueError(problem, where=self.where, given=self.shown, allowed=allowed, hint=hint)

    @property
    def shown(self) -> str:
        """A short text of the value, which may be deep and long."""
        if isinstance(self.value, dict | list):
            return f"{'an object' if isinstance(self.value, dict) else 'a list'} of {len(self.value)} entries"
        return json.dumps(self.value if not isinstance(self.value, str) else self.value[:80])


def _list_entries(
    content: Mapping[str, _Place], section: str, keys: Sequence[str], path: Path
) -> dict[str, _Place]:
    """Return the entries of a section by name; those of a list by their key `name`, else their number."""
    if section not in content or not content[section].value:
        where = key_path(str(path), section)
        raise StructureError(f"the file has no {section}", where=where, allowed="one entry at least")
    entries: dict[str, _Place] = {}
    for key, entry in content[section].items():
        if isinstance(entry.value, dict):
            entry.table(keys)
        name_entry = entry.inner("name") if isinstance(entry.value, dict) and "name" in entry.value else None
        if name_entry is not None and isinstance(key, str):
            raise name_entry.wrong("the entry has a name already", f"no key name: it is {key!r}")
        name = str(key) if name_entry is None else name_entry.text()
        if name in entries:
            problem = f"two {section} with one name"
            raise DuplicateNameError(problem, where=entry.where, given=name, allowed="each name once")
        entries[name] = entry
    return entries


def _read_node(entry: _Place) -> dict[str, Any]:
    if isinstance(entry.value, list):
        return {"position": entry.vector()}
    values = entry.table(NODE_KEYS)
    if "position" not in values:
        raise entry.wrong("the node has no position", 'a key "position": [x, y, z]')
    node: dict[str, Any] = {"position": values["position"].vector()}
    if "mass" in values:
        node["mass"] = values["mass"].number()
        if not node["mass"] > 0:
            raise values["mass"].wrong("the value is out of range", "greater than 0, or no value")
    if "anchored" in values and values["anchored"].value is not False:
        node["anchored"] = _read_axes(values["anchored"])
    if "velocity" in values:
        node["velocity"] = values["velocity"].vector()
    return node


def _read_axes(held: _Place) -> Any:
    """Return which axes an anchor holds, as in a scene."""
    if held.value is not True and (not isinstance(held.value, str) or held.value not in AXES):
        raise held.wrong("not a valid value of anchored", f"true, or axes: {', '.join(AXES)}")
    return held.value


def _find_node(place: _Place, names: Mapping[str, Any]) -> str:
    """Return the node of the file that a value names, by its name or its number in a list."""
    value = place.value
    key = str(value) if isinstance(value, int) and not isinstance(value, bool) else place.text()
    check_known(key, names, "unknown node", "a node of the file", place.where)
    return key


def _anchor(anchors: _Place | None, nodes: Mapping[str, dict[str, Any]]) -> None:
    """Anchor the nodes that the section `anchors` names: a list of nodes, or node: axes."""
    for key, entry in anchors.items() if anchors is not None else ():
        node_entry = entry if isinstance(key, int) else _Place(key, entry.file, entry.path)
        node = nodes[_find_node(node_entry, nodes)]
        if "anchored" in node:
            problem, allowed = "the node is anchored twice", "each node once"
            raise DuplicateNameError(problem, where=entry.where, given=node_entry.value, allowed=allowed)
        node["anchored"] = True if isinstance(key, int) else _read_axes(entry)


def _read_loads(loads: _Place | None, names: Mapping[str, Any]) -> list[tuple[str, Sequence[float]]]:
    """Return the loads of the section `loads`: node: force, or a list of {"node": ..., "force": ...}."""
    forces: list[tuple[str, Sequence[float]]] = []
    for key, entry in loads.items() if loads is not None else ():
        if isinstance(key, str):
            node, force = _Place(key, entry.file, entry.path), entry
        else:
            values = entry.table(("node", "force"))
            if len(values) < 2:
                raise entry.wrong("the load lacks a key", "node and force")
            node, force = values["node"], values["force"]
        forces.append((_find_node(node, names), force.vector()))
    return forces


def _read_member(name: str, entry: _Place, nodes: Mapping[str, Any]) -> NetworkMember:
    values = entry.table(MEMBER_KEYS)
    for key in ("from", "to", "kind"):
        if key not in values:
            raise entry.wrong(f"the member has no key {key}", "from, to and kind")
    if values["kind"].value not in ("bar", "cable"):
        raise values["kind"].wrong("not a kind of member", '"bar" or "cable"')
    ends = _find_node(values["from"], nodes), _find_node(values["to"], nodes)
    check_ends(*ends, values["to"].shown, values["to"].where)
    member: dict[str, Any] = {"kind": values["kind"].value}
    member |= {key: values[key].number() for key in NUMBERS if key in values}
    if "tension_only" in values:
        two_sided = values["tension_only"].value is False
        if values["tension_only"].value is not True and not two_sided:
            raise values["tension_only"].wrong("neither true nor false", "true or false")
        if member["kind"] == "bar" and not two_sided:
            raise values["tension_only"].wrong("a bar takes both signs of force", "false, or no value")
        member |= {"tension_only": False} if two_sided and member["kind"] == "cable" else {}
    place_of = partial(key_path, entry.file, *entry.path)
    return NetworkMember(name, ends, member, entry.where, place_of)


FORMAT = Format(
    title="nodes and members (JSON)", sources=("structure.json",), endings=(".json",), read=import_json,
    order=9,
)  # fmt: skip
