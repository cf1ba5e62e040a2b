"""The verb `sensitivity`: lists, file, inputs, loads, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import load_scene
from tests.cli.conftest import Run
from tests.cli.scenes import HANGING, write

INPUT = '\n[[inputs]]\nname = "winch"\nkind = "rest_length"\nmembers = ["s1"]\n'


def test_a_weight_hangs_as_much_lower_as_its_cable_is_longer(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("sensitivity", path, "--node", "b", "--member", "s1", "--json").data
    assert data["status"] == "ok"
    assert data["nodes"]["b"]["z"]["s1"] == pytest.approx(-1.0)
    assert data["nodes"]["b"]["x"] == {}
    assert abs(data["members"]["s1"].get("s1", 0.0)) < 1e-9
    assert data["columns"]["s1"]["node"] == "b"
    assert data["columns"]["s1"]["motion"] == pytest.approx([0, 0, -1])
    assert data["gauge"] == data["slack"] == []


def test_inputs_are_columns_and_values(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING + INPUT)
    words = ("sensitivity", path, "--by", "winch", "--input", "winch=0.1", "--load", "b=0,0,-5")
    data = run(*words, "--out", "s.npz", "--json").data
    assert list(data["columns"]) == ["winch"]
    assert data["largest_force"] == pytest.approx(9.81 + 5)
    with np.load("s.npz", allow_pickle=False) as file:
        assert file["column_name"].tolist() == ["winch"]
        np.testing.assert_allclose(file["node"][:, :, 0], [[0, 0, 0], [0, 0, -1]], atol=1e-12)
        assert file["coordinate"].shape == (3, 1)
        assert file["tension"].shape == (1, 1)
        assert file["gauge_motion"].shape == (3, 0)


def test_text_names_the_gauge_and_what_is_slack(run: Run, prism: Path) -> None:
    text = run("sensitivity", prism).out
    assert "free to slide along x, slide along y, turn about z" in text
    assert "vertical3" in text
    ranked = run("sensitivity", prism, "--node", "t1", "--most", "2").out
    (table,) = [part for part in ranked.split("t1 along ") if part.startswith("z")]
    assert sum(line.split()[-1][0] in "+-" for line in table.splitlines() if len(line.split()) == 2) == 2


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--node", "c"], "unknown node"),
        (["--member", "c"], "unknown member"),
        (["--by", "c"], "--by: unknown member or input"),
        (["--by", "s1", "--by", "s1"], "given twice"),
        (["--input", "u=1"], "no inputs"),
        (["--load", "c=1,0,0"], "unknown node"),
        (["--out", "s.csv"], "s.csv"),
        (["--most", "0"], "most"),
    ],
)
def test_bad_input_is_named(run: Run, folder: Path, words: list[str], problem: str) -> None:
    path = write(folder / "small.toml", HANGING)
    ended = run.refused("sensitivity", path, *words)
    assert problem in ended.err
    assert sorted(item.name for item in folder.iterdir()) == ["small.toml"]


def test_a_mechanism_ends_with_code_three_and_its_nodes(run: Run, folder: Path) -> None:
    slack = HANGING.replace("gravity = [0, 0, -9.81]", "").replace("rest_length = 0.9", "rest_length = 1.1")
    ended = run("sensitivity", write(folder / "small.toml", slack), "--json")
    assert ended.code == 3
    assert ended.data["error"] == "SingularStiffnessError"
    assert list(ended.data["evidence"]["motion"]) == ["b"]


# A plate on six springs, as a Stewart platform.
PLATE = """
name = "plate"
[bodies.plate]
kind = "rigid"
mass = 1.0
inertia = [0.01, 0.01, 0.02]
centre = [0, 0, 0.3]
points = { a = [0.1, 0, 0], b = [-0.05, 0.09, 0], c = [-0.05, -0.09, 0] }
[nodes]
p = { position = [0.15, 0.26, 0], anchored = true }
q = { position = [-0.3, 0, 0], anchored = true }
r = { position = [0.15, -0.26, 0], anchored = true }
[classes.spring]
kind = "bar"
spring_constant = 1000.0
[members]
ap = { class = "spring", nodes = ["plate.a", "p"] }
ar = { class = "spring", nodes = ["plate.a", "r"] }
bp = { class = "spring", nodes = ["plate.b", "p"] }
bq = { class = "spring", nodes = ["plate.b", "q"] }
cq = { class = "spring", nodes = ["plate.c", "q"] }
cr = { class = "spring", nodes = ["plate.c", "r"] }
"""


def test_rest_lengths_within_bodies_are_no_columns(run: Run, folder: Path) -> None:
    path = write(folder / "plate.toml", PLATE)
    ended, data = run.good("sensitivity", path), run("sensitivity", path, "--node", "plate_a", "--json").data
    assert "corner" not in ended.out
    assert "edge" not in ended.out
    assert set(data["columns"]) == {"ap", "ar", "bp", "bq", "cq", "cr"}
    # The six lengths alone tell where the plate is.
    structure = load_scene(path)[0]
    ends = structure.node_position[structure.connectivity[:6]]
    unit = (ends[:, 0] - ends[:, 1]) / np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)[:, None]
    rows = np.hstack([unit, np.cross(ends[:, 0] - [0, 0, 0.3], unit)])
    motion = np.linalg.solve(rows, np.eye(6)[0])
    expected = motion[:3] + np.cross(motion[3:], [0.1, 0, 0])
    found = [data["nodes"]["plate_a"][axis].get("ap", 0.0) for axis in "xyz"]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    loose = PLATE.replace('cr = { class = "spring", nodes = ["plate.c", "r"] }\n', "")
    refused = run("sensitivity", write(folder / "loose.toml", loose))
    assert refused.code == 3
    assert "plate_" in refused.err
    assert "corner" not in refused.err
