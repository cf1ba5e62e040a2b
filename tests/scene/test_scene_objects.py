"""Scenes as dictionaries and as text: what is read from either is the same, and nothing is lost."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import Scene, compile_scene, load_scene, read_scene
from tensegrity_codegen.cli.verbs.examples import list_examples, read_example
from tensegrity_codegen.system.errors import SceneError, SceneSyntaxError, StructureError, UnknownKeyError

SMALL: dict[str, Any] = {
    "name": "pair",
    "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [0, 0, -1.0], "mass": 0.1}},
    "members": {"ab": {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 10.0, "rest_length": 0.3}},
}


@pytest.mark.parametrize("name", list_examples())
def test_text_and_dictionary_of_a_scene_are_the_scene(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(read_example(name), encoding="utf-8")
    scene = read_scene(path)
    plain = tomllib.loads(read_example(name))
    assert tomllib.loads(scene.to_toml()) == plain
    assert read_scene(plain) == read_scene(tomllib.loads(scene.to_toml())) == scene
    assert read_scene(scene.to_document()) == scene
    again = tmp_path / "again.toml"
    again.write_text(scene.to_toml(), encoding="utf-8")
    assert read_scene(again) == scene
    assert len(repr(scene).splitlines()) <= 5


def test_numbers_of_numpy_are_read() -> None:
    given = {
        **SMALL,
        "nodes": {
            "a": {"position": np.zeros(3), "anchored": np.bool_(True)},
            "b": {"position": np.array([0, 0, -1.0]), "mass": np.float64(0.1)},
        },
        "members": {"ab": {**SMALL["members"]["ab"], "rest_length": np.float32(0.25)}},
    }
    scene = read_scene(given)
    assert scene.nodes["b"].position == (0.0, 0.0, -1.0)
    assert scene.members["ab"].rest_length == 0.25
    assert isinstance(given["nodes"], dict)  # what was given is as it was
    assert isinstance(given["nodes"]["a"]["position"], np.ndarray)


def test_a_scene_object_is_loaded_as_its_file() -> None:
    scene = read_scene(SMALL)
    assert isinstance(scene, Scene)
    assert read_scene(scene) is scene
    for given in (SMALL, scene):
        structure, _ = load_scene(given)
        assert (structure.name, structure.n_members) == ("pair", 1)
    assert compile_scene(SMALL).compute("member_tension").tolist() == pytest.approx([7.0])


def test_errors_name_the_key() -> None:
    nested: Any = {}
    for _ in range(5000):
        nested = {"a": nested}
    for given, error, where in (
        ({**SMALL, "nods": {}}, UnknownKeyError, "scene: nods"),
        ({}, StructureError, "scene"),
        ({**SMALL, "gravity": [np.nan, 0, 0]}, SceneError, "scene: gravity[0]"),
        (
            {**SMALL, "members": {"ab": {**SMALL["members"]["ab"], "nodes": ["a", "c"]}}},
            SceneError,
            "scene: members.ab",
        ),
        ({"name": nested}, SceneSyntaxError, "scene"),
    ):
        with pytest.raises(error) as caught:
            load_scene(given)  # type: ignore[arg-type]
        assert caught.value.where.startswith(where)
