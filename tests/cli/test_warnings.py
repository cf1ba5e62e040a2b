"""What looks like a slip in a scene is a warning line of every verb that reads it, and in its JSON."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import GOOD, write

VERBS = [
    ("check",),
    ("equilibrium",),
    ("simulate", "--t-end", "0.01", "--samples", "2"),
    ("linearize",),
    ("build", "--out", "made"),
    ("show", "--out", "a.png"),
]


@pytest.mark.thorough
@pytest.mark.parametrize("words", VERBS, ids=[words[0] for words in VERBS])
def test_every_verb_warns_of_upward_gravity(words: tuple[str, ...], run: Run, prism: Path) -> None:
    prism.write_text(prism.read_text(encoding="utf-8").replace("0, 0, -9.81", "0, 0, 9.81"), encoding="utf-8")
    ended = run(words[0], prism, *words[1:], "--json")
    assert "warning: gravity points upward, 9.81 m/s2 along +z" in ended.err
    assert any("gravity points upward" in text for text in ended.data["warnings"])


def test_a_good_scene_gives_no_warning(run: Run, prism: Path) -> None:
    ended = run("simulate", prism, "--t-end", "0.01", "--samples", "2", "--json")
    assert "warning" not in ended.err
    assert "warnings" not in ended.data


@pytest.mark.thorough
def test_who_settles_is_not_told_to_settle(run: Run, folder: Path) -> None:
    bar = 'bar = { kind = "bar", nodes = ["b", "c"], spring_constant = 1e4, mass = 0.1 }\n'
    text = GOOD.replace("[members]\n", "c = { position = [0, 0, -2], anchored = true }\n\n[members]\n" + bar)
    path = write(folder / "small.toml", text)
    assert "settle first" in run("check", path).err
    assert "settle first" not in run("equilibrium", path).err
    simulated = ("simulate", path, "--t-end", 0.01, "--samples", 2)
    assert "settle first" in run(*simulated).err
    assert "settle first" not in run(*simulated, "--settle").err


def test_an_import_that_lies_on_its_side_says_so(run: Run, folder: Path) -> None:
    text = (
        "nodes: {a: [0, 0, 0], b: [1, 0, 0], c: [0, 0, 1], d: [0.3, 1, 0.3]}\n"
        "pair_groups: {rod: [[a, d]], string: [[b, d]], rod x: [[b, c]]}\n"
    )
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    ended = run.good("import", "a.yaml", "-o", "a.toml", "--gravity", "0,0,-9.81", "--json")
    assert any("y is up" in note and "--gravity 0,-9.81,0" in note for note in ended.data["notes"])
    ended = run("import", "a.yaml", "-o", "a.toml", "--gravity", "0,-9.81,0", "--overwrite", "--json")
    assert not any("y is up" in note for note in ended.data["notes"])
