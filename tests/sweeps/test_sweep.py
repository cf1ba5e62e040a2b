"""The function `sweep`: rows equal single cases on any number of workers; what goes on, what is refused."""

import copy
import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.registry import build_analysis
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.sweeps.cases.sampled import Sampling
from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
from tensegrity_codegen.sweeps.sweep import sweep
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    MissingExtraError,
    OutputError,
    TensegrityError,
)
from tests.cases import thorough

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
pytest.importorskip("xarray", reason="xarray is missing: pip install '.[sweep]'")

SCENE: dict[str, Any] = {
    "name": "hanging_mass",
    "nodes": {
        "top": {"position": [0.0, 0.0, 0.0], "anchored": "xyz"},
        "mass": {"position": [0.1, 0.0, -1.4], "mass": 2.0},
    },
    "members": {"cable": {"nodes": ["top", "mass"], "class": "cord"}},
    "classes": {"cord": {"kind": "cable", "spring_constant": 80.0, "rest_length": 1.0}},
    "model": {"quantities": ["member_tension", "acceleration"]},
}
KEYS = {"gravity[2]": "uniform(-10,0)"}
OVER = {"classes.cord.spring_constant": [60.0, 80.0, 100.0], "gravity[2]": "-10:0:5"}


def test_each_row_equals_the_case_alone(tmp_path: Path) -> None:
    found = sweep(SCENE, do="evaluate", over=OVER, out=tmp_path / "a.zarr", workers=2, task_size=4)
    assert found["member_tension"].dims == (*OVER, "member")
    for stiffness, gravity in [(60.0, 0.0), (100.0, -7.5)]:
        scene = copy.deepcopy(SCENE)
        scene["classes"]["cord"]["spring_constant"] = stiffness
        scene["gravity"] = [0.0, 0.0, gravity]
        model = compile_scene(scene)
        row = found.sel({"classes.cord.spring_constant": stiffness, "gravity[2]": gravity})
        for name in ("member_tension", "acceleration"):
            np.testing.assert_allclose(row[name].values, model.compute(name), rtol=1e-13, atol=1e-13)
    assert (found["status"] == 0).all()
    assert found.attrs["scene_name"] == "hanging_mass"


def test_an_input_with_one_value_has_it() -> None:
    scene = SCENE | {"actuators": [{"name": "winch", "members": "cable"}]}
    for values in ([-0.1], [-0.1, -0.2]):
        found = sweep(scene, do="evaluate", over={"input.winch": values}, workers=1)
        stretched = np.hypot(0.1, 1.4) - 1.0 - np.array(values)
        np.testing.assert_allclose(found["member_tension"].values[:, 0], 80.0 * stretched, rtol=1e-12)


RING: dict[str, Any] = {
    "name": "ring",
    "shape": {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "node_mass": 0.05},
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 2e4},
        "cable": {"kind": "cable", "spring_constant": 200.0},
    },
    "model": {"quantities": ["member_tension"]},
}
RING["shape"]["prestress"] = 1.0


def test_cases_with_other_members_share_arrays_by_their_names() -> None:
    over = {"shape.bars": [3, 4], "shape.height": [0.25, 0.3]}
    found = sweep(RING, do="evaluate", over=over, keep=["member_tension"], workers=1)
    assert (found["status"] == 0).all()
    for bars in (3, 4):
        scene = copy.deepcopy(RING)
        scene["shape"] |= {"bars": bars, "height": 0.25}
        model = compile_scene(scene)
        row = found["member_tension"].sel({"shape.bars": bars, "shape.height": 0.25})
        names = list(model.manifest.member_name)
        expected = model.compute("member_tension")
        np.testing.assert_allclose(row.sel(member=names).values, expected, rtol=1e-12, atol=1e-12)
        others = [name for name in row["member"].values.tolist() if name not in names]
        assert np.isnan(row.sel(member=others).values).all()


def test_a_result_that_is_nan_in_every_case_is_named() -> None:
    """No cable reaches 1e9 N in these motions."""
    wanted = {"do": "simulate", "t_end": 0.01, "workers": 1}
    over = {"classes.cable.spring_constant": [200.0, 300.0]}
    with pytest.warns(UserWarning, match=r"every value of torn is NaN") as caught:
        found = sweep(
            RING, over=over, keep=["torn = first(max(member_tension) > 1e9)", "energy_drift"], **wanted
        )
    assert np.isnan(found["torn"]).all()
    assert np.isfinite(found["energy_drift"]).all()
    assert len(caught) == 1


@pytest.mark.parametrize("sampling", ["sobol", *thorough("random", "latin_hypercube")])
def test_the_same_seed_gives_the_same_bits_on_any_number_of_workers(sampling: str) -> None:
    options: dict[str, Any] = {
        "do": "evaluate",
        "sample": Sampling(
            {"classes.cord.spring_constant": "normal(80,5)", "gravity[2]": "uniform(-10,0)"}, 32, 7, sampling
        ),
    }
    one = sweep(SCENE, **options, workers=1, task_size=32)
    two = sweep(SCENE, **options, workers=2, task_size=8)
    other = replace(options["sample"], seed=8)
    for name in ("member_tension", "classes.cord.spring_constant", "gravity[2]"):
        assert np.array_equal(one[name].values, two[name].values)
    assert not np.array_equal(one["gravity[2]"], sweep(SCENE, **{**options, "sample": other})["gravity[2]"])


def test_another_sweep_is_refused_by_what_differs(tmp_path: Path) -> None:
    out = tmp_path / "a.zarr"
    sweep(SCENE, do="evaluate", over=OVER, out=out, workers=1)
    again = sweep(SCENE, do="evaluate", over=OVER, out=out, workers=1, task_size=2)
    assert (again["status"] == 0).all()
    changed = copy.deepcopy(SCENE)
    changed["nodes"]["mass"]["mass"] = 3.0
    wrong: list[tuple[Any, dict[str, Any], str]] = [
        (changed, {}, r"scene\.nodes\.mass\.mass: 2\.0 in the folder, 3\.0 now"),
        (SCENE, {"over": {**OVER, "gravity[2]": "-10:0:6"}}, r"gravity\[2\]"),
        (SCENE, {"keep": "member_tension"}, r"operation\.keep"),
    ]
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    for scene, options, said in wrong:
        with pytest.raises(OutputError, match=said):
            sweep(scene, **{"do": "evaluate", "over": OVER, "out": out, "workers": 1, **options})
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"workers": 0}, "workers"),
        ({"over": {"classes.cord.spring_constand": [1.0]}}, "scene: classes.cord.spring_constand"),
        ({"over": {"gravity[2]": "0:1:0"}}, "over gravity[2]"),
        ({"over": 3}, "over"),
        ({"over": {3: [1, 2]}}, "over"),
        ({"over": None}, "over, sample, table"),
        ({"do": "evaluated"}, "do"),
        ({"keep": "member_tensions"}, "keep 'member_tensions'"),
        ({"keep": 3}, "keep"),
        ({"task_size": 0}, "task_size"),
        ({"stop_after": 0}, "stop_after"),
        ({"stop_after": "2"}, "stop_after"),
        ({"sample": 3}, "sample"),
        ({"sample": {"gravity[2]": "normal(0,1)"}}, "sample"),
        ({"sample": Sampling({"gravity[-1]": "normal(0,1)"}, 2)}, "sample"),
        ({"sample": Sampling(KEYS, 2, seed=-1), "over": ()}, "seed"),
        ({"sample": Sampling(KEYS, 2, method="even"), "over": ()}, "sampling"),
        ({"sample": Sampling(KEYS, "a"), "over": ()}, "n"),
        ({"sample": Sampling((), 4)}, "n"),
        ({"seed": 1}, "sweep"),
        ({"out": 3}, "out"),
        ({"out": ""}, "out"),
        ({"out": "."}, "out"),
        ({"out": "no/file.csv"}, "no/file.csv"),
        ({"workers": Cluster("")}, "scheduler"),
        ({"workers": Cluster("tcp://a:1", wait="long")}, "wait"),
        ({"yes": "no"}, "yes"),
        ({"on_progress": 3}, "on_progress"),
        ({"do": "simulate", "samples": 2.5}, "samples"),
        ({"do": "simulate", "samples": "a"}, "samples"),
        ({"do": "equilibrium", "tolerance": "small"}, "tolerance"),
        ({"do": "equilibrium", "max_iterations": 2.5}, "max_iterations"),
    ],
)
def test_a_wrong_argument_is_named_and_leaves_nothing(
    options: dict[str, Any], where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TensegrityError) as caught:
        sweep(SCENE, **{"do": "evaluate", "over": OVER, "workers": 1, "out": "a.zarr", **options})
    assert (caught.value.where, caught.value.exit_code) == (where, 2)
    assert type(pickle.loads(pickle.dumps(caught.value))) is type(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_scene_that_is_none_is_named_and_something_must_vary() -> None:
    wrong: Any = 3
    with pytest.raises(InvalidValueError, match="wrong type"):
        sweep(wrong, do="evaluate", over=OVER)
    with pytest.raises(InvalidValueError, match="nothing varies"):
        sweep(SCENE, do="evaluate")


def test_the_current_folder_is_no_folder_of_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder of results is replaced, and that would be the folder in which the user is."""
    monkeypatch.chdir(tmp_path)
    for name in ("", ".", "..", Path(), "a\0.zarr"):
        with pytest.raises(OutputError, match="the name of the folder"):
            sweep(SCENE, do="evaluate", over=OVER, out=name, workers=1)
    assert tmp_path.is_dir()


def test_numbers_of_numpy_are_options() -> None:
    operation = build_analysis("simulate", t_end=np.float32(0.5), samples=np.int64(5))
    assert json.loads(json.dumps(operation.describe()))["samples"] == 5


def test_without_zarr_the_error_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(MissingExtraError, match="zarr") as caught:
        sweep(SCENE, do="evaluate", over=OVER)
    assert "pip install '.[sweep]'" in str(caught.value)
