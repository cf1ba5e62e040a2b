"""The verb `export` with the formats of other programs."""

from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

from tests.cli.conftest import Run, write_example


def test_the_verb_writes_a_file_and_lists_what_is_not_in_it(run: Run, tower: Path) -> None:
    ended = run.good("export", "mjcf", tower, "--out", "tower.xml", "--json")
    assert (ended.data["n_nodes"], ended.data["n_members"]) == (18, 48)
    root = fromstring(Path("tower.xml").read_text(encoding="utf-8"))
    assert root.get("model") == "tower"
    names = [item.get("name") for item in root.iter("spatial")]
    assert len(set(names)) == 48
    assert any("groups and classes" in note for note in ended.data["notes"])
    assert any("exact while the cable is taut" in note for note in ended.data["notes"])
    run.refused("export", "mjcf", tower, "--out", "tower.urdf", "--json")
    assert run("export", "mjcf", tower, "--out", "tower.xml", "--json").code == 2  # exists


@pytest.fixture
def tower(folder: Path) -> Path:
    """The example tower as a file in the working folder."""
    return write_example(folder, "tower")
