"""Analysis `reactions`: supports balance weights and loads; two cables at 45 degrees carry a weight."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.reactions import FindReactions
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.system.errors import UnknownNameError
from tests.analyses.cases.compiling import compile_for
from tests.cli.conftest import Run

WEIGHT = 2.0 * 9.81  # [N]
# Two stiff cables from supports 2 m apart to a mass 1 m below: 45 degrees to each side.
HANGER: dict[str, Any] = {
    "name": "hanger",
    "axes": "xz",
    "gravity": [0.0, -9.81],
    "nodes": {
        "left": {"position": [-1.0, 0.0], "anchored": True},
        "right": {"position": [1.0, 0.0], "anchored": True},
        "mass": {"position": [0.0, -1.0], "mass": 2.0},
    },
    "members": {
        "a": {"kind": "cable", "nodes": ["left", "mass"], "axial_stiffness": 1e9},
        "b": {"kind": "cable", "nodes": ["right", "mass"], "axial_stiffness": 1e9},
    },
    "inputs": [{"name": "push", "kind": "force", "nodes": ["mass"], "direction": [0.0, -1.0]}],
}


@pytest.fixture
def hanger(tmp_path: Path) -> Path:
    path = tmp_path / "hanger.toml"
    write_scene(HANGER, path)
    return path


def test_two_cables_share_weight_load_and_push(run: Run, hanger: Path) -> None:
    """Each support carries half of all, and pulls outwards with as much."""
    ended = run("reactions", hanger, "--load", "mass=0,-10", "--input", "push=4", "--json")
    half = (WEIGHT + 14.0) / 2
    assert ended.code == 0
    assert ended.data["reaction"]["left"] == pytest.approx([-half, 0.0, half], rel=1e-6)
    assert ended.data["reaction"]["right"] == pytest.approx([half, 0.0, half], rel=1e-6)
    assert ended.data["total"] == pytest.approx([0.0, 0.0, 2 * half], rel=1e-7, abs=1e-6)
    assert set(ended.data["reaction"]) == {"left", "right"}


def test_the_table_has_a_row_for_each_support(run: Run, hanger: Path) -> None:
    run.good("reactions", hanger, "--out", "table.csv")
    rows = Path("table.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "node,x,y,z"
    assert [row.split(",")[0] for row in rows[1:]] == ["left", "right"]


def test_every_case_has_its_own_reactions() -> None:
    """Pushes of 0, 5 and 10 N; the rows are those of the formula."""
    analysis = FindReactions()
    model = compile_for(HANGER, analysis)
    push = np.array([0.0, 5.0, 10.0])
    result = analysis.run(model, {"push": push}, 3)
    assert result.is_good.all()
    np.testing.assert_allclose(result.arrays["reaction"][:, 0, 2], (WEIGHT + push) / 2, rtol=1e-6)
    np.testing.assert_allclose(result.arrays["total"][:, 2], WEIGHT + push, rtol=1e-7)
    assert (result.arrays["reaction"][:, 2] == 0.0).all()


def test_a_structure_without_supports_is_refused(run: Run, tmp_path: Path) -> None:
    free = {name: {"position": node["position"], "mass": 1.0} for name, node in HANGER["nodes"].items()}
    path = tmp_path / "free.toml"
    write_scene(HANGER | {"nodes": free}, path)
    ended = run("reactions", path, "--json")
    assert ended.code == 2
    assert "no node is anchored" in json.loads(ended.out)["problem"]


def test_an_unknown_result_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="result of reactions"):
        compile_for(HANGER, FindReactions(keep=("force",)))
