"""Endings of result files: each means what it says, any other is refused before the run."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from tensegrity_codegen.runtime.model.arrays import read_arrays
from tests.cli.conftest import Run, write_example

SIMULATE = ("--t-end", "0.05", "--samples", "6", "--json")


@pytest.fixture
def scene(folder: Path) -> Path:
    """A small scene with an input."""
    path = write_example(folder, "two_nodes")
    motor = '\n[[inputs]]\nkind = "rest_length"\nname = "winch"\nmembers = ["cord"]\n'
    path.write_text(path.read_text(encoding="utf-8") + motor, encoding="utf-8")
    return path


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


def test_motions_have_the_same_numbers_in_every_kind_of_file(run: Run, scene: Path) -> None:
    for kind in ("npz", "csv", "mat"):
        run.good("simulate", scene, *SIMULATE, "--out", f"run.{kind}")
        assert run("simulate", scene, *SIMULATE, "--out", f"run.{kind}").code == 2  # it exists
        run.good("simulate", scene, *SIMULATE, "--out", f"run.{kind}", "--overwrite")
    arrays = read_arrays(Path("run.npz"))
    table = read_csv(Path("run.csv"))
    nodes = [f"{node}.{axis} [m]" for node in ("n1", "n2") for axis in "xyz"]
    assert list(table)[:7] == ["time [s]", *nodes]
    assert list(table)[-4:] == [
        "member1.tension [N]",
        "kinetic_energy [J]",
        "total_energy [J]",
        "input.winch [m]",
    ]
    np.testing.assert_array_equal(np.array(table["n2.z [m]"], dtype=float), arrays["node_position"][:, 1, 2])
    np.testing.assert_array_equal(
        np.array(table["n2.vz [m/s]"], dtype=float), arrays["node_velocity"][:, 1, 2]
    )
    np.testing.assert_array_equal(
        np.array(table["member1.tension [N]"], dtype=float), arrays["member_tension"][:, 0]
    )
    mat = loadmat("run.mat")
    assert mat["__header__"].startswith(b"MATLAB 5.0 MAT-file")
    np.testing.assert_array_equal(mat["node_position"], arrays["node_position"])
    assert mat["time"].shape == (6, 1)
    assert [str(item[0]) for item in mat["node_name"].ravel()] == ["n1", "n2"]
    assert mat["status"].tolist() == ["ok"]


@pytest.mark.peers
def test_parquet_has_the_columns_of_the_table(run: Run, scene: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow, of the extra tables")
    for kind in ("parquet", "csv"):
        run.good("simulate", scene, *SIMULATE, "--out", f"run.{kind}")
    table, text = parquet.read_table("run.parquet"), read_csv(Path("run.csv"))
    assert table.column_names == list(text)
    for name in text:
        assert table[name].to_pylist() == [float(value) for value in text[name]]
    assert table.schema.metadata[b"status"] == b"ok"
    run.good("simulate", scene, *SIMULATE, "--out", "run.parquet", "--overwrite")


def test_a_batch_is_a_table_with_the_number_of_each_motion(run: Run, scene: Path) -> None:
    np.savez("starts.npz", coordinate=[[0.0, 0.0, -1.0], [0.0, 0.1, -1.1]])
    options = ("--batch", "starts.npz", "--method", "rk54", *SIMULATE)
    for kind in ("npz", "csv", "mat"):
        run.good("simulate", scene, *options, "--out", f"many.{kind}")
    arrays, table = read_arrays(Path("many.npz")), read_csv(Path("many.csv"))
    assert list(table)[:2] == ["motion", "time [s]"]
    assert table["motion"] == ["0"] * 6 + ["1"] * 6
    np.testing.assert_array_equal(
        np.array(table["n2.y [m]"], dtype=float), arrays["node_position"][:, :, 1, 1].ravel()
    )
    np.testing.assert_array_equal(loadmat("many.mat")["member_tension"], arrays["member_tension"])


def test_linear_models_have_the_same_numbers_in_every_kind_of_file(run: Run, scene: Path) -> None:
    for kind in ("npz", "csv", "mat"):
        run.good("linearize", scene, "--settle", "--json", "--out", f"model.{kind}")
    arrays, mat = read_arrays(Path("model.npz")), loadmat("model.mat")
    states = arrays["state_name"].tolist()
    matrix = np.zeros(arrays["A_shape"])
    matrix[arrays["A_row"], arrays["A_column"]] = arrays["A_value"]
    np.testing.assert_array_equal(mat["A"].toarray(), matrix)
    assert [str(item[0]) for item in mat["state_name"].ravel()] == states
    assert [str(item[0]) for item in mat["input_name"].ravel()] == ["winch"]
    table = read_csv(Path("model.csv"))
    assert list(table) == ["matrix", "row", "column", "value"]
    found, control = np.zeros_like(matrix), np.zeros(len(states))
    for name, row, column, value in zip(*table.values(), strict=True):
        if name == "A":
            found[states.index(row), states.index(column)] = float(value)
        elif name == "B":
            assert column == "winch"
            control[states.index(row)] = float(value)
    np.testing.assert_array_equal(found, matrix)
    np.testing.assert_array_equal(control, mat["B"].toarray()[:, 0])
    start = [float(v) for m, v in zip(table["matrix"], table["value"], strict=True) if m == "state"]
    assert start == arrays["state"].tolist()


@pytest.mark.parametrize(
    ("verb", "options", "allowed"),
    [
        ("simulate", SIMULATE, ".npz or .csv or .parquet or .mat"),
        ("linearize", ("--json",), ".npz or .mat or .csv"),
    ],
)
@pytest.mark.parametrize("ending", [".xlsx", ".gz"])
def test_another_ending_is_refused_before_the_run(
    run: Run, scene: Path, verb: str, options: tuple[str, ...], allowed: str, ending: str
) -> None:
    scene.write_text("not a scene", encoding="utf-8")  # which a run would notice
    ended = run.refused(verb, scene, *options, "--out", f"result{ending}")
    assert ended.data["error"] == "OutputError"
    assert allowed in ended.data["allowed"]
    assert not Path(f"result{ending}").exists()


def test_a_missing_package_is_refused_before_the_run(
    run: Run, scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    scene.write_text("not a scene", encoding="utf-8")
    ended = run("simulate", scene, *SIMULATE, "--out", "run.parquet")
    assert (ended.code, ended.data["error"]) == (2, "MissingExtraError")
    assert "'.[tables]'" in ended.data["hint"]


@pytest.mark.parametrize("kind", ["csv", "mat"])
def test_a_file_of_someone_else_stays(run: Run, scene: Path, kind: str) -> None:
    Path(f"own.{kind}").write_text("time [s],force [N]\n0,1\n", encoding="utf-8")
    ended = run("simulate", scene, *SIMULATE, "--out", f"own.{kind}")
    assert (ended.code, ended.data["hint"]) == (
        2,
        "choose another name, or pass --overwrite to replace it",
    )
    assert Path(f"own.{kind}").read_text(encoding="utf-8") == "time [s],force [N]\n0,1\n"
    run.good("simulate", scene, *SIMULATE, "--out", f"own.{kind}", "--overwrite")


def test_an_array_too_large_for_matlab_is_refused(tmp_path: Path) -> None:
    from tensegrity_codegen.system.errors import InvalidValueError
    from tensegrity_codegen.system.table_files import write_mat

    huge = np.broadcast_to(np.zeros(1), 2**28)  # 2 GB that take no memory
    with pytest.raises(InvalidValueError, match="too large for a"):
        write_mat(tmp_path / "huge.mat", {"huge": huge}, overwrite=False)
    assert not (tmp_path / "huge.mat").exists()
