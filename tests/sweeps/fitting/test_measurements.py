"""Tables of measurements: names, units, missing cells, wrong tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.fitting.measurements import read_measurements
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    SceneError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.sweeps.fitting.scenes import FALL


@pytest.fixture(scope="module")
def structure() -> Structure:
    found, _ = load_scene(FALL)
    assert isinstance(found, Structure)
    return found


def test_files_of_motions_are_measurements(structure: Structure, tmp_path: Path) -> None:
    motion = simulate(compile_scene(FALL, for_="simulate"), 0.2, samples=5)
    motion.write(tmp_path / "motion.csv")
    found = read_measurements(tmp_path / "motion.csv", structure)
    names = [item.name for item in found.channels]
    assert names[:3] == ["top.x", "top.y", "top.z"]
    assert names[-1] == "rope.tension"
    place = names.index("weight.z")
    np.testing.assert_array_equal(found.value[:, place], motion.node_position[:, 1, 2])
    assert found.count == found.value.size


def test_empty_cells_are_missing(structure: Structure, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("time;weight.z [m];rope.length\n0,1;;0,6\n0,2;-0,7;\n", encoding="utf-8")
    found = read_measurements(tmp_path / "m.csv", structure)
    np.testing.assert_array_equal(found.value, [[np.nan, 0.6], [-0.7, np.nan]])
    assert [item.unit for item in found.channels] == ["m", "m"]


def test_a_file_may_have_any_name(
    structure: Structure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("measured").write_text("time,weight.z\n0.1,-0.7\n", encoding="utf-8")
    assert read_measurements("measured", structure).value.tolist() == [[-0.7]]


def test_tables_without_times_are_states_at_rest(structure: Structure, tmp_path: Path) -> None:
    text = "loads[0].force[2],weight.z,frequency.1 [Hz]\n-1,-1.1,\n-2,,1.6\n"
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    found = read_measurements(tmp_path / "m.csv", structure)
    assert found.is_static
    assert {key: values.tolist() for key, values in found.conditions.items()} == {
        "loads[0].force[2]": [-1.0, -2.0]
    }
    assert [(item.kind, item.place) for item in found.channels] == [("position", (1, 2)), ("frequency", (0,))]
    np.testing.assert_array_equal(found.value, [[-1.1, np.nan], [np.nan, 1.6]])


@pytest.mark.parametrize(
    ("text", "error", "word"),
    [
        ("", SceneError, "empty"),
        ("time,weight.z\n", InvalidValueError, "no rows"),
        ("weight.vz\n1\n", InvalidValueError, "no velocities"),
        ("time,frequency.1\n1,2\n", InvalidValueError, "no frequencies"),
        ("weight.z,loads[0].force[2]\n1,\n", InvalidValueError, "empty"),
        ("loads[0].force[2]\n1\n", InvalidValueError, "nothing was measured"),
        ("time\n1\n", InvalidValueError, "nothing was measured"),
        ("time,weight.z\n1,\n", InvalidValueError, "nothing was measured"),
        ("time,weihgt.z\n1,2\n", UnknownKeyError, "weight.z"),
        ("time,weight.z [mm]\n1,2\n", UnknownKeyError, "weight.z"),
        ("time,weight.z,weight.z [m]\n1,2,2\n", InvalidValueError, "twice"),
        ("time,weight.z\n1,2\n0.5,2\n", InvalidValueError, "go back"),
        ("time,weight.z\n1,2\n1,2\n", InvalidValueError, "stand still"),
        ("time,weight.z\n-1,2\n1,2\n", InvalidValueError, "before the start"),
        ("time,weight.z\n0,2\n", InvalidValueError, "at the start"),
        ("time,weight.z\n,2\n", InvalidValueError, "empty"),
        ("time,weight.z\n1,nan\n", NonFiniteError, "finite"),
        ("time,weight.z\n1,two\n", InvalidValueError, "number"),
    ],
)
def test_wrong_tables_are_refused(
    structure: Structure, tmp_path: Path, text: str, error: type[Exception], word: str
) -> None:
    (tmp_path / "m.csv").write_text(text, encoding="utf-8")
    with pytest.raises(error, match=word) as caught:
        read_measurements(tmp_path / "m.csv", structure)
    assert "m.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "error", "word"),
    [
        ({}, InvalidValueError, "nothing was measured"),
        ({"time": [1.0], "weight.w": [1.0]}, UnknownNameError, "weight"),
        ({"time": [1.0, 2.0], "weight.z": [1.0]}, InvalidValueError, "as many values"),
        ({"time": [1.0], "weight.z": [np.inf]}, NonFiniteError, "infinite"),
        ({"time": [np.nan], "weight.z": [1.0]}, NonFiniteError, "not finite"),
    ],
)
def test_wrong_arrays_are_refused(
    structure: Structure, arrays: dict[str, Any], error: type[Exception], word: str
) -> None:
    with pytest.raises(error, match=word):
        read_measurements(arrays, structure)
