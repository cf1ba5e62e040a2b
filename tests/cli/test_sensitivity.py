"""The verb `sensitivity`: lists, file, inputs, loads, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

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
