"""The verb reconfigure (SCS 5, 6)."""

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run

WAY = ["--from", "55,40,1.11066", "--to", "65,35", "--tau", "5"]
FREE = ["--from", "70,30,1.60504", "--to", "65", "--tau", "5", "--force", "50", "--zero-torque"]


@pytest.fixture
def tower(run: Run) -> str:
    run.good("examples", "svd_tower", "--out", "tower.toml")
    return "tower.toml"


def test_the_papers_motion_with_torque(run: Run, tower: str) -> None:
    # SCS (44), (45)
    data = run("reconfigure", tower, *WAY, "--json").data
    assert data["status"] == "ok"
    assert list(data["tension_start"].values()) == pytest.approx([26.11, 1.85, 18.38], abs=0.006)
    assert data["force"] == -50.0
    assert data["largest_residual"] < 1e-11


def test_the_papers_motion_without_torque(run: Run, tower: str) -> None:
    data = run("reconfigure", tower, *FREE, "--json").data
    assert data["end_deg"][1] == pytest.approx(22.036, abs=5e-4)
    assert data["largest_torque"] < 1e-12


def test_the_result_file_holds_what_the_motors_need(run: Run, tower: str, folder: Path) -> None:
    run.good("reconfigure", tower, *WAY, "--samples", "21", "--out", "way.npz")
    with np.load(folder / "way.npz") as data:
        assert data["tendon_class"].tolist() == ["saddle", "vertical", "diagonal"]
        assert data["time"][[0, -1]] == pytest.approx([0.0, 5.0])
        expected = 1000.0 * data["length"] / (1000.0 + data["tension"])
        assert data["rest_length"] == pytest.approx(expected, rel=1e-13)
        assert data["torque"].shape == (21,)


@pytest.mark.thorough
def test_track_drives_the_full_model(run: Run, tower: str) -> None:
    ended = run.good("reconfigure", tower, *WAY, "--track")
    assert "the full model follows within" in ended.out


def test_a_motion_that_is_too_fast_ends_with_code_3(run: Run, tower: str) -> None:
    ended = run("reconfigure", tower, *WAY[:-1], "0.3", "--json")
    assert ended.code == 3
    assert ended.data["error"] == "InfeasibleError"
    assert "vertical" in ended.data["problem"]
    assert ended.data["evidence"]["time"].startswith("0.16")


@pytest.mark.parametrize(
    ("words", "where"),
    [
        (["--from", "55,40", "--to", "65,35", "--tau", "5"], "--from"),
        (["--from", "55,40,x", "--to", "65,35", "--tau", "5"], "--from"),
        (["--from", "55,40,nan", "--to", "65,35", "--tau", "5"], "--from"),
        (["--from", "30,40,1.2", "--to", "65,35", "--tau", "5"], "--from"),
        (["--from", "55,40,1.11066", "--to", "65", "--tau", "5"], "--to"),
        (["--from", "55,40,1.11066", "--to", "65,90", "--tau", "5"], "--to"),
        (["--from", "55,40,1.11066", "--to", "65,35", "--tau", "0"], "duration"),
        ([*FREE[:3], "65,20", *FREE[4:]], "--to"),
        ([*WAY, "--samples", "1"], "--samples"),
    ],
)
def test_wrong_words_are_named(run: Run, tower: str, words: list[str], where: str) -> None:
    ended = run.refused("reconfigure", tower, *words, "--json")
    assert ended.data["where"] == where


@pytest.mark.parametrize("example", ["prism", "lin_prism"])
def test_other_scenes_are_refused(run: Run, example: str) -> None:
    run("examples", example, "--out", "other.toml")
    ended = run.refused("reconfigure", "other.toml", *WAY, "--json")
    assert ended.data["error"] == "StructureError"
