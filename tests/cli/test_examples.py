from pathlib import Path

import pytest

from tensegrity_codegen.cli.scene_files import list_examples
from tests.cli.conftest import Run

SHIPPED = ("icosahedron", "planar", "prism", "tower", "two_nodes")


def test_the_shipped_scenes_are_listed_with_a_sentence(run: Run) -> None:
    told = run("examples", "--json").data["examples"]
    assert set(SHIPPED) <= set(told)
    assert all(len(sentence) > 20 and not sentence.startswith("#") for sentence in told.values())
    lines = run("examples").out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(told)


@pytest.mark.parametrize("name", list_examples())
def test_an_example_is_copied_out_and_good(name: str, run: Run, folder: Path) -> None:
    ended = run("examples", name, "--json")
    assert ended.facts == {"status": "ok", "out": f"{name}.toml"}
    assert (folder / f"{name}.toml").read_text(encoding="utf-8") == list_examples()[name]
    assert run("check", f"{name}.toml").code == 0


def test_the_copy_goes_where_it_is_told(run: Run, folder: Path) -> None:
    assert run("examples", "prism", "--out", "other.toml").code == 0
    assert [path.name for path in folder.iterdir()] == ["other.toml"]


def test_an_unknown_example_is_refused(run: Run, folder: Path) -> None:
    ended = run("examples", "two_node", "--json")
    assert ended.code == 2
    assert "'two_nodes'" in ended.data["hint"]
    assert list(folder.iterdir()) == []


def test_a_file_is_kept_unless_told_otherwise(run: Run, folder: Path) -> None:
    (folder / "prism.toml").write_text("precious", encoding="utf-8")
    assert run("examples", "prism").code == 2
    assert (folder / "prism.toml").read_text(encoding="utf-8") == "precious"
    assert run("examples", "prism", "--overwrite").code == 0


def test_a_folder_is_no_place_for_a_file(run: Run, folder: Path) -> None:
    (folder / "there").mkdir()
    ended = run("examples", "prism", "--out", "there", "--overwrite", "--json")
    assert ended.code == 2
    assert "folder" in ended.data["problem"]
    assert list((folder / "there").iterdir()) == []
