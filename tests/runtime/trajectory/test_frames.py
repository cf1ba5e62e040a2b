"""Motions as tables and as arrays with named axes."""

import builtins
import sys
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, simulate, simulate_batch
from tensegrity_codegen.runtime.trajectory.motion_tables import list_columns
from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory, Trajectory
from tensegrity_codegen.system.errors import MissingExtraError

SCENE = {
    "name": "pair",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {"top": {"position": [0, 0], "anchored": True}, "load": {"position": [0.2, -1], "mass": 0.5}},
    "members": {
        "cord": {"kind": "cable", "nodes": ["top", "load"], "spring_constant": 80, "rest_length": 0.9}
    },
    "inputs": [
        {"kind": "force", "name": "push", "nodes": ["load"], "direction": [1, 0]},
        {"kind": "rest_length", "name": "winch", "members": ["cord"]},
    ],
}


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    model = compile_scene(SCENE, for_="simulate")
    return simulate(model, t_end=0.5, samples=6, arguments={"push": 0.5})


@pytest.fixture(scope="module")
def batch() -> BatchTrajectory:
    model = compile_scene(SCENE, for_="simulate_batch")
    starts = [[0.2, -1.0], [0.3, -1.1], [0.0, -1.2]]
    return simulate_batch(model, t_end=0.5, samples=6, coordinate=starts)


def test_columns_are_named_with_units_and_hold_every_sample(motion: Trajectory) -> None:
    columns = list_columns(motion)
    nodes = [f"{node}.{axis} [m]" for node in ("top", "load") for axis in "xyz"]
    rates = [f"{node}.v{axis} [m/s]" for node in ("top", "load") for axis in "xyz"]
    others = ["cord.tension [N]", "kinetic_energy [J]", "total_energy [J]"]
    assert list(columns) == ["time [s]", *nodes, *rates, *others, "input.push [N]", "input.winch [m]"]
    assert {len(values) for values in columns.values()} == {6}
    np.testing.assert_array_equal(columns["load.z [m]"], motion.position("load")[:, 2])
    np.testing.assert_array_equal(columns["load.vx [m/s]"], motion.velocity_of("load")[:, 0])
    np.testing.assert_array_equal(columns["cord.tension [N]"], motion.tension("cord"))
    assert columns["input.push [N]"].tolist() == [0.5] * 6


def test_the_table_of_a_batch_has_the_number_of_the_motion_first(batch: BatchTrajectory) -> None:
    columns = list_columns(batch)
    assert list(columns)[:2] == ["motion", "time [s]"]
    assert columns["motion"].tolist() == [0] * 6 + [1] * 6 + [2] * 6
    np.testing.assert_array_equal(columns["load.x [m]"][6:12], batch[1].position("load")[:, 0])


@pytest.mark.parametrize(("method", "package"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_a_missing_package_is_a_named_error(
    motion: Trajectory, method: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = builtins.__import__

    def refuse(name: str, *rest: Any, **more: Any) -> Any:
        if name.partition(".")[0] == package:
            raise ImportError(f"no {package}", name=package)
        return usual(name, *rest, **more)

    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(MissingExtraError, match=f"'{package}', which is not installed"):
        getattr(motion, method)()


@pytest.mark.peers
def test_pandas_has_the_same_numbers(motion: Trajectory, batch: BatchTrajectory) -> None:
    pytest.importorskip("pandas", reason="needs pandas, of the extra tables")
    frame = motion.to_pandas()
    assert frame.index.name == "time [s]"
    np.testing.assert_array_equal(frame["load.z [m]"].to_numpy(), motion.position("load")[:, 2])
    many = batch.to_pandas()
    assert list(many.index.names) == ["motion", "time [s]"]
    np.testing.assert_array_equal(many.loc[2]["cord.tension [N]"].to_numpy(), batch[2].tension("cord"))


@pytest.mark.peers
def test_xarray_has_the_same_numbers_with_named_axes(motion: Trajectory, batch: BatchTrajectory) -> None:
    pytest.importorskip("xarray", reason="needs xarray, of the extra tables")
    data = motion.to_xarray()
    place = data.node_position.sel(node="load", axis="z")
    np.testing.assert_array_equal(place.values, motion.position("load")[:, 2])
    assert place.attrs["units"] == "m"
    assert data.input.attrs["units"] == "N, m"
    many = batch.to_xarray()
    assert dict(many.sizes) == {"motion": 3, "time": 6, "node": 2, "axis": 3, "member": 1}
    np.testing.assert_array_equal(
        many.member_tension.sel(motion=1, member="cord").values, batch[1].tension("cord")
    )
