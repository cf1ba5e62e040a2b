"""Tables of sweeps: a row a case with its keys, results and status."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.sweeps.store.store import StoreContents, SweepStore, create_store
from tensegrity_codegen.sweeps.store.table import write_sweep_table
from tensegrity_codegen.system.errors import OutputError, UnknownNameError
from tests.sweeps.store.conftest import make_result

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")


@pytest.fixture
def stored(tmp_path: Path, contents: StoreContents) -> Path:
    """A sweep whose first task is not finished."""
    create_store(tmp_path / "a.zarr", contents)
    store = SweepStore(tmp_path / "a.zarr")
    for task in range(1, contents.layout.n_tasks):
        store.write(task, make_result(*contents.layout.cases_of(task)), {})
    return tmp_path / "a.zarr"


def test_a_table_has_each_case_once_with_its_keys_and_results(
    stored: Path, contents: StoreContents, tmp_path: Path
) -> None:
    absent = write_sweep_table(stored, tmp_path / "a.csv", "csv")
    assert absent == ("position",)
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    n, first = contents.cases.count, contents.layout.cases_of(1)[0]
    assert [int(row["case"]) for row in rows] == list(range(n))
    values, expected = contents.cases.values(), make_result(0, n)
    for column, key in enumerate(contents.cases.keys):
        assert [float(row[key]) for row in rows] == values[:, column].tolist()
    assert {row["status"] for row in rows[:first]} == {"not_computed"}
    words = {"ok": 0, "iteration_limit": 8}
    assert [words[row["status"]] for row in rows[first:]] == expected.status[first:].tolist()
    found = np.array([float(row["energy [J]"]) for row in rows[first:]])
    assert np.array_equal(found, expected.arrays["energy"][first:], equal_nan=True)
    found = np.array([float(row["tension.c1 [N]"]) for row in rows[first:]])
    assert np.array_equal(found, expected.arrays["tension"][first:, 1], equal_nan=True)
    assert [row["message"] for row in rows[first:]] == list(expected.messages[first:])
    with pytest.raises(OutputError, match="exists already"):
        write_sweep_table(stored, tmp_path / "a.csv", "csv")
    write_sweep_table(stored, tmp_path / "a.csv", "csv", overwrite=True)


def test_parquet_holds_the_same_numbers(stored: Path, contents: StoreContents, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: pip install '.[tables]'")
    write_sweep_table(stored, tmp_path / "a.parquet", "parquet")
    table = parquet.read_table(tmp_path / "a.parquet")
    n, first = contents.cases.count, contents.layout.cases_of(1)[0]
    assert table.num_rows == n
    expected = make_result(0, n).arrays["energy"][first:]
    assert np.array_equal(table["energy [J]"].to_numpy()[first:], expected, equal_nan=True)
    assert table["case"].to_pylist() == list(range(n))


def test_a_table_replaces_no_file_of_a_user_and_knows_its_formats(stored: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("name,weight\nme,1\n")
    with pytest.raises(OutputError):
        write_sweep_table(stored, tmp_path / "mine.csv", "csv")
    with pytest.raises(OutputError):
        write_sweep_table(stored, tmp_path / "a.parquet", "csv")
    with pytest.raises(UnknownNameError):
        write_sweep_table(stored, tmp_path / "a.xlsx", "xlsx")
    with pytest.raises(OutputError, match="not a sweep"):
        write_sweep_table(tmp_path, tmp_path / "b.csv", "csv")
    assert (tmp_path / "mine.csv").read_text() == "name,weight\nme,1\n"
    assert sorted(item.name for item in tmp_path.iterdir()) == ["a.zarr", "mine.csv"]
