"""Small scenes that the tests of the scene package change one key at a time."""

import copy
from typing import Any

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest

WHERE = "arch.toml"

ARCH: dict[str, Any] = {
    "name": "arch",
    "gravity": [0, 0, -9.81],
    "classes": {
        "strut": {"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1},
        "string": {"kind": "cable", "spring_constant": 100.0, "prestress": 10.0},
    },
    "nodes": {
        "a": {"position": [0, 0, 0], "anchored": True},
        "b": {"position": [2, 0, 0], "anchored": "xz"},
        "c": {"position": [1, 0, 1.5], "mass": 0.5},
    },
    "members": {
        "ac": {"class": "strut", "nodes": ["a", "c"]},
        "bc": {"class": "string", "nodes": ["b", "c"]},
        "ab": {"class": "string", "nodes": ["a", "b"], "rest_length": 1.5},
    },
    "groups": {"strings": ["bc", "ab"]},
    "loads": [{"node": "c", "force": [1, 0, 0]}],
    "inputs": [
        {"name": "u1", "kind": "rest_length", "members": ["strings"]},
        {"name": "push", "kind": "force", "nodes": ["c"], "direction": [0, 3, 4]},
    ],
}

REMOVE = object()


def changed(*path: str | int, to: Any, base: dict[str, Any] = ARCH) -> dict[str, Any]:
    """Return a copy of a scene document with one key set, or removed with `to=REMOVE`."""
    document = copy.deepcopy(base)
    node: Any = document
    for step in path[:-1]:
        node = node.setdefault(step, {}) if isinstance(node, dict) else node[step]
    if to is REMOVE:
        del node[path[-1]]
    else:
        node[path[-1]] = to
    return document


def build(document: dict[str, Any]) -> tuple[Structure, ModelRequest]:
    """Return the structure and request of a scene document."""
    return assemble(parse_scene(document, WHERE), WHERE)
