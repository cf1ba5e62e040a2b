"""Loads of motions and equilibria: of the scene, of run-time arguments, of inputs that are forces."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import CompiledModel, compile_scene, find_equilibrium, simulate
from tensegrity_codegen.report.loads import compute_loads, compute_static_loads, describe_other_loads
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.structure.bodies import BodyLoad
from tensegrity_codegen.structure.structure import Structure
from tests.live.pages import load, sway

SCENE = """
name = "lift"
gravity = [0, 0, -9.81]
[model]
quantities = ["member_tension"]
[classes.cord]
kind = "cable"
spring_constant = 100
rest_length = 1
[nodes]
top = { position = [0, 0, 0], anchored = true }
middle = { position = [0, 0, -1], mass = 0.5 }
low = { position = [0, 0, -2.1], mass = 0.5 }
[members]
first = { class = "cord", nodes = ["top", "middle"] }
second = { class = "cord", nodes = ["middle", "low"] }
[[loads]]
node = "middle"
force = [0, 0, -1]
[[inputs]]
name = "push"
kind = "force"
nodes = ["low"]
direction = [0, 0, -1]
[parameters]
node_load = ["middle"]
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> CompiledModel:
    path = tmp_path_factory.mktemp("scene") / "lift.toml"
    path.write_text(SCENE, encoding="utf-8")
    return compile_scene(path, for_=("simulate", "equilibrium"))


def test_loads_of_a_motion_are_those_that_acted_and_are_kept_in_its_file(
    model: CompiledModel, tmp_path: Path
) -> None:
    structure = model.structure
    assert isinstance(structure, Structure)
    run = simulate(model, t_end=0.1, samples=3, arguments={"node_load": [[0.5, 0, -3]], "push": 2.0})
    assert run.node_load is not None
    np.testing.assert_allclose(run.node_load[:, 1], [[0.5, 0, -3]] * 3)
    found = compute_loads(structure, run)
    np.testing.assert_allclose(found, [[[0, 0, 0], [0.5, 0, -3], [0, 0, -2]]] * 3)
    run.write(tmp_path / "a.npz")
    again = read_trajectory(tmp_path / "a.npz", structure)
    np.testing.assert_allclose(compute_loads(structure, again), found)
    assert again.input_name == ("push",)
    stated = simulate(model, t_end=0.1, samples=2)
    np.testing.assert_allclose(compute_loads(structure, stated), [structure.node_load] * 2)


def test_a_schedule_changes_loads_in_time(model: CompiledModel) -> None:
    run = simulate(
        model, t_end=0.1, samples=3, schedule=lambda t: {"node_load": [[0, 0, -10 * t]], "push": 20 * t}
    )
    structure = model.structure
    assert isinstance(structure, Structure)
    found = compute_loads(structure, run)
    np.testing.assert_allclose(found[:, 1, 2], -10 * run.time, atol=1e-12)
    np.testing.assert_allclose(found[:, 2, 2], -20 * run.time, atol=1e-12)


def test_loads_of_an_equilibrium_are_those_of_its_search(model: CompiledModel) -> None:
    structure = model.structure
    assert isinstance(structure, Structure)
    np.testing.assert_allclose(
        compute_static_loads(structure, find_equilibrium(model)), structure.node_load, atol=0
    )
    found = find_equilibrium(model, arguments={"node_load": [[0, 0, -4]], "push": 3.0})
    loads = compute_static_loads(structure, found)
    np.testing.assert_allclose(loads, [[0, 0, 0], [0, 0, -4], [0, 0, -3]])
    # The tensions of the search balance these loads and the weight.
    weight = 0.5 * 9.81
    assert found.member_tension == pytest.approx([4 + 3 + 2 * weight, 3 + weight], rel=1e-6)


def test_a_damaged_array_of_loads_is_refused(model: CompiledModel, tmp_path: Path) -> None:
    from tensegrity_codegen.system.errors import SceneSyntaxError

    run = simulate(model, t_end=0.1, samples=3)
    run.write(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        data = {name: file[name] for name in file.files}
    assert isinstance(model.structure, Structure)
    for changed in ({"node_load": data["node_load"][:2]}, {"input": data["input"] * np.nan}):
        np.savez(tmp_path / "b.npz", **(data | changed))
        with pytest.raises(SceneSyntaxError):
            read_trajectory(tmp_path / "b.npz", model.structure)


def test_what_is_not_drawn_is_stated() -> None:
    assert describe_other_loads(load("prism")) == ""
    tower = load("svd_tower")  # its inputs are torques, which are zero in the scene
    assert describe_other_loads(tower) == ""
    turning = tower.with_changes(loads=(BodyLoad("torque", 1, (0.0, 0.0, 1.0), "inertial"),))
    assert "1 torque" in describe_other_loads(turning)
    motion = sway(load("prism"), 3)
    np.testing.assert_array_equal(compute_loads(load("prism"), motion), [load("prism").node_load] * 3)
