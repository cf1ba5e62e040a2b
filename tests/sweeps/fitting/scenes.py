"""Scenes whose numbers are found again, and what is measured of their motions."""

from copy import deepcopy
from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate

# 1 kg that falls 0.5 m onto a damped cable.
FALL: dict[str, Any] = {
    "name": "fall",
    "gravity": [0, 0, -9.81],
    "nodes": {
        "top": {"position": [0, 0, 0], "anchored": True},
        "weight": {"position": [0, 0, -0.5], "mass": 1.0, "anchored": "xy"},
    },
    "members": {
        "rope": {
            "nodes": ["top", "weight"],
            "kind": "cable",
            "spring_constant": 100.0,
            "rest_length": 1.0,
            "damping": 2.0,
        }
    },
    "model": {"quantities": ["acceleration"]},
}
ROPE = ("members.rope.spring_constant", "members.rope.damping", "members.rope.rest_length")

# A rigid rod of 1 kg that slips and bounces in its plane.
ROD: dict[str, Any] = {
    "name": "rod",
    "axes": "xz",
    "gravity": [0, -9.81],
    "model": {"quantities": ["acceleration"], "formulation": "rigid_bar"},
    "nodes": {"low": {"position": [0, 0.3]}, "high": {"position": [0.75**0.5, 0.8]}},
    "members": {"rod": {"nodes": ["low", "high"], "kind": "bar", "mass": 1.0, "radius": 0.02}},
    "ground": {
        "stiffness": 1e5,
        "dissipation": 0.35,
        "friction": 0.4,
        "stick_stiffness": 1e5,
        "stick_damping": 100.0,
    },
}

# A prism that swings on anchored feet, with two classes of cables.
PRISM: dict[str, Any] = {
    "name": "swinging",
    "gravity": [0, 0, -9.81],
    "model": {"quantities": ["acceleration"]},
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 2e4, "mass": 0.05},
        "cable": {"kind": "cable", "spring_constant": 300.0, "damping": 0.4},
    },
    "shape": {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "height": 0.3,
        "node_mass": 0.05,
        "anchor_bottom": True,
        "prestress": 5.0,
    },
    "loads": [{"node": "t1", "force": [2.0, 0.0, 0.0]}],
}


def change(scene: dict[str, Any], **values: float) -> dict[str, Any]:
    """Return the scene with other numbers, by their paths with __ for points."""
    found = deepcopy(scene)
    for path, value in values.items():
        *tables, last = path.split("__")
        table = found
        for name in tables:
            table = table[name]
        table[last] = value
    return found


def measure(
    scene: dict[str, Any], times: Any, names: Any, noise: float = 0.0, seed: int = 0
) -> dict[str, Any]:
    """Return what is measured of the motion of a scene: positions by names such as t1.x, with noise."""
    samples = np.concatenate([[0.0], times])
    motion = simulate(compile_scene(scene, for_="simulate"), float(times[-1]), samples=samples, rtol=1e-9)
    assert motion.status == "ok"
    draw = np.random.default_rng(seed)
    found: dict[str, Any] = {"time": np.asarray(times)}
    for name in names:
        node, _, axis = name.partition(".")
        values = motion.node_position[1:, motion.node_name.index(node), "xyz".index(axis)]
        found[name] = values + noise * draw.normal(size=len(times))
    return found


# Two masses on a damped cable that slides over a ring with friction.
RING: dict[str, Any] = {
    "name": "ring",
    "axes": "xz",
    "gravity": [0, -9.81],
    "model": {"quantities": ["acceleration"]},
    "classes": {"cord": {"kind": "cable", "axial_stiffness": 2000.0, "damping": 5.0}},
    "nodes": {
        "a": {"position": [0, 0], "mass": 1.0},
        "r": {"position": [0.1, 1.0], "anchored": True},
        "b": {"position": [0.5, 0.1], "mass": 1.4},
    },
    "members": {"rope": {"class": "cord", "nodes": ["a", "r", "b"], "rest_length": 1.9, "friction": 0.1}},
}
