"""Verbs that do not know rigid bodies name them."""

from pathlib import Path

import pytest

from tensegrity_codegen.scene.write import write_scene
from tests.cli.conftest import Run
from tests.hung_disk import SCENE


@pytest.mark.parametrize(
    ("verb", "what"), [("form", "form finding"), ("size", "least mass"), ("stability", "cases of stability")]
)
def test_rigid_bodies_are_refused_by_name(run: Run, folder: Path, verb: str, what: str) -> None:
    write_scene(SCENE, folder / "hung.toml")
    ended = run.refused(verb, folder / "hung.toml")
    assert f"rigid bodies are not supported here: {what}" in ended.err
    assert "hung: bodies.disk" in ended.err
