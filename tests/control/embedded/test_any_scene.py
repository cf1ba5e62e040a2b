"""Controllers of all kinds of scenes compute what Python computes: bodies, nodes, planes, sensors."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.actuators import Sensor
from tests.body_scenes import EVERYTHING
from tests.control.embedded.made_up import check_made_up, make_up

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples"


def read_example(name: str) -> dict[str, Any]:
    document = tomllib.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    document.pop("parameters", None)
    return document


def check(
    document: dict[str, Any], sensors: list[Sensor], folder: Path, *, tolerance: float = 1e-12, **options: Any
) -> None:
    subject, request = assemble_scene(parse_scene(document), "scene")
    check_made_up(make_up(subject, request, sensors, **options), folder, tolerance)


def test_bodies_of_all_kinds(tmp_path: Path) -> None:
    """Free and joined bodies, torques, a member with three inputs, all kinds of sensors."""
    document = copy.deepcopy(EVERYTHING)
    document["actuators"] = [
        {"name": "first", "members": ["t1"], "rate": 0.3, "range": [0.2, 0.6]},
        {"name": "second", "members": ["t1", "t3"]},
        {"name": "third", "members": ["t2"], "rate": 1.0},
    ]
    sensors = [
        Sensor("member_tension", (1, 0), 1.0),
        Sensor("node_position", (3, 7), 1e-3),
        Sensor("member_length", (4, 2), 1e-3),
        Sensor("node_velocity", (5,), 1e-2),
        Sensor("member_length", (0,), 1e-3),
    ]
    check(document, sensors, tmp_path, delay=np.array([0.0, 0.003, 0.0005]))


@pytest.mark.parametrize("away", [0.0, 1000.0])
def test_a_plane_with_springs_as_bars(away: float, tmp_path: Path) -> None:
    """Positions of free, held and half-held nodes, near the origin and far from it."""
    document = read_example("planar.toml")
    for node in document["nodes"].values():
        node["position"] = [x + away for x in node["position"]]
    document["actuators"] = [{"name": "m", "members": ["top", "left"], "rate": 0.1}]
    sensors = [
        Sensor("node_position", (0, 1, 2, 3), 1e-3),
        Sensor("member_length", (2, 3), 1e-3),
        Sensor("node_velocity", (1, 0), 1e-3),
    ]
    check(document, sensors, tmp_path, tolerance=1e-12 * max(away, 1.0))


@pytest.mark.thorough
def test_a_free_tower_of_nodes(tmp_path: Path) -> None:
    """Coupled masses of bars, forces as inputs, actuators of several members."""
    document = read_example("tower.toml")
    document["actuators"] = [
        {"name": "m", "members": ["vertical2_1", "vertical1_1"], "rate": 0.2},
        {"name": "k", "members": ["saddle1_1"], "rate": 0.2, "delay": 0.001},
    ]
    sensors = [Sensor("member_length", (20, 3, 11), 1e-3), Sensor("node_position", (4, 16), 1e-3)]
    check(document, sensors, tmp_path, substeps=8)
