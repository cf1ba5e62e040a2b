"""Result files: what is written reads back to the bit, what is damaged is a named error."""

import contextlib
import os
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model import arrays
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import OutputError, SceneError, SceneSyntaxError, StructureError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws
from tests.runtime.build import make_structure, spring

# A trajectory and the bytes of its file.
Written = tuple[Trajectory, bytes]


def swinging() -> Structure:
    members = [spring(0, 1, 0.9), spring(1, 2, 0.8)]
    return make_structure([[0, 5, 0], [1, 5, 0], [2, 5, 0.5]], members, axes="xz", anchored={0: "x"})


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    request = ModelRequest(SIMULATION_QUANTITIES, integrators=("rk4", "rk54"))
    run = simulate(build_library(swinging(), request).load(), 1.0, samples=31)
    path = tmp_path_factory.mktemp("results") / "run.npz"
    run.write(path)
    return run, path.read_bytes()


def test_the_nodes_move_on_the_modelled_axes_alone(written: Written) -> None:
    run, _ = written
    assert run.node_position.shape == run.node_velocity.shape == (31, 3, 3)
    assert (run.node_position[:, :, 1] == 5.0).all()
    assert (run.node_velocity[:, :, 1] == 0.0).all()
    assert (run.node_position[:, 0, 0] == 0.0).all()
    np.testing.assert_array_equal(run.node_position[:, 0, 2], run.coordinate[:, 0])
    np.testing.assert_array_equal(run.node_velocity[:, 2, 2], run.velocity[:, 4])


def test_what_is_written_reads_back_to_the_last_bit(written: Written, tmp_path: Path) -> None:
    run, data = written
    path = tmp_path / "run.npz"
    path.write_bytes(data)
    found = read_trajectory(path, swinging())
    for name in (
        *("time", "coordinate", "velocity", "node_position", "node_velocity"),
        *("member_tension", "kinetic_energy", "total_energy"),
    ):
        np.testing.assert_array_equal(getattr(found, name), getattr(run, name), err_msg=name)
    for name in ("status", "message", "method", "node_name", "member_name"):
        assert getattr(found, name) == getattr(run, name)


@pytest.mark.parametrize(("most", "method"), [(10**9, zipfile.ZIP_DEFLATED), (0, zipfile.ZIP_STORED)])
def test_a_long_result_is_not_compressed_and_reads_back_alike(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, method: int
) -> None:
    monkeypatch.setattr(arrays, "MAX_COMPRESSED", most)
    written[0].write(tmp_path / "run.npz")
    with zipfile.ZipFile(tmp_path / "run.npz") as file:
        assert {item.compress_type for item in file.infolist()} == {method}
    with np.load(tmp_path / "run.npz") as found:
        for name, array in written[0].arrays().items():
            np.testing.assert_array_equal(found[name], array)


def test_the_file_opens_without_this_package(written: Written, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(written[1])
    with np.load(path, allow_pickle=False) as file:
        assert set(written[0].arrays()) <= set(file.files)
        assert file["node_name"].tolist() == ["n0", "n1", "n2"]


def test_a_result_of_another_structure_is_refused(written: Written, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(written[1])
    other = swinging().with_changes(node_name=("n0", "n1", "other"))
    with pytest.raises(StructureError, match="belongs to another structure") as caught:
        read_trajectory(path, other)
    assert caught.value.where == str(path)


@pytest.mark.parametrize("content", [b"", b"rubbish", b"PK\x03\x04", b"time,x\n0,1\n"])
def test_another_kind_of_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with pytest.raises(SceneSyntaxError, match="not a result file") as caught:
        read_trajectory(path, swinging())
    assert caught.value.where == str(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneSyntaxError, match="not a result file"):
        read_trajectory(tmp_path / "missing.npz", swinging())


def test_one_array_is_no_result(tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", np.zeros(3))
    with pytest.raises(SceneSyntaxError, match="not a result file"):
        read_trajectory(tmp_path / "run.npy", swinging())


def test_pickled_objects_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", node_name=np.array([{"a": 1}], dtype=object))
    with pytest.raises(SceneSyntaxError, match="not a result file"):
        read_trajectory(tmp_path / "run.npz", swinging())


@pytest.mark.parametrize("missing", ["time", "node_position", "member_tension", "status", "node_name"])
def test_a_result_without_one_of_its_arrays_is_refused(
    written: Written, tmp_path: Path, missing: str
) -> None:
    arrays = {name: values for name, values in written[0].arrays().items() if name != missing}
    np.savez(tmp_path / "run.npz", **arrays)
    with pytest.raises(SceneSyntaxError, match="not a result file"):
        read_trajectory(tmp_path / "run.npz", swinging())


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("node_position", np.zeros((31, 3))),
        ("node_velocity", np.zeros((31, 2, 3))),
        ("member_tension", np.zeros((30, 2))),
        ("time", np.zeros((31, 1))),
        ("total_energy", np.array(["text"] * 31)),
        ("node_position", np.full((31, 3, 3), np.nan)),
    ],
    ids=["flat", "fewer nodes", "fewer samples", "table of times", "text", "nan"],
)
def test_an_array_of_another_shape_or_kind_is_refused(
    written: Written, tmp_path: Path, name: str, values: np.ndarray
) -> None:
    np.savez(tmp_path / "run.npz", **(written[0].arrays() | {name: values}))
    with pytest.raises(SceneError) as caught:
        read_trajectory(tmp_path / "run.npz", swinging())
    assert caught.value.where == str(tmp_path / "run.npz")


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.999])
def test_a_file_cut_short_is_refused(written: Written, tmp_path: Path, part: float) -> None:
    data = written[1]
    (tmp_path / "run.npz").write_bytes(data[: int(part * len(data))])
    with pytest.raises(SceneSyntaxError, match="not a result file"):
        read_trajectory(tmp_path / "run.npz", swinging())


@given(st.data())
@draws(60)
def test_a_changed_byte_is_never_a_crash(written: Written, tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(written[1])
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with contextlib.suppress(SceneError):  # or the byte did not matter
        assert read_trajectory(path, swinging()).node_position.shape == (31, 3, 3)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.longdouble, ">f8"])
def test_numbers_of_another_precision_are_read_as_double(written: Written, tmp_path: Path, kind: str) -> None:
    arrays = {
        name: item.astype(kind) if item.dtype.kind == "f" else item
        for name, item in written[0].arrays().items()
    }
    np.savez(tmp_path / "run.npz", **arrays)
    found = read_trajectory(tmp_path / "run.npz", swinging())
    assert found.node_position.dtype == found.time.dtype == np.dtype(float)


def test_a_folder_that_is_missing_is_named(written: Written, tmp_path: Path) -> None:
    with pytest.raises(OutputError) as caught:
        written[0].write(tmp_path / "missing" / "run.npz")
    assert str(tmp_path / "missing" / "run.npz") in caught.value.where
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_no_folder(written: Written, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"kept")
    with pytest.raises(OutputError):
        written[0].write(tmp_path / "file" / "run.npz")
    assert (tmp_path / "file").read_bytes() == b"kept"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written_to_stays_as_it_was(written: Written, tmp_path: Path) -> None:
    folder = tmp_path / "closed"
    folder.mkdir()
    folder.chmod(0o500)
    try:
        with pytest.raises(OutputError):
            written[0].write(folder / "run.npz")
        assert list(folder.iterdir()) == []
    finally:
        folder.chmod(0o700)


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")

    def fail(file: object, **_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OutputError, match="No space left"):
        written[0].write(path, overwrite=True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.npz"]
    assert path.read_bytes() == b"old"


def test_a_missing_file_is_named_without_the_number_of_the_system_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        read_trajectory(tmp_path / "none.npz", swinging())
    assert caught.value.given == "No such file or directory"
    assert "Errno" not in str(caught.value)
