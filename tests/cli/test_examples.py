from pathlib import Path

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cli.conftest import Run

SHIPPED = ("icosahedron", "planar", "prism", "tower", "two_nodes")


def test_the_shipped_scenes_are_listed_with_a_sentence(run: Run) -> None:
    told = run("examples", "--json").data["examples"]
    assert set(SHIPPED) <= set(told)
    assert all(len(sentence) > 20 and not sentence.startswith("#") for sentence in told.values())
    lines = run("examples").out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(told)


@pytest.mark.parametrize("name", list_examples())
def test_an_example_is_copied_out(name: str, run: Run, folder: Path) -> None:
    ended = run("examples", name, "--json")
    assert ended.facts == {"status": "ok", "out": f"{name}.toml"}
    assert (folder / f"{name}.toml").read_text(encoding="utf-8") == list_examples()[name]


def test_the_copy_goes_where_it_is_told(run: Run, folder: Path) -> None:
    run.good("examples", "prism", "--out", "other.toml")
    assert [path.name for path in folder.iterdir()] == ["other.toml"]


def test_an_unknown_example_is_refused(run: Run, folder: Path) -> None:
    ended = run.refused("examples", "two_node", "--json")
    assert "'two_nodes'" in ended.data["hint"]
    assert list(folder.iterdir()) == []


def test_a_folder_is_no_place_for_a_file(run: Run, folder: Path) -> None:
    (folder / "there").mkdir()
    ended = run.refused("examples", "prism", "--out", "there", "--overwrite", "--json")
    assert "folder" in ended.data["problem"]
    assert list((folder / "there").iterdir()) == []
