"""Scenes and motions that are exported in tests."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen import load_scene
from tensegrity_codegen.cli.verbs.examples import read_example
from tensegrity_codegen.export.exporter import ExportSource
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.outline import outline_tendons

Array = NDArray[np.float64]

# A prism that swings on its feet: cables go slack and taut; two inputs, parameters of four kinds, damping.
LOOSE = """
name = "loose"
gravity = [0, 0, -9.81]

[model]
quantities = ["member_tension", "total_energy"]

[parameters]
rest_length = ["verticals"]
node_load = ["t1"]
gravity = "all"
damping = ["bottom1"]

[groups]
verticals = ["vertical1", "vertical2", "vertical3"]

[classes.bar]
kind = "bar"
spring_constant = 2e4
mass = 0.05

[classes.cable]
kind = "cable"
spring_constant = 200
damping = 0.2

[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
height = 0.30
node_mass = 0.05
anchor_bottom = "z"
prestress = 1.0

[[loads]]
node = "t1"
force = [0.4, 0, -1]

[[inputs]]
name = "winch"
kind = "rest_length"
members = ["vertical1"]

[[inputs]]
name = "push"
kind = "force"
nodes = ["t2"]
direction = [0, 1, 0]
"""


def write_loose(folder: Path) -> Path:
    """Write the scene LOOSE to a folder; return its file."""
    path = folder / "loose.toml"
    path.write_text(LOOSE, encoding="utf-8")
    return path


def write_motion(path: Path, subject: Subject, n_samples: int = 5, **changes: Any) -> Array:
    """Write a result file of a motion that turns all nodes about x and y; return positions (n_t, n_nodes, 3).

    The last turn is a half one. changes: arrays of the file in place of these.
    """
    structure = outline_tendons(subject)
    time = np.linspace(0.0, 0.5, n_samples)
    position = np.empty((n_samples, structure.n_nodes, 3))
    for sample, part in enumerate(np.linspace(0.0, 1.0, n_samples)):
        turn = Rotation.from_rotvec([np.pi * part, 0.3 * part, 0.0])
        position[sample] = turn.apply(structure.node_position.copy()) * (1.0 + 0.1 * part) + [0.0, 0.0, part]
    tension = np.outer(1.0 + time, np.arange(1.0, structure.n_members + 1.0))
    arrays = {
        "time": time,
        "node_position": position,
        "node_velocity": np.zeros_like(position),
        "member_tension": tension,
        "kinetic_energy": time,
        "total_energy": time,
        "node_name": np.array(structure.node_name),
        "member_name": np.array(structure.member_name),
        "status": np.array("ok"),
        "message": np.array(""),
        "method": np.array("rk54"),
    }
    np.savez(path, **(arrays | changes))
    return position


def load_source(folder: Path, name: str) -> ExportSource:
    """Write an example to a folder; return it as the source of an export."""
    path = folder / f"{name}.toml"
    path.write_text(read_example(name), encoding="utf-8")
    return ExportSource(path, *load_scene(path))


# A cable through a ring, which a second cable holds.
HOIST: dict[str, Any] = {
    "name": "hoist",
    "nodes": {
        "a": {"position": [0, 0, 1], "anchored": True},
        "ring": {"position": [0.5, 0, 0], "mass": 0.2},
        "b": {"position": [1, 0, 1], "anchored": True},
        "foot": {"position": [0.5, 0, -1], "anchored": True},
    },
    "members": {
        "rope": {"kind": "cable", "nodes": ["a", "ring", "b"], "prestress": 3.0, "axial_stiffness": 1e3},
        "stay": {"kind": "cable", "nodes": ["ring", "foot"], "prestress": 5.0, "axial_stiffness": 1e3},
    },
}
