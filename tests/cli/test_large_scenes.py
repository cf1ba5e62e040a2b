"""Scenes too large for straight-line code, through the verbs, without a word about emitters."""

from pathlib import Path

import pytest

from tests.cases import thorough
from tests.cli.conftest import Run

# 18 k - 6 members in k stages.
TALL = """
name = "tall"
gravity = [0, 0, -0.1]
[classes.strut]
kind = "bar"
axial_stiffness = 5e5
[classes.string]
kind = "cable"
axial_stiffness = 500
damping = 0.5
prestress = 10
[shape]
kind = "tower"
stages = STAGES
bars = 3
radius = 0.2
height = 0.5
overlap = 0.2
node_mass = 0.02
anchor_bottom = true
bar_class = "strut"
bottom_class = "string"
top_class = "string"
vertical_class = "string"
saddle_class = "string"
diagonal_class = "string"
"""


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        (50, ("build",)),
        *thorough((50, ("simulate", "--t-end", 1e-3)), (50, ("linearize",)), (7, ("equilibrium",))),
    ],
)
def test_a_large_scene_needs_no_name_of_an_emitter(
    stages: int, words: tuple[object, ...], run: Run, folder: Path
) -> None:
    (folder / "tall.toml").write_text(TALL.replace("STAGES", str(stages)), encoding="utf-8")
    verb, *options = words
    ended = run.good(verb, "tall.toml", *options, "--json")
    if verb == "build":
        assert ended.data["emitter"] == "table"
        assert f"{18 * stages - 6} members" in ended.data["why_emitter"]


@pytest.mark.thorough
@pytest.mark.parametrize("verb", ["equilibrium", "analyse", "sensitivity", "linearize"])
def test_the_text_of_a_large_scene_is_short(verb: str, run: Run, folder: Path) -> None:
    (folder / "tall.toml").write_text(TALL.replace("STAGES", "12"), encoding="utf-8")
    ended = run(verb, "tall.toml")
    assert (ended.out + ended.err).count("\n") < 60
    assert "with --all, and in --json" in ended.out
    assert run(verb, "tall.toml", "--all").out.count("\n") > 100
