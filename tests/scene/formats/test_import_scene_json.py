"""Whole scenes as JSON: out and in again without any loss, of nodes and of bodies."""

import json
import tomllib
from pathlib import Path

import pytest

from tensegrity_codegen import read_scene
from tensegrity_codegen.cli.verbs.examples import list_examples, read_example
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.import_scene_json import SCENE_FORMAT
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    UnknownKeyError,
)


@pytest.mark.parametrize("name", list_examples())
def test_every_example_comes_back_as_it_was(name: str, tmp_path: Path) -> None:
    scene = tmp_path / f"{name}.toml"
    scene.write_text(read_example(name), encoding="utf-8")
    out = tmp_path / "whole.json"
    exported = write_export("json", ExportSource(scene, *load_scene(scene)), out)
    assert exported.facts["n_members"] > 0
    assert json.loads(out.read_text(encoding="utf-8"))["format"] == SCENE_FORMAT
    back = tmp_path / "back.toml"
    write_scene(read_files([out]).document, back)
    assert read_scene(back) == read_scene(scene)
    if "[nodes]" not in read_example(name):
        with pytest.raises(SceneError):
            read_files([out], up="y")  # shapes and bodies keep their axes


def test_the_ground_comes_back_and_keeps_its_axes(tmp_path: Path) -> None:
    nodes = {"a": {"position": [0, 0, 2], "anchored": True}, "b": {"position": [0, 0, 1], "mass": 1.0}}
    rope = {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 100.0}
    ground = {"slope_deg": 20, "stiffness": 1e4, "contacts": ["b"]}
    scene = {"name": "swing", "nodes": nodes, "members": {"ab": rope}, "ground": ground}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"format": SCENE_FORMAT, **scene}), encoding="utf-8")
    write_scene(read_files([path]).document, tmp_path / "back.toml")
    assert read_scene(tmp_path / "back.toml") == read_scene(scene)
    with pytest.raises(InvalidValueError, match="keeps its axes and units"):
        read_files([path], up="y")


def test_name_and_gravity_are_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    whole = {"format": SCENE_FORMAT, **tomllib.loads(read_example("two_nodes"))}
    path.write_text(json.dumps(whole), encoding="utf-8")
    document = read_files([path], name="b", gravity=[0, 0, -1]).document
    assert (document["name"], list(document["gravity"])) == ("b", [0.0, 0.0, -1.0])


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ('{"format": "tensegrity_codegen scene 9", "name": "a"}', InvalidValueError),
        (f'{{"format": "{SCENE_FORMAT}", "name": "a", "nods": {{}}}}', UnknownKeyError),
        (f'{{"format": "{SCENE_FORMAT}", "name": "a", "name": "b"}}', DuplicateNameError),
        (f'[{{"format": "{SCENE_FORMAT}"}}]', InvalidValueError),
    ],
)
def test_wrong_files_are_refused_by_name(text: str, error: type[SceneError], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(error) as caught:
        read_files([path])
    assert "a.json" in caught.value.where
