"""Scenes of the tests of operations: nodes and bodies, held and free, inputs and run-time parameters."""

import tomllib
from importlib.resources import files
from typing import Any

EXAMPLES = files("tensegrity_codegen") / "scene" / "examples"


def read_example(name: str) -> dict[str, Any]:
    return tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))


# Three bars and nine cables that slide on a table; loads and rest lengths change at run time.
PRISM: dict[str, Any] = read_example("prism") | {
    "parameters": {"node_load": ["t1", "t2"], "rest_length": "all", "spring_constant": ["bar1", "top1"]},
}

# A node between three anchored ones in a plane: cables that can go slack, one of them with a motor.
TRIANGLE: dict[str, Any] = {
    "name": "triangle",
    "axes": "xz",
    "gravity": [0, 0, -9.81],
    "model": {"quantities": ["member_tension"]},
    "classes": {"cable": {"kind": "cable", "axial_stiffness": 500, "damping": 0.5}},
    "nodes": {
        "a": {"position": [-1, 0, 0], "anchored": True},
        "b": {"position": [1, 0, 0], "anchored": True},
        "c": {"position": [0.1, 0, 1], "anchored": True},
        "m": {"position": [0, 0, 0.3], "mass": 0.5},
    },
    "members": {
        "left": {"class": "cable", "nodes": ["a", "m"], "rest_length": 0.95},
        "right": {"class": "cable", "nodes": ["b", "m"], "rest_length": 0.95},
        "top": {"class": "cable", "nodes": ["c", "m"], "rest_length": 0.65},
    },
    "inputs": [{"name": "pull", "kind": "rest_length", "members": ["top"]}],
    "parameters": {"rest_length": ["left", "right"], "node_load": ["m"]},
}

BODIES: dict[str, Any] = read_example("lin_prism") | {"parameters": {"rest_length": "all"}}

SINGLE: dict[str, Any] = TRIANGLE | {
    "name": "single",
    "model": {"quantities": ["member_tension"], "precision": "single"},
}
