"""Sentences and units of the keys of sweeps."""

from pathlib import Path

import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.sweeps.apply.assembler import read_scene_document
from tensegrity_codegen.sweeps.describe import describe_key

EXAMPLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen" / "scene" / "examples"


@pytest.mark.parametrize(
    ("scene", "key", "unit"),
    [
        ("prism", "classes.cable.spring_constant", "N/m"),
        ("prism", "shape.height", "m"),
        ("prism", "gravity[2]", "m/s2"),
        ("prism", "rest_length.vertical1", "m"),
        ("prism", "node_velocity.t1[0]", "m/s"),
        ("two_nodes", "nodes.n2.position[1]", "m"),
        ("prism12", "input.v1", "m"),
        ("prism12", "gust.t1[2]", "N"),
        ("prism12", "gust_time.start", "s"),
        ("prism", "shape.bars", ""),
    ],
)
def test_units_are_those_of_the_schema(scene: str, key: str, unit: str) -> None:
    path = EXAMPLES / f"{scene}.toml"
    document, _ = read_scene_document(path)
    found = describe_key(key, document, load_scene(path)[0])
    assert found["long_name"].startswith(f"{key} of the scene")
    assert found.get("units", "") == unit
