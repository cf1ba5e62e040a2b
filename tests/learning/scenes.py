"""Scenes of environments: a weight on a cord with a winch, and a prism on the ground with three winches."""

from typing import Any

CORD: dict[str, Any] = {
    "name": "cord",
    "gravity": [0, 0, -9.81],
    "classes": {"cord": {"kind": "cable", "spring_constant": 80.0, "rest_length": 1.0, "damping": 1.0}},
    "nodes": {
        "top": {"position": [0, 0, 0], "anchored": True},
        "load": {"position": [0, 0, -1.0], "mass": 0.5},
    },
    "members": {"c": {"class": "cord", "nodes": ["top", "load"]}},
    "inputs": [{"kind": "force", "name": "push", "nodes": ["load"], "direction": [1, 0, 0]}],
    "actuators": [{"name": "winch", "members": "c", "rate": 0.5, "range": [0.9, 1.2], "delay": 0.013}],
    "sensors": [
        {"kind": "member_length", "members": "all", "noise": 1e-3, "name": "length"},
        {"kind": "node_position", "nodes": ["load"]},
    ],
}
PRISM: dict[str, Any] = {
    "name": "standing",
    "gravity": [0, 0, -9.81],
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 2e4, "mass": 0.1, "damping": 20.0},
        "cable": {"kind": "cable", "spring_constant": 400.0, "damping": 5.0},
    },
    "shape": {
        "kind": "prism", "bottom_radius": 0.15, "top_radius": 0.12, "height": 0.15, "node_mass": 0.05,
        "prestress": 20.0,
    },
    "ground": {"stiffness": 5e3, "dissipation": 0.5, "friction": 0.7},
    "actuators": [
        {"name": f"winch{k}", "members": f"vertical{k}", "rate": 0.5, "range": [0.1, 0.4]} for k in (1, 2, 3)
    ],
}  # fmt: skip
