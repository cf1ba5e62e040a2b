"""Verbs with cables that slip through rings with friction."""

from pathlib import Path

import pytest

from tensegrity_codegen.scene.write import write_scene
from tests.cli.conftest import Run
from tests.runtime.statics.test_ring_slip import ring_scene


def test_the_verb_writes_the_scene_as_it_slipped(run: Run, folder: Path) -> None:
    write_scene(ring_scene(0.05), folder / "tilted.toml")
    found = run.good("equilibrium", "tilted.toml", "-o", "settled.toml", "--json").data
    assert found["slid"]["c_1"] == pytest.approx(-0.548842740, abs=1e-8)
    text = run.good("equilibrium", "tilted.toml").out
    assert "slipped through rings: behind c_1 -0.548843 m" in text
    again = run.good("equilibrium", "settled.toml", "--json").data
    assert again["slid"]["c_1"] == 0.0
    assert again["displacement"] < 1e-9
