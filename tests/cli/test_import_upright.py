"""Files in which y is up, imported upright."""

from pathlib import Path

import numpy as np
import yaml

from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tests.cli.conftest import Run
from tests.scene.formats.test_format import STICKS


def test_a_file_of_the_toolkit_stands_upright(run: Run, folder: Path) -> None:
    Path("sticks.yaml").write_text(yaml.safe_dump(STICKS, sort_keys=False), encoding="utf-8")
    lying = run("import", "sticks.yaml", "-o", "lying.toml", "--gravity", "0,0,-9.81")
    assert "or --up y to turn it upright" in lying.err
    ended = run.good(
        "import",
        "sticks.yaml",
        "-o",
        "up.toml",
        "--up",
        "y",
        "--scale",
        "0.1",
        "--gravity",
        "0,0,-9.81",
        "--json",
    )
    assert not any("on its side" in note for note in ended.data["notes"])
    assert any("became (x, -z, y)" in note for note in ended.data["notes"])
    structure = load_nodes("up.toml")
    assert structure.gravity.tolist() == [0, 0, -9.81]
    np.testing.assert_allclose(structure.node_position[1], [0, 0, 2.0])
    assert run("import", "sticks.yaml", "-o", "x.toml", "--up", "w", "--json").data["where"] == "--up"
    assert run("import", "sticks.yaml", "-o", "x.toml", "--scale", "0", "--json").data["where"] == "--scale"
