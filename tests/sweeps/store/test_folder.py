"""Which sweep a folder holds: another one is refused by the keys that differ."""

import json
from pathlib import Path

import pytest

from tensegrity_codegen.sweeps.store.folder import (
    check_same_sweep,
    check_store_folder,
    find_differences,
    locked_store,
)
from tensegrity_codegen.system.errors import OutputError
from tests.sweeps.store.conftest import KINDS, make_contents


def test_what_follows_from_another_difference_is_not_counted() -> None:
    stored = {
        "scene": {"gravity": [0, 0, -9.81]},
        "structure_hash": "2b58",
        "cases": {"method": "random", "count": 30, "points": {"method": "random", "n": 30}},
    }
    asked = {
        "scene": {"gravity": [0, 0, -1.62]},
        "structure_hash": "77aa",
        "cases": {"method": "sobol", "count": 31, "points": {"method": "sobol", "n": 31}},
    }
    keys = [line.split(":")[0] for line in find_differences(stored, asked)]
    assert keys == ["scene.gravity", "cases.points.method", "cases.points.n"]
    other = {**stored, "structure_hash": "77aa"}  # a file beside the scene differs
    assert [line.split(":")[0] for line in find_differences(stored, other)] == ["structure_hash"]


def test_differences_are_named_by_their_keys() -> None:
    stored = {
        "scene": {"nodes": {"n1": {"position": [0.0, 1.0, 2.0]}}, "gravity": [0.0, 0.0, -9.81]},
        "cases": {"axes": [{"key": "shape.height", "count": 9, "values": [*range(9)]}]},
        "operation": {"do": "simulate", "keep": ["final(energy)"], "t_end": 1.0},
    }
    asked = {
        "scene": {"nodes": {"n1": {"position": (0.0, 1.0, 2.5)}}, "gravity": (0.0, 0.0, -9.81)},
        "cases": {"axes": [{"key": "shape.height", "count": 8, "values": [*range(8)]}]},
        "operation": {"do": "simulate", "keep": ["max(energy)"], "t_end": 1.0, "rtol": 1e-6},
    }
    assert find_differences(stored, stored) == []
    assert find_differences(stored, asked) == [
        "scene.nodes.n1.position: [0.0, 1.0, 2.0] in the folder, [0.0, 1.0, 2.5] now",
        "cases.axes[shape.height].count: 9 in the folder, 8 now",
        "cases.axes[shape.height].values: 9 values from 0 to 8 in the folder, 8 values from 0 to 7 now",
        'operation.keep: ["final(energy)"] in the folder, ["max(energy)"] now',
        "operation.rtol: absent in the folder, 1e-06 now",
    ]
    with pytest.raises(OutputError, match=r"operation\.rtol") as caught:
        check_same_sweep("a.zarr", stored, asked)
    assert caught.value.exit_code == 2
    check_same_sweep("a.zarr", stored, json.loads(json.dumps(stored)))


def test_what_is_no_sweep_is_refused(tmp_path: Path) -> None:
    assert check_store_folder(tmp_path / "new.zarr") is None
    (tmp_path / "empty.zarr").mkdir()
    assert check_store_folder(tmp_path / "empty.zarr") is None
    (tmp_path / "mine.zarr").mkdir()
    (tmp_path / "mine.zarr/notes").write_text("mine")
    (tmp_path / "other.zarr").mkdir()
    (tmp_path / "other.zarr/zarr.json").write_text(
        '{"zarr_format": 3, "node_type": "group", "attributes": {}}'
    )
    for name in ("mine.zarr", "other.zarr"):
        with pytest.raises(OutputError, match="not a sweep"):
            check_store_folder(tmp_path / name)
    (tmp_path / "file.zarr").write_text("a file")
    for name in ("file.zarr", "file.zarr/new.zarr", "new.csv"):
        with pytest.raises(OutputError):
            check_store_folder(tmp_path / name)
    assert sorted(item.name for item in tmp_path.iterdir()) == [
        "empty.zarr",
        "file.zarr",
        "mine.zarr",
        "other.zarr",
    ]


def test_a_store_says_what_it_holds(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
    from tensegrity_codegen.sweeps.store.store import create_store

    contents = make_contents(KINDS["both"], do="evaluate")
    create_store(tmp_path / "a.zarr", contents)
    stored = check_store_folder(tmp_path / "a.zarr")
    assert stored is not None
    check_same_sweep(stored.path, stored.identity, contents.identity)
    assert stored.task_size == contents.layout.task_size
    assert stored.attributes["title"] == "a sweep"


def test_two_sweeps_do_not_write_to_one_folder(tmp_path: Path) -> None:
    path, refused = tmp_path / "a.zarr", pytest.raises(OutputError, match="another sweep")
    with locked_store(path), refused, locked_store(path):
        pass
    with locked_store(tmp_path / "a.zarr"):
        pass
    assert not list(tmp_path.iterdir())
