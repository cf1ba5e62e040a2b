"""Every number of every example scene has a path; what is no number is a named error."""

import copy
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.scene.read import parse_scene, read_document
from tensegrity_codegen.sweeps.keys import KeyPath, find_numbers
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError, UnknownKeyError

EXAMPLES = Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.toml"))


def document(name: str) -> dict[str, Any]:
    return read_document(EXAMPLES / f"{name}.toml")


def count_numbers(value: Any) -> int:
    """Count the numbers of a scene without its schema."""
    if isinstance(value, dict | list):
        return sum(map(count_numbers, value.values() if isinstance(value, dict) else value))
    return isinstance(value, int | float) and not isinstance(value, bool)


@pytest.mark.parametrize("name", NAMES)
def test_every_number_of_an_example_can_be_read_and_written(name: str) -> None:
    scene = document(name)
    before = copy.deepcopy(scene)
    paths = list(find_numbers(scene))
    assert len(paths) == len(set(paths)) == count_numbers(scene)
    for path in paths:
        key = KeyPath.find(path, scene)
        value = key.read(scene)
        assert value is not None
        changed = key.write(scene, value + 1)
        assert key.read(changed) == value + 1
        others = [other for other in paths if other != path]
        assert [KeyPath.find(k, changed).read(changed) for k in others[:40]] == [
            KeyPath.find(k, scene).read(scene) for k in others[:40]
        ]
        assert key.write(changed, value) == scene
    assert scene == before


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_with_its_own_numbers_written_again_is_the_same_scene(name: str) -> None:
    scene = document(name)
    again = scene
    for path in find_numbers(scene):
        key = KeyPath.find(path, scene)
        again = key.write(again, float(key.read(scene) or 0.0))
    assert parse_scene(again) == parse_scene(scene)


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("prism", "shape.twist", 140.0),
        ("prism", "classes.cable.damping", 0.5),
        ("prism", "limits.clearance", 0.01),
        ("prism", "limits.classes.cable.least_tension", 2.0),
        ("prism12", "gravity[2]", -9.81),
        ("prism12", "actuators.v1.delay", 0.1),
        ("prism12", "actuators.v2.range[1]", 0.5),
        ("planar", "nodes.c.velocity[1]", 0.3),
        ("planar", "members.top.damping", 0.3),
        ("svd_tower", "bodies.top.centre_velocity[1]", 0.1),
        ("svd_tower", "bodies.top.psi_rate_deg", 3.0),
        ("svd_tower", "inputs.M2.direction[0]", 0.5),
        ("svd_tower", "bodies.base.points.A11[2]", 0.1),
        ("svd_tower", "tendons.saddle1.damping", 0.1),
        ("lin_prism", "classes.spring.damping", 0.2),
    ],
)
def test_numbers_that_the_scene_does_not_state_can_be_set(name: str, path: str, value: float) -> None:
    scene = document(name)
    key = KeyPath.find(path, scene)
    changed = key.write(scene, value)
    assert key.read(changed) == value
    parse_scene(changed)


@pytest.mark.parametrize(
    ("name", "path", "error", "hint"),
    [
        ("prism", "classes.cable.spring_constnat", UnknownKeyError, "spring_constant"),
        ("prism", "clases.cable.spring_constant", UnknownKeyError, "classes"),
        ("prism", "classes.cabel.spring_constant", UnknownKeyError, "cable"),
        ("prism", "classes.cable", InvalidValueError, "classes.cable.spring_constant"),
        ("prism", "classes.cable.kind", InvalidValueError, ""),
        ("prism", "classes.cable.kind.x", TensegrityError, ""),
        ("prism", "gravity", InvalidValueError, "gravity[0]"),
        ("prism", "gravity[3]", InvalidValueError, "0 to 2"),
        ("prism12", "gravity[3]", InvalidValueError, "0 to 2"),
        ("prism", "loads.t1.force[2]", TensegrityError, "loads[0]"),
        ("prism", "loads[1].force[2]", InvalidValueError, "0 to 0"),
        ("prism", "shape.height.x", InvalidValueError, ""),
        ("prism", "shape.height[0]", InvalidValueError, ""),
        ("prism", "shape.anchor_bottom", InvalidValueError, ""),
        ("prism", "nodes.n3.position[1]", UnknownKeyError, ""),
        ("prism", "name", InvalidValueError, ""),
        ("prism", "", InvalidValueError, ""),
        ("prism", "[0]", InvalidValueError, ""),
        ("prism", "a..b", InvalidValueError, ""),
        ("prism", "loads[-1].force[2]", InvalidValueError, ""),
        ("prism", "loads[0", InvalidValueError, ""),
        ("planar", "nodes.c.position[2]", InvalidValueError, "0 to 1"),
        ("planar", "nodes.c.velocity[2]", InvalidValueError, "0 to 1"),
        ("prism12", "actuators.v9.delay", UnknownKeyError, "v1"),
        ("svd_tower", "bodies.top.inertia[0][1]", InvalidValueError, ""),
        ("svd_tower", "bodies.bar11.direction[0]", InvalidValueError, "whole list"),
    ],
)
def test_what_is_no_number_is_a_named_error(
    name: str, path: str, error: type[TensegrityError], hint: str
) -> None:
    with pytest.raises(error) as caught:
        KeyPath.find(path, document(name), "scene.toml")
    assert hint in str(caught.value)
    assert path in str(caught.value)
