"""--input NAME=VALUE: constant values of inputs and actuators, on every verb that has it."""

from pathlib import Path

import numpy as np
import pytest

from tests.cases import thorough
from tests.cli.conftest import Run, write_example
from tests.cli.scenes import HANGING, write

# A mass of 1 kg on a string of 100 N/m and rest length 0.9 m.
ACTED = (
    HANGING
    + """
[[inputs]]
name = "push"
kind = "force"
nodes = ["b"]
direction = [0, 0, 1]

[[actuators]]
name = "winch"
members = ["s1"]
range = [0.7, 1.1]
"""
)
WEIGHT = 9.81


@pytest.fixture
def hanging(folder: Path) -> Path:
    return write(folder / "small.toml", ACTED)


@pytest.mark.parametrize(
    ("words", "winch", "push"),
    [*thorough(([], 0.0, 0.0), (["winch=0.1"], 0.1, 0.0)), (["winch = -0.15", "push=1.5"], -0.15, 1.5)],
)
def test_the_equilibrium_with_inputs(
    run: Run, hanging: Path, words: list[str], winch: float, push: float
) -> None:
    options = [part for word in words for part in ("--input", word)]
    ended = run("equilibrium", hanging, *options, "--json")
    data = ended.data
    assert ended.code == 0
    assert data["member_tension"]["s1"] == pytest.approx(WEIGHT - push, abs=1e-9)
    assert data["member_length"]["s1"] == pytest.approx(0.9 + winch + (WEIGHT - push) / 100, abs=1e-9)
    assert (
        data["inputs"] == {"winch": winch, "push": push} if push else data["inputs"] in ({}, {"winch": winch})
    )


@pytest.mark.thorough
def test_the_written_scene_is_in_equilibrium_without_the_input(run: Run, hanging: Path, folder: Path) -> None:
    found = run("equilibrium", hanging, "--input", "winch=0.1", "--out", folder / "new.toml", "--json").data
    again = run("equilibrium", folder / "new.toml", "--json").data
    assert again["displacement"] == pytest.approx(0.0, abs=1e-9)
    assert again["member_tension"]["s1"] == pytest.approx(found["member_tension"]["s1"])
    checked = run("check", folder / "new.toml", "--json").data
    assert checked["actuators"] == [{"name": "winch", "members": ["s1"], "range": [0.7, 1.1]}]
    assert "rest_length = 1.0," in (folder / "new.toml").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_energies_of_a_moved_structure_count_the_inputs(run: Run, folder: Path) -> None:
    near = write(folder / "near.toml", FREE)
    far = write(
        folder / "far.toml", FREE.replace("[0, 0, 0]", "[1e3, 0, 0]").replace("[0, 0, -1]", "[1e3, 0, -1]")
    )
    words = ("--input", "push=2", "--input", "winch=0.05", "--json")
    energies = [run("equilibrium", path, *words).data["energy"] for path in (near, far)]
    assert energies[1] == pytest.approx(energies[0], abs=1e-9)


FREE = ACTED.replace(
    "gravity = [0, 0, -9.81]", 'gravity = [0, 0, -9.81]\nmodel.formulation = "node_distance"'
)


def test_a_motion_with_inputs_starts_settled_and_stays(run: Run, hanging: Path, folder: Path) -> None:
    words = ("--t-end", "0.5", "--samples", "6", "--settle", "--input", "winch=0.05", "--input", "push=1")
    ended = run.good("simulate", hanging, *words, "--out", folder / "run.npz", "--json")
    assert ended.data["inputs"] == {"winch": 0.05, "push": 1.0}
    with np.load(folder / "run.npz") as saved:
        place = saved["node_position"][:, 1, 2]
        assert dict(zip(saved["input_name"], saved["input"][0], strict=True)) == {"push": 1.0, "winch": 0.05}
    np.testing.assert_allclose(place, -(0.95 + (WEIGHT - 1) / 100), atol=1e-9)


def test_every_motion_of_a_batch_has_the_inputs(run: Run, hanging: Path, folder: Path) -> None:
    np.savez(folder / "starts.npz", coordinate=[[0, 0, -0.9], [0, 0, -1.0]])
    words = ("--t-end", "0.2", "--samples", "3", "--input", "winch=0.05", "--json")
    single = []
    for height in (-0.9, -1.0):
        text = ACTED.replace("[0, 0, -1]", f"[0, 0, {height}]")
        run("simulate", write(folder / "one.toml", text), *words, "--out", folder / "one.npz", "--overwrite")
        with np.load(folder / "one.npz") as saved:
            single.append(saved["node_position"])
    ended = run.good(
        "simulate", hanging, *words, "--batch", folder / "starts.npz", "--out", folder / "all.npz"
    )
    assert ended.data["inputs"] == {"winch": 0.05}
    with np.load(folder / "all.npz") as saved:
        np.testing.assert_allclose(saved["node_position"], single, atol=1e-5)


@pytest.mark.parametrize("name", ["winch", "input"])
def test_an_input_of_the_option_and_of_the_batch(run: Run, hanging: Path, folder: Path, name: str) -> None:
    values = {"winch": [0.1, 0.2], "input": np.zeros((2, 2))}
    np.savez(folder / "starts.npz", **{name: values[name]})
    ended = run.refused(
        "simulate", hanging, "--t-end", 1, "--batch", folder / "starts.npz", "--input", "winch=0", "--json"
    )
    assert (ended.data["error"], ended.data["where"]) == ("DuplicateNameError", "--input")


def test_an_input_of_the_option_and_of_the_profile(run: Run, hanging: Path, folder: Path) -> None:
    table = write(folder / "table.csv", "time,winch\n0,0\n1,0.1\n")
    ended = run.refused("simulate", hanging, "--t-end", 1, "--profile", table, "--input", "winch=0", "--json")
    assert "winch" in str(ended.data)
    other = run("simulate", hanging, "--t-end", 1, "--profile", table, "--input", "push=1", "--json")
    assert other.code == 0


def test_linear_models_and_load_paths_with_inputs(run: Run, hanging: Path) -> None:
    data = run("linearize", hanging, "--settle", "--input", "winch=0.05", "--json").data
    assert data["inputs"] == {"push": 0.0, "winch": 0.05}
    # A pendulum of length 0.95 m + m g / k, and the spring: both frequencies in closed form.
    expected = np.sqrt([WEIGHT / (0.95 + WEIGHT / 100)] * 2 + [100.0]) / (2 * np.pi)
    np.testing.assert_allclose(data["natural_frequency"], expected, rtol=1e-9)
    words = ("--load", "b=0,0,-5", "--most", 1, "--input", "push=2", "--json")
    data = run("load-path", hanging, *words).data
    assert (data["status"], data["inputs"]) == ("completed", {"push": 2.0})
    assert data["smallest_eigenvalue"][0] == pytest.approx(
        (WEIGHT - 2) / (0.9 + (WEIGHT - 2) / 100), rel=1e-6
    )


@pytest.mark.thorough
def test_tendons_of_bodies_have_inputs(run: Run, folder: Path) -> None:
    path = write_example(folder, "lin_prism")
    with path.open("a", encoding="utf-8") as file:
        file.write('[[actuators]]\nname = "motor"\nmembers = ["side1"]\n')
    new = folder / "new.toml"
    found = run("equilibrium", path, "--input", "motor=0.02", "--out", new, "--json").data
    again = run("equilibrium", new, "--json").data
    for key in ("member_tension", "member_length"):
        assert again[key] == pytest.approx(found[key], abs=1e-7)


@pytest.mark.parametrize("verb", ["equilibrium", "simulate", "linearize", "load-path"])
@pytest.mark.parametrize(
    ("words", "error", "where"),
    [
        (["winsh=1"], "UnknownNameError", "--input"),
        (["winch"], "InvalidValueError", "--input"),
        (["=1"], "UnknownNameError", "--input"),
        (["winch=fast"], "InvalidValueError", "--input winch"),
        (["winch="], "InvalidValueError", "--input winch"),
        (["winch=1,2"], "InvalidValueError", "--input winch"),
        (["winch=nan"], "NonFiniteError", "--input winch"),
        (["winch=-inf"], "NonFiniteError", "--input winch"),
        (["winch=-0.9"], "InvalidValueError", "--input"),
        (["winch=0.1", "winch=0.1"], "DuplicateNameError", "--input"),
    ],
)
def test_wrong_inputs(run: Run, hanging: Path, verb: str, words: list[str], error: str, where: str) -> None:
    more = {"simulate": ["--t-end", 1], "load-path": ["--most", 1, "--load", "b=0,0,-1"]}.get(verb, [])
    options = [part for word in words for part in ("--input", word)]
    ended = run.refused(verb, hanging, *more, *options, "--json")
    assert (ended.data["error"], ended.data["where"]) == (error, where)


def test_a_scene_without_inputs(run: Run, folder: Path) -> None:
    ended = run.refused("equilibrium", write(folder / "small.toml", HANGING), "--input", "winch=1", "--json")
    assert ended.data["problem"] == "the scene has no inputs"


def test_a_value_outside_the_range_is_a_warning(run: Run, hanging: Path) -> None:
    ended = run.good("equilibrium", hanging, "--input", "winch=0.3", "--json")
    assert any(
        "1.2 m, is outside the range of actuator winch, 0.7 to 1.1 m" in text
        for text in ended.data["warnings"]
    )
