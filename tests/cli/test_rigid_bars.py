"""What each verb does with a scene of rigid bars, which takes the formulation `rigid_bar` by itself."""

import json
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium
from tests.cli.conftest import Run
from tests.cli.scenes import GOOD, write

# A mass under a rigid bar, that swings.
PENDULUM = GOOD.replace('name = "small"', 'name = "small"\ngravity = [0, 0, -9.81]').replace(
    's1 = { class = "string", nodes = ["a", "b"] }', 'r1 = { kind = "bar", nodes = ["a", "b"] }'
)


@pytest.fixture
def pendulum(folder: Path) -> str:
    return write(folder / "pendulum.toml", PENDULUM).name


def test_check_warns_of_nothing(run: Run, pendulum: str) -> None:
    assert run("check", pendulum, "--json").data["warnings"] == []


def test_build_makes_a_library_with_multipliers(run: Run, pendulum: str) -> None:
    ended = run.good("build", pendulum, "--quantity", "multiplier", "--json")
    assert list(ended.data["functions"]) == ["multiplier"]


def test_simulate_keeps_the_length_of_the_bar(run: Run, folder: Path) -> None:
    moving = PENDULUM.replace("mass = 1.0", "mass = 1.0, velocity = [1, 0, 0]")
    path = write(folder / "pendulum.toml", moving)
    ended = run.good("simulate", path.name, "--t-end", 1, "--out", "a.npz", "--json")
    assert ended.data["why_method"].startswith("1 rigid bar (class 1, one multiplier each); ")
    with np.load(folder / "a.npz") as motion:
        length = np.linalg.norm(motion["node_position"][:, 1] - motion["node_position"][:, 0], axis=1)
    assert np.abs(length - 1.0).max() < 1e-14


def test_equilibrium_finds_tensions_of_rigid_bars(run: Run, pendulum: str) -> None:
    """A mass of 1 kg, drawn aside by its own weight, hangs at 45 degrees."""
    ended = run.good("equilibrium", pendulum, "--load", "b=9.81,0,0", "--out", "settled.toml", "--json")
    found = ended.data
    assert found["status"] == "converged"
    half = np.sqrt(0.5)
    np.testing.assert_allclose(found["node_position"]["b"], [half, 0, -half], atol=1e-9)
    assert found["member_length"]["r1"] == pytest.approx(1.0, abs=1e-15)
    assert found["member_tension"]["r1"] == pytest.approx(9.81 / half, rel=1e-12)
    assert found["smallest_eigenvalue"] == pytest.approx(9.81 / half, rel=1e-12)
    run.good("check", "settled.toml", "--json")


def test_load_path_follows_the_bar_as_it_turns(run: Run, pendulum: str, folder: Path) -> None:
    """A mass drawn aside by 2 m g hangs at arctan 2; t = m g / cos."""
    ended = run.good(
        "load-path", pendulum, "--load", "b=9.81,0,0", "--most", 2, "--out", "path.json", "--json"
    )
    assert ended.data["status"] == "completed"
    assert ended.data["smallest_eigenvalue_end"] == pytest.approx(9.81 * np.sqrt(5), rel=1e-9)
    points = json.loads((folder / "path.json").read_text())["points"]
    assert points["tension_r1"][-1] == pytest.approx(9.81 * np.sqrt(5), rel=1e-9)
    assert points["length_r1"][-1] == pytest.approx(1.0, abs=1e-9)


def test_linearize_tells_the_frequencies_of_what_the_bars_allow(
    run: Run, pendulum: str, folder: Path
) -> None:
    ended = run.good("linearize", pendulum, "--settle", "--out", "linear.npz", "--json")
    assert (ended.data["n_states"], ended.data["n_variations"]) == (6, 4)
    swing = np.sqrt(9.81) / (2 * np.pi)
    assert ended.data["natural_frequency"] == pytest.approx([swing, swing], rel=1e-12)
    with np.load(folder / "linear.npz") as linear:
        assert tuple(linear["variation_shape"]) == (6, 4)


def test_linearize_takes_bars_that_follow_their_tension_for_springs(
    run: Run, prism: Path, folder: Path
) -> None:
    words = '[model]\nformulation = "rigid_bar"\noptions = { bars = "all", correction = "first_order" }'
    text = prism.read_text(encoding="utf-8")
    head, tail = text.split("quantities = [")[0], text.split("integrators =")[1]
    corrected = (head + "integrators =" + tail).replace("[model]", words, 1)
    path = write(folder / "corrected.toml", corrected)
    found = run("linearize", path.name, "--settle", "--json").data
    springs = run("linearize", prism, "--settle", "--json").data
    assert found["natural_frequency"] == pytest.approx(springs["natural_frequency"], rel=1e-6)


def test_bars_that_repeat_each_other_are_refused_by_check_too(run: Run, folder: Path) -> None:
    anchor = "c = { position = [1, 0, 0], anchored = true }"
    bar = 'r2 = { kind = "bar", nodes = ["a", "c"] }'
    path = write(folder / "pendulum.toml", PENDULUM.replace("\n[members]", f"{anchor}\n\n[members]\n{bar}"))
    for verb in ("check", "equilibrium"):
        ended = run.refused(verb, path.name, "--json")
        assert ended.data["error"] == "FormulationError"
        assert "r2" in ended.data["given"]


def test_without_masses_there_is_statics(run: Run, folder: Path) -> None:
    path = write(folder / "pendulum.toml", PENDULUM.replace(", mass = 1.0", ""))
    assert "spring_tension" in run("build", path.name, "--json").data["functions"]
    found = run("equilibrium", path.name, "--load", "b=0,0,-2", "--json").data
    assert found["member_tension"]["r1"] == pytest.approx(2.0, rel=1e-14)
    assert run("simulate", path.name, "--t-end", 1, "--json").data["error"] == "FormulationError"


def test_python_takes_the_quantities_that_the_readme_names(pendulum: str) -> None:
    found = find_equilibrium(compile_scene(pendulum, for_="equilibrium"))
    assert found.member_tension[0] == pytest.approx(9.81, rel=1e-14)
