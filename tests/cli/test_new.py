import tomllib
from pathlib import Path

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cli.conftest import Run


@pytest.mark.parametrize("shape", list_examples())
def test_every_shape_gives_a_scene_that_is_good(shape: str, run: Run, folder: Path) -> None:
    ended = run.good("new", "my_scene.toml", "--shape", shape, "--json")
    assert ended.facts == {"status": "ok", "scene": "my_scene.toml", "shape": shape}
    checked = run("check", "my_scene.toml", "--json")
    assert checked.code == 0
    assert checked.data["name"] == "my_scene"


def test_only_the_name_differs_from_the_example(run: Run, folder: Path) -> None:
    run("new", "mine.toml", "--shape", "prism")
    mine, theirs = (folder / "mine.toml").read_text(encoding="utf-8"), list_examples()["prism"]
    different = [(a, b) for a, b in zip(mine.splitlines(), theirs.splitlines(), strict=True) if a != b]
    assert len(different) == 1
    assert different[0][0].startswith('name = "mine"')
    assert tomllib.loads(mine) == tomllib.loads(theirs) | {"name": "mine"}


@pytest.mark.parametrize("name", ['a".toml', "a;b.toml", "a\nb.toml", "1a.toml", ".toml", "", "double.toml"])
def test_a_file_name_that_gives_no_scene_name_is_refused(name: str, run: Run, folder: Path) -> None:
    ended = run.refused("new", name, "--json")
    assert ended.data["error"] == "InvalidNameError"
    assert list(folder.iterdir()) == []


def test_a_file_is_replaced_with_overwrite_only(run: Run, folder: Path) -> None:
    (folder / "mine.toml").write_text("precious", encoding="utf-8")
    run.refused("new", "mine.toml")
    assert (folder / "mine.toml").read_text(encoding="utf-8") == "precious"
    run.good("new", "mine.toml", "--overwrite")


def test_an_unknown_shape_is_refused_with_the_known_ones(run: Run, folder: Path) -> None:
    ended = run.refused("new", "mine.toml", "--shape", "prisn", "--json")
    assert "'prism'" in ended.data["hint"]
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("place", ["missing/mine.toml", "file/mine.toml"])
def test_a_folder_that_is_none_is_refused(place: str, run: Run, folder: Path) -> None:
    (folder / "file").write_text("", encoding="utf-8")
    ended = run.refused("new", place, "--json")
    assert ended.data["where"] == place
    assert [path.name for path in folder.iterdir()] == ["file"]
