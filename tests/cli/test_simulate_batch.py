"""simulate --batch: many starts from a file, a status for each, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tests.cli.conftest import Run


def write_starts(path: Path, scene: Path, count: int = 3) -> np.ndarray:
    structure = load_nodes(scene)
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    noise = 1e-3 * np.random.default_rng(0).normal(size=(count, *free.shape))
    place = structure.node_position + np.where(free, noise, 0.0)
    np.savez(path, node_position=place)
    return place


def test_every_row_is_a_motion_of_its_own(run: Run, folder: Path, two_nodes: Path) -> None:
    place = write_starts(folder / "starts.npz", two_nodes, 10)
    words = ["--t-end", 0.2, "--samples", 5, "--method", "rk853", "--threads", 2, "--out", "all.npz"]
    ended = run.good("simulate", two_nodes, "--batch", "starts.npz", *words, "--json")
    assert ended.data["statuses"] == {"ok": 10}
    assert ended.data["n_motions"] == ended.data["n_ok"] == 10
    with np.load("all.npz", allow_pickle=False) as file:
        data = {name: file[name] for name in file.files}
    assert data["node_position"].shape == (10, 5, *place.shape[1:])
    np.testing.assert_array_equal(data["node_position"][:, 0], place)
    assert data["status"].tolist() == ["ok"] * 10
    assert 0.0 < ended.data["largest_error_estimate"] <= 1.0
    assert all("estimated error" in message for message in data["message"])
    once = run.good(
        "simulate",
        two_nodes,
        "--batch",
        "starts.npz",
        "--t-end",
        0.2,
        "--method",
        "rk853",
        "--control",
        "steps",
    )
    assert "10 of 10 motions ok; the error of 10 is not estimated" in once.out
    assert run("simulate", two_nodes, "--batch", "starts.npz", "--t-end", 0.2).code == 0  # auto, in words


@pytest.mark.thorough
def test_a_bad_start_is_told_and_ends_with_3(run: Run, folder: Path, two_nodes: Path) -> None:
    place = write_starts(folder / "starts.npz", two_nodes)
    n = int((place[0] != place[1]).sum())
    coordinate = np.ones((3, n))
    coordinate[1, 0] = np.nan
    np.savez(folder / "starts.npz", velocity=coordinate)
    words = ["--batch", "starts.npz", "--t-end", 0.1, "--method", "rk54", "--json"]
    ended = run("simulate", two_nodes, *words)
    assert ended.code == 3
    assert ended.data["statuses"] == {"ok": 2, "non_finite_input": 1}
    assert ended.data["control"] == "samples"
    assert "number 1" in ended.err


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"node_positoin": np.zeros((2, 2, 3))}, "node_position"),
        ({"node_position": np.zeros((2, 3))}, "wrong shape"),
        ({"node_position": np.full((2, 2, 3), 7.0)}, "anchored"),
        ({"coordinate": np.zeros((2, 99))}, "wrong shape"),
        ({}, "batch axis"),
    ],
    ids=["name", "shape", "held", "coordinates", "nothing"],
)
def test_files_that_do_not_fit_are_refused(
    run: Run, folder: Path, two_nodes: Path, arrays: dict[str, np.ndarray], message: str
) -> None:
    np.savez(folder / "starts.npz", **arrays)
    ended = run.refused("simulate", two_nodes, "--batch", "starts.npz", "--t-end", 0.1)
    assert message in ended.err


def test_what_is_no_archive_or_does_not_go_together_is_refused(
    run: Run, folder: Path, two_nodes: Path
) -> None:
    (folder / "starts.npz").write_text("no archive", encoding="utf-8")
    ended = run.refused("simulate", two_nodes, "--batch", "starts.npz", "--t-end", 0.1)
    assert "not a file of initial states" in ended.err
    write_starts(folder / "starts.npz", two_nodes)
    for more in (["--settle"], ["--until", "contact"]):
        ended = run.refused("simulate", two_nodes, "--batch", "starts.npz", "--t-end", 0.1, *more)
        assert str(more[0]) in ended.err
    assert "--batch" in ended.err


def test_a_state_that_two_arrays_give_is_refused_with_both_names(
    run: Run, folder: Path, two_nodes: Path
) -> None:
    place = write_starts(folder / "starts.npz", two_nodes)
    np.savez(folder / "starts.npz", node_position=place, coordinate=np.zeros((3, 3)))
    ended = run.refused("simulate", two_nodes, "--batch", "starts.npz", "--t-end", 0.1, "--json")
    assert ended.data["problem"] == "two arrays give the same state"
    assert "one of" in ended.data["allowed"]
    assert {"node_position", "coordinate"} <= set(ended.data["given"].strip("'").split(" and "))
