"""A store: every case once, whole chunks, records last; readable at any moment, and after a full disk."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.sweeps.store.folder import open_sweep
from tensegrity_codegen.sweeps.store.store import StoreContents, SweepStore, create_store
from tensegrity_codegen.system.errors import OutputError
from tests.sweeps.store.conftest import KINDS, make_contents, make_result

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
pytest.importorskip("xarray", reason="xarray is missing: pip install '.[sweep]'")


def write_all(path: Path, order: list[int]) -> None:
    store = SweepStore(path)
    for task in order:
        store.write(task, make_result(*store.layout.cases_of(task)), {"attempts": 1})


def test_a_whole_sweep_reads_back_under_its_dimensions(tmp_path: Path, contents: StoreContents) -> None:
    import xarray

    path = tmp_path / "a.zarr"
    create_store(path, contents)
    write_all(path, list(range(contents.layout.n_tasks))[::-1])
    found = xarray.open_zarr(path)  # warnings are errors in tests
    dims, cases, expected = contents.case_dims, contents.cases, make_result(0, contents.cases.count)
    for output in contents.outputs:
        assert found[output.name].dims == (*dims, *output.dims)
        assert found[output.name].attrs["units"] == output.unit
        assert found[output.name].attrs["long_name"] == output.sentence
        values = found[output.name].values.reshape(cases.count, *output.shape)
        assert np.array_equal(values, expected.arrays[output.name], equal_nan=values.dtype.kind == "f")
    assert found["status"].values.ravel().tolist() == expected.status.tolist()
    assert found["message"].values.ravel().tolist() == list(expected.messages)
    assert found["member"].values.tolist() == ["b1", "c1", "c2"]
    varied = cases.values()
    for column, key in enumerate(cases.keys):
        spread = found.coords[contents.name_key(key)].broadcast_like(found["status"]).transpose(*dims)
        assert np.array_equal(spread.values.ravel(), varied[:, column])


def test_a_grid_is_read_by_the_values_of_its_axes(tmp_path: Path) -> None:
    contents = make_contents(KINDS["grid"])
    create_store(tmp_path / "a.zarr", contents)
    write_all(tmp_path / "a.zarr", list(range(contents.layout.n_tasks)))
    case = open_sweep(tmp_path / "a.zarr").sel(
        {"classes.cable.rest_length": 3.0, "gravity[2]": 5.0, "member": "c2"}
    )
    assert float(case["tension"]) == 3 * 7 + 5 + 0.3


def test_what_is_not_finished_is_marked_and_the_rest_goes_on(tmp_path: Path, contents: StoreContents) -> None:
    path = tmp_path / "a.zarr"
    create_store(path, contents)
    write_all(path, [1])
    first, last = contents.layout.cases_of(1)
    status = open_sweep(path)["status"].values.ravel()
    assert (status[first:last] >= 0).all()
    assert (np.delete(status, np.arange(first, last)) == -1).all()
    store = SweepStore(path)
    assert store.find_finished() == {1}
    assert store.read_record(1) == {"first": first, "last": last, "attempts": 1}
    write_all(path, [task for task in range(contents.layout.n_tasks) if task != 1])
    assert SweepStore(path).find_finished() == set(range(contents.layout.n_tasks))
    tasks = range(contents.layout.n_tasks)
    assert sum(SweepStore(path).count_statuses(tasks).values()) == contents.cases.count


def test_a_task_without_its_record_is_not_finished(tmp_path: Path) -> None:
    contents = make_contents(KINDS["sample"])
    create_store(tmp_path / "a.zarr", contents)
    write_all(tmp_path / "a.zarr", [0, 2])
    (tmp_path / "a.zarr/task_record/c/2").unlink()  # as after a process that was killed between the two
    (tmp_path / "a.zarr/energy/c/0.12.partial").write_text("half of a chunk")
    assert SweepStore(tmp_path / "a.zarr").find_finished() == {0}
    assert not list(tmp_path.rglob("*.partial"))


def test_nothing_is_left_beside_a_new_store_and_a_foreign_folder_stays(tmp_path: Path) -> None:
    contents = make_contents(KINDS["axis"])
    create_store(tmp_path / "a.zarr", contents)
    assert [item.name for item in tmp_path.iterdir()] == ["a.zarr"]
    (tmp_path / "b.zarr").mkdir()
    (tmp_path / "b.zarr/notes.txt").write_text("mine")
    with pytest.raises(OutputError):
        create_store(tmp_path / "b.zarr", contents)
    assert (tmp_path / "b.zarr/notes.txt").read_text() == "mine"
    assert {item.name for item in tmp_path.iterdir()} == {"a.zarr", "b.zarr"}


FULL = """
import resource, signal, sys
from pathlib import Path
from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.sweeps.store.store import SweepStore
from tests.sweeps.store.conftest import make_result
store = SweepStore(Path(sys.argv[1]))
store.write(0, make_result(*store.layout.cases_of(0)), {})
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))  # bytes of a file: room for some chunks of a task
try:
    store.write(1, make_result(*store.layout.cases_of(1)), {})
except OutputError as error:
    print(error)
"""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="limits on the size of files are those of POSIX")
def test_without_space_the_finished_tasks_stay_and_nothing_of_the_other(tmp_path: Path) -> None:
    contents = make_contents(KINDS["sample"], size=8)
    path = tmp_path / "a.zarr"
    create_store(path, contents)
    command = [sys.executable, "-c", FULL, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "cannot be written" in run.stdout, run.stderr
    assert "goes on where it stopped" in run.stdout
    assert SweepStore(path).find_finished() == {0}
    assert not list(path.rglob("*.partial"))
    assert {item.name for item in path.rglob("c/*") if item.parent.parent.name == "steps"} == {"0"}
    first, last = contents.layout.cases_of(0)
    found = open_sweep(path)
    expected = make_result(first, last)
    assert np.array_equal(found["position"].values[first:last], expected.arrays["position"], equal_nan=True)
    assert (found["status"].values[last:] == -1).all()
    write_all(path, [1, 2])
    assert (open_sweep(path)["status"].values >= 0).all()
