"""The verb `sweep`: grids, samples and tables, plan, going on, exit codes, bad input."""

import csv
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Run

zarr = pytest.importorskip("zarr")
pytest.importorskip("SALib")

MASS, RATE = 0.5, 80.0
EVALUATE = ("--do", "evaluate", "--keep", "member_tension[0]", "--workers", "1")
SETTLE = ("--do", "equilibrium", "--keep", "length = member_length[0]", "--workers", "1")
GRID = ("--over", "gravity[2]=-20:-1:5", "--over", "classes.cord.spring_constant=40,80")


def read(path: str) -> dict[str, np.ndarray]:
    group = zarr.open_group(path, mode="r", zarr_format=3)
    return {name: array[...] for name, array in group.arrays()}


def test_a_grid_of_equilibria_is_stored_and_goes_on(run: Run, two_nodes: Path, folder: Path) -> None:
    """The cord of a hanging mass has the length 1 + m g / k."""
    words = ("sweep", two_nodes, *SETTLE, *GRID, "--out", "a.zarr", "--json")
    ended = run.good(*words)
    assert (ended.data["status"], ended.data["n_cases"], ended.data["n_good"]) == ("ok", 10, 10)
    assert ended.data["counts"] == {"converged": 10} or set(ended.data["counts"]) <= {
        *("converged", "rounding_limited")
    }
    found = read("a.zarr")
    expected = 1.0 + MASS * np.linspace(20, 1, 5)[:, None] / np.array([40.0, 80.0])
    np.testing.assert_allclose(found["length"], expected, rtol=1e-7)
    again = run(*words)
    assert (again.code, again.data["n_computed"], again.data["n_good"]) == (0, 0, 10)
    text = run(*words[:-1])
    assert "10 of 10 cases" in text.out
    assert "keep snapped" in again.data["not_checked"]
    assert "whether cases snapped is not checked" in text.err
    other = run("sweep", two_nodes, *SETTLE, *GRID[:2], "--out", "a.zarr")
    assert other.code == 2
    assert "another sweep" in other.err
    assert "classes.cord.spring_constant" in other.err
    shown = run("sweep", "summary", "a.zarr", "--json")
    assert shown.data["headline"] == "10 of 10 cases converged"
    assert shown.data["results"][0]["name"] == "length"
    for command in shown.data["worst"][0]["commands"]:
        run.good(*shlex.split(command)[1:])
    asked = run.good("sweep", two_nodes, *SETTLE, *GRID, "--keep", "snapped", "--out", "b.zarr", "--json")
    assert asked.data["not_checked"] == ""
    np.testing.assert_array_equal(read("b.zarr")["snapped"], np.zeros((5, 2)))


@pytest.mark.parametrize(
    "text", ["case,status,mine\n0,ok,1\n", "matrix,row,column,value\n", "scene,t_end,mine\n", ""]
)
def test_a_table_that_exists_is_kept(text: str, run: Run, two_nodes: Path, folder: Path) -> None:
    (folder / "t.csv").write_text(text, encoding="utf-8")
    words = (
        "sweep",
        two_nodes,
        *EVALUATE,
        "--over",
        "gravity[2]=-2,-1",
        "--out",
        "t.zarr",
        "--format",
        "csv",
    )
    ended = run(*words, "--json")
    assert (ended.code, ended.data["where"]) == (2, "t.csv")
    assert "--overwrite" in ended.data["hint"]
    assert (folder / "t.csv").read_text(encoding="utf-8") == text
    assert not (folder / "t.zarr").exists()


def test_the_plan_is_shown_and_nothing_done(run: Run, two_nodes: Path, folder: Path) -> None:
    before = sorted(folder.iterdir())
    text = run("sweep", two_nodes, *SETTLE, *GRID, "--dry-run")
    assert text.code == 0, text.err
    assert "10 cases (5 x 2), grid" in text.out
    assert "1 library" in text.out
    data = run("sweep", two_nodes, *SETTLE, *GRID, "--dry-run", "--json").data
    assert data["status"] == "ok"
    assert (data["cases"], len(data["libraries"])) == (10, 1)
    assert sorted(folder.iterdir()) == before


@pytest.mark.thorough
def test_sobol_indices_of_a_linear_function(run: Run, two_nodes: Path) -> None:
    """Tension k (l - l0): its indices are the squared widths of the ranges over their sum; 0 for gravity."""
    samples = ("shape.length=uniform(1.0,1.2)", "classes.cord.rest_length=uniform(0.8,0.9)")
    words = [word for text in (*samples, "gravity[2]=uniform(-20,-10)") for word in ("--sample", text)]
    ended = run.good(
        "sweep",
        two_nodes,
        *EVALUATE,
        *words,
        "--n",
        1024,
        "--sampling",
        "saltelli",
        "--out",
        "s.zarr",
        "--json",
    )
    assert ended.data["n_good"] == 1024 * 5
    (result,) = run("sweep", "summary", "s.zarr", "--json").data["results"]
    indices = result["indices"]
    np.testing.assert_allclose(indices["total"], [0.8, 0.2, 0.0], atol=0.01)
    np.testing.assert_allclose(indices["first"], [0.8, 0.2, 0.0], atol=0.03)
    assert indices["total"][2] == 0.0


@pytest.mark.thorough
def test_a_latin_hypercube_is_stratified_in_every_dimension(run: Run, two_nodes: Path) -> None:
    words = ("--sample", "shape.length=uniform(1,3)", "--sample", "classes.cord.rest_length=uniform(0.2,0.7)")
    words = (*words, "--n", "64", "--sampling", "latin_hypercube", "--seed", "5")
    for workers, name in (("1", "one.zarr"), ("2", "two.zarr")):
        run.good(
            "sweep", two_nodes, *EVALUATE[:4], "--workers", workers, *words, "--task-size", 8, "--out", name
        )
    one, two = read("one.zarr"), read("two.zarr")
    part = (one["shape.length"] - 1) / 2, (one["classes.cord.rest_length"] - 0.2) / 0.5
    for values in part:
        assert sorted(np.floor(64 * values).astype(int)) == list(range(64))
    for name, values in one.items():
        if name != "task_record":
            np.testing.assert_array_equal(values, two[name])


def test_cases_of_a_table_and_a_table_of_results(run: Run, two_nodes: Path, folder: Path) -> None:
    (folder / "cases.csv").write_text(
        "classes.cord.rest_length,shape.length\n0.9,1.0\n-1,1.0\n0.8,1.1\n", encoding="utf-8"
    )
    words = ("--table", "cases.csv", "--keep", "member_tension[0]", "--format", "csv", "--out", "t.zarr")
    ended = run.good("sweep", two_nodes, "--do", "evaluate", "--workers", "1", *words, "--json")
    assert ended.data["counts"] == {"bad_input": 1, "ok": 2}
    assert "rest_length" in ended.data["first_messages"]["bad_input"]
    file = folder / "t.csv"
    assert ended.data["table"] == "t.csv"
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["ok", "bad_input", "ok"]
    tension = next(name for name in rows[0] if name.startswith("member_tension"))
    assert [float(rows[k][tension]) for k in (0, 2)] == pytest.approx([RATE * 0.1, RATE * 0.3])


def test_without_a_good_case_the_exit_code_is_3(run: Run, two_nodes: Path) -> None:
    """A mass that nothing holds: without a force of the cord there is no equilibrium."""
    words = ("--over", "node_load.n2[2]=-1,-2", "--max-iterations", "1", "--tolerance", "1e-15")
    ended = run("sweep", two_nodes, *SETTLE, *words, "--out", "n.zarr", "--json")
    assert ended.code == 3, ended.out
    assert ended.data["status"] == "failed"
    assert ended.data["n_good"] == 0
    assert sum(ended.data["counts"].values()) == 2
    run.good("sweep", "summary", "n.zarr")


def test_after_ctrl_c_what_is_finished_is_kept(
    run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tensegrity_codegen.sweeps.store.store import SweepStore

    write = SweepStore.write
    done: list[int] = []

    def write_two(store: SweepStore, task: int, *rest: Any) -> None:
        write(store, task, *rest)
        done.append(task)
        if len(done) == 2:
            raise KeyboardInterrupt

    words = ("sweep", two_nodes, *EVALUATE, "--over", "gravity[2]=-20:-1:16", "--task-size", "4")
    words = (*words, "--out", "c.zarr", "--json")
    with monkeypatch.context() as patch:
        patch.setattr(SweepStore, "write", write_two)
        ended = run(*words)
    assert ended.code == 130
    assert ended.out == ""
    assert "c.zarr keeps what is finished" in ended.err
    left = run("sweep", "summary", "c.zarr", "--json").data
    assert (left["n_good"], left["n_not_computed"], left["n_not_run"]) == (8, 8, 8)
    again = run(*words).data
    assert (again["n_computed"], again["n_good"]) == (8, 16)


def test_a_sweep_stops_after_so_many_failures(run: Run, two_nodes: Path) -> None:
    words = ("--over", "classes.cord.rest_length=-3:-1:8", "--over", "gravity[2]=-9,-1", "--task-size", "4")
    good = ("--over", "classes.cord.rest_length=-3,-2,-1,0.5,0.9", "--over", "gravity[2]=-9,-1")
    refused = run("sweep", two_nodes, *EVALUATE, *words, "--out", "r.zarr")
    assert refused.code == 2  # no case is a scene
    words = (*good, "--task-size", "2", "--stop-after", "3", "--out", "f.zarr", "--json")
    ended = run("sweep", two_nodes, *EVALUATE, *words)
    assert ended.data["stopped"]
    assert ended.data["counts"]["bad_input"] >= 3
    assert ended.data["n_finished"] < 10
    assert ended.code == (0 if ended.data["n_good"] else 3)


def test_keys_that_need_too_many_libraries_are_named_with_the_option(run: Run, prism: Path) -> None:
    """The masses of the prism's bars follow from their lengths, which are constants of the code."""
    words = ("--do", "evaluate", "--over", "shape.height=0.25:0.35:1001", "--out", "l.zarr", "--json")
    ended = run.refused("sweep", prism, *words)
    assert "shape.height" in ended.data["problem"]
    assert "--yes" in ended.data["allowed"]
    assert not Path("l.zarr").exists()


BAD = {
    "unknown key": (("--over", "classes.cord.spring_constnt=1,2"), "spring_constant"),
    "unknown section": (("--over", "clases.cord.spring_constant=1,2"), "classes"),
    "not a number": (("--over", "classes.cord.kind=1,2"), "kind"),
    "no key": (("--over", "1:2:3"), "KEY="),
    "empty range": (("--over", "gravity[2]=1:1:5"), "empty"),
    "no values": (("--over", "gravity[2]=1:2:0"), "whole number"),
    "log of a negative bound": (("--over", "gravity[2]=-1:2:5:log"), "positive"),
    "NaN": (("--over", "gravity[2]=nan,1"), "finite"),
    "twice": (("--over", "gravity[2]=1,2", "--over", "gravity[2]=3,4"), "twice"),
    "nothing varies": ((), "nothing varies"),
    "n is 0": (("--sample", "gravity[2]=normal(0,1)", "--n", "0"), "--n"),
    "no n": (("--sample", "gravity[2]=normal(0,1)"), "--n"),
    "unknown distribution": (("--sample", "gravity[2]=gamma(0,1)", "--n", "2"), "normal"),
    "unknown sampling": (
        ("--sample", "gravity[2]=normal(0,1)", "--n", "2", "--sampling", "halton"), "latin_hypercube",
    ),
    "too many cases": (("--over", "gravity[2]=1:2:1000", "--over", "shape.length=1:2:1000"), "--yes"),
    "no table": (("--table", "none.csv"), "none.csv"),
    "unknown quantity": (("--over", "gravity[2]=1,2", "--keep", "member_tensoin"), "member_tension"),
    "option of another operation": (("--over", "gravity[2]=1,2", "--t-end", "1"), "--t-end"),
    "no workers": (("--over", "gravity[2]=1,2", "--workers", "0"), "--workers"),
    "no such format": (("--over", "gravity[2]=1,2", "--format", "xls"), "parquet"),
    "nothing to replace": (("--over", "gravity[2]=1,2", "--overwrite"), "--format"),
    "task size": (("--over", "gravity[2]=1,2", "--task-size", "0"), "--task-size"),
    "stop after": (("--over", "gravity[2]=1,2", "--stop-after", "0"), "--stop-after"),
    "sampling of no sample": (("--over", "gravity[2]=1,2", "--sampling", "sobol"), "--sampling"),
    "seed of no sample": (("--over", "gravity[2]=1,2", "--seed", "-1"), "--seed"),
    "malformed key": (("--over", "gravity[-1]=0:1:3"), "--over"),
    "malformed key of a sample": (("--sample", "gravity[-1]=normal(0,1)", "--n", "2"), "--sample"),
    "wait": (("--over", "gravity[2]=1,2", "--wait", "-3"), "--wait"),
    "wait for nobody": (("--over", "gravity[2]=1,2", "--wait", "3"), "--scheduler"),
    "empty scheduler": (("--over", "gravity[2]=1,2", "--scheduler", ""), "--scheduler"),
    "name of an axis": (("--over", "gravity[2]=1,2", "--keep", "member = max(member_tension)"), "--keep"),
    "empty name": (("--over", "gravity[2]=1,2", "--out", "", "--format", "csv"), "--out"),
    "workers and scheduler": (
        ("--over", "gravity[2]=1,2", "--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "--scheduler",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named_and_nothing_is_written(
    name: str, run: Run, two_nodes: Path, folder: Path
) -> None:
    words, said = BAD[name]
    before = sorted(folder.iterdir())
    out = () if "--out" in words else ("--out", "b.zarr")
    ended = run.refused("sweep", two_nodes, "--do", "evaluate", *words, *out, "--json")
    assert said in str(ended.data)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--do", "guess", "--out", "b.zarr"), "equilibrium"),
        (("--do", "evaluate", "--out", "b.csv"), ".zarr"),
        (("--do", "evaluate", "--out", "mine.zarr"), "not a sweep"),
        (("--do", "evaluate"), "--out"),
        (("--do", "simulate", "--out", "b.zarr", "--t-end", "-1"), "--t-end"),
        (("--do", "simulate", "--out", "b.zarr", "--method", "euler"), "--method"),
        (("--do", "equilibrium", "--out", "b.zarr", "--tolerance", "nan"), "--tolerance"),
    ],
)
def test_bad_options_are_named(
    words: tuple[str, ...], said: str, run: Run, two_nodes: Path, folder: Path
) -> None:
    (folder / "mine.zarr").mkdir()
    (folder / "mine.zarr" / "notes").write_text("mine", encoding="utf-8")
    ended = run.refused("sweep", two_nodes, *words, "--over", "gravity[2]=1,2", "--json")
    assert said in str(ended.data)
    assert sorted(path.name for path in folder.iterdir()) == ["mine.zarr", two_nodes.name]


def test_a_scheduler_that_is_not_there_is_named_after_the_wait(run: Run, two_nodes: Path) -> None:
    pytest.importorskip("distributed")
    words = ("--scheduler", "tcp://127.0.0.1:9", "--wait", "1", "--out", "b.zarr", "--json")
    ended = run.refused("sweep", two_nodes, "--do", "evaluate", "--over", "gravity[2]=1,2", *words)
    assert "dask scheduler" in ended.data["hint"]
    assert not Path("b.zarr").exists()


def test_a_gust_is_a_key(run: Run, two_nodes: Path) -> None:
    words = ("--do", "control", "--over", "gravity[2]=1,2", "--out", "g.zarr")
    ended = run("sweep", two_nodes, *words, "--gust", "weight=10")
    assert (ended.code, "gust.NODE[axis]" in ended.err) == (2, True)
