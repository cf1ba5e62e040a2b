"""`simulate --profile`: inputs over time from a table."""

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import HANGING, write

SCENE = (
    HANGING.replace("rest_length = 0.9", "rest_length = 0.9\ntension_only = false")
    + '\n[[inputs]]\nname = "motor"\nkind = "rest_length"\nmembers = ["s1"]\n'
)
WORDS = ["--t-end", 1, "--samples", 11]


@pytest.fixture
def scene(folder: Path) -> Path:
    return write(folder / "small.toml", SCENE)


def test_a_ramp_moves_the_mass_as_the_closed_form_says(run: Run, scene: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,0\n1,-0.2\n")
    words = ["--rtol", 1e-9, "--atol", 1e-11, "--profile", table, "--out", "a.npz", "--json"]
    ended = run("simulate", scene, *WORDS, *words)
    assert (ended.code, ended.data["status"]) == (0, "ok")
    with np.load("a.npz") as file:
        t, z, inputs = file["time"], file["node_position"][:, 1, 2], file["input"]
        assert file["input_name"].tolist() == ["motor"]
    np.testing.assert_allclose(inputs[:, 0], -0.2 * t, atol=1e-15)
    # 1 kg on 100 N/m: x = -z obeys x'' = 9.81 - 100 (x - 0.9 + 0.2 t), from rest at 1.
    rest = 0.9 + 0.0981
    x = rest - 0.2 * t + (1.0 - rest) * np.cos(10.0 * t) + 0.02 * np.sin(10.0 * t)
    np.testing.assert_allclose(-z, x, atol=1e-8)


def test_a_batch_takes_the_same_profile(run: Run, scene: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,0\n1,-0.2\n")
    np.savez(folder / "starts.npz", coordinate=np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.1]]))
    words = ["--method", "auto", "--rtol", 1e-8, "--atol", 1e-10, "--profile", table]
    one = run("simulate", scene, *WORDS, *words, "--out", "one.npz", "--json")
    many = run("simulate", scene, *WORDS, *words, "--batch", "starts.npz", "--out", "many.npz", "--json")
    assert (one.code, many.code) == (0, 0)
    with np.load("one.npz") as single, np.load("many.npz") as batch:
        np.testing.assert_allclose(batch["node_position"][0], single["node_position"], atol=1e-9)
        np.testing.assert_allclose(batch["member_tension"][0], single["member_tension"], atol=1e-6)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["pull.csv", "empty"]),
        ("time,moter\n0,0\n1,0\n", ["pull.csv: line 1", "unknown column", "did you mean 'motor'?"]),
        ("time,motor,motor\n0,0,0\n1,0,0\n", ["pull.csv: line 1", "twice"]),
        ("time,motor\n0,0\n0.5,x\n1,0\n", ["pull.csv: line 3, column motor", "not a number"]),
        ("time,motor\n0,0\n0.5,inf\n1,0\n", ["pull.csv: line 3, column motor", "not a finite number"]),
        ("time,motor\n0,0\n1,0\n0.5,0\n", ["pull.csv", "the time goes back"]),
        ("time,motor\n0.5,0\n1,0\n", ["pull.csv", "does not start at 0"]),
        ("time,motor\n0,0\n0.9,0\n", ["pull.csv", "ends before the motion", "0.9"]),
    ],
)
def test_a_bad_profile_ends_with_2(run: Run, scene: Path, folder: Path, text: str, parts: list[str]) -> None:
    table = write(folder / "pull.csv", text)
    ended = run.refused("simulate", scene, *WORDS, "--profile", table, "--out", "a.npz")
    for part in parts:
        assert part in ended.err
    assert not (folder / "a.npz").exists()


def test_a_scene_without_inputs_and_an_unknown_kind(run: Run, two_nodes: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,0\n1,0\n")
    ended = run.refused("simulate", two_nodes, *WORDS, "--profile", table)
    assert "has no inputs" in ended.err
    ended = run.refused("simulate", two_nodes, *WORDS, "--profile-kind", "cubik")
    assert "linear, cubic" in ended.err


def test_an_input_with_a_constant_value_too_is_refused(run: Run, scene: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,0\n1,0\n")
    ended = run.refused(
        "simulate", scene, *WORDS, "--profile", table, "--input", "motor=0.1", "--out", "a.npz"
    )
    assert "pull.csv: an input has a profile and a constant value" in ended.err
    assert not (folder / "a.npz").exists()


def test_a_settled_start_has_the_first_values_of_the_profile(run: Run, scene: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,-0.3\n1,-0.3\n")
    run.good("simulate", scene, *WORDS, "--settle", "--profile", table, "--out", "a.npz")
    with np.load("a.npz") as file:
        np.testing.assert_allclose(file["node_position"][:, 1, 2], -(0.9 - 0.3 + 0.0981), atol=1e-7)


def test_until_sees_the_inputs_of_the_profile(run: Run, scene: Path, folder: Path) -> None:
    table = write(folder / "pull.csv", "time,motor\n0,0\n1,-0.5\n")
    words = ["--profile", table, "--until", 'member_tension["s1"] > 14', "--rtol", 1e-9, "--json"]
    ended = run.good("simulate", scene, *WORDS, *words, "--out", "a.npz")
    assert ended.data["events"][0]["kind"] == "condition"
    with np.load("a.npz") as file:
        assert file["member_tension"][-1, 0] == pytest.approx(14.0, abs=1e-5)
        assert file["member_tension"][-1, 0] > file["member_tension"][-2, 0]


ACTUATOR = '\n[[actuators]]\nname = "motor"\nmembers = "s1"\nrange = [0.8, 1.0]\nrate = 0.3\n'


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("0,0\n1,-0.05\n", []),
        ("0,0\n1,-0.2\n", ["rest length of s1 to 0.7 m", "0.8 to 1 m"]),
        ("0,0\n0.1,-0.05\n1,-0.05\n", ["at 0.5 m/s", "its rate, 0.3 m/s"]),
        ("0,0\n0.5,0\n0.5,0.05\n1,0.05\n", ["jumps"]),
        ("0,0\n1,0.2\n", ["rest length of s1 to 1.1 m"]),
    ],
    ids=["within", "short", "fast", "jump", "long"],
)
def test_a_profile_beyond_an_actuator_is_a_warning(
    table: str, words: list[str], run: Run, folder: Path
) -> None:
    path = write(folder / "small.toml", SCENE.split("\n[[inputs]]")[0] + ACTUATOR)
    profile = write(folder / "pull.csv", "time,motor\n" + table)
    ended = run.good("simulate", path, *WORDS, "--profile", profile, "--json")
    found = [text for text in ended.data.get("warnings", ()) if "profile of motor" in text]
    assert len(found) == bool(words)
    assert all(word in found[0] for word in words)


def test_a_cubic_profile_is_compared_between_its_knots(run: Run, folder: Path) -> None:
    """The parabola through (0, 0), (0.5, 0.1), (1, 0.05) rises above its knots."""
    path = write(folder / "small.toml", SCENE.split("\n[[inputs]]")[0] + ACTUATOR.replace("1.0]", "1.001]"))
    profile = write(folder / "pull.csv", "time,motor\n0,0\n0.5,0.1\n1,0.05\n")
    words = [*WORDS, "--profile", profile, "--json", "--profile-kind"]
    linear, cubic = run("simulate", path, *words, "linear"), run("simulate", path, *words, "cubic")
    assert not any("outside its range" in text for text in linear.data.get("warnings", ()))
    assert any("outside its range" in text for text in cubic.data["warnings"])
