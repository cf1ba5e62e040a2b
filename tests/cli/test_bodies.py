"""Scenes of bodies through the verbs of the command line."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.cli.conftest import Run, write_example


@pytest.fixture
def lin_prism(folder: Path) -> Path:
    return write_example(folder, "lin_prism")


def test_check_counts_bodies_and_tendons(run: Run, folder: Path) -> None:
    data = run("check", write_example(folder, "svd_tower"), "--json").data
    assert (data["n_bars"], data["n_cables"], data["n_coordinates"]) == (6, 18, 18)
    assert data["formulation"] == "bodies"
    assert data["inputs"] == ["M1", "M2", "M3", "F1", "F2", "F3"]
    assert data["warnings"] == []


def test_build_makes_a_library_with_the_names_of_points(run: Run, folder: Path, lin_prism: Path) -> None:
    data = run("build", lin_prism, "--out", "made", "--json").data
    assert data["functions"]["acceleration"] == "lin_prism_compute_acceleration"
    header = (folder / "made/lin_prism.h").read_text(encoding="utf-8")
    assert "LIN_PRISM_NODE_bar3_B = " in header
    assert "LIN_PRISM_COORDINATE_bar3_azimuth = " in header


def test_equilibrium_under_a_load_on_a_point(run: Run, lin_prism: Path) -> None:
    ended = run.good("equilibrium", lin_prism, "--load", "bar3_B=0,0,-10", "--out", "loaded.toml", "--json")
    assert 1e3 * (ended.data["member_length"]["side2"] - 0.336) == pytest.approx(11.4843, abs=1e-4)
    again = run("check", "loaded.toml", "--json").data
    assert again["n_coordinates"] == 6


def test_a_load_on_an_unknown_point_lists_the_close_one(run: Run, lin_prism: Path) -> None:
    ended = run.refused("equilibrium", lin_prism, "--load", "bar3_C=0,0,-10")
    assert "bar3_B" in ended.err


def test_simulation_linear_model_and_pictures(run: Run, folder: Path, lin_prism: Path) -> None:
    ended = run("simulate", lin_prism, "--t-end", "0.1", "--samples", "5", "--out", "run.npz", "--json")
    assert ended.data["status"] == "ok"
    with np.load(folder / "run.npz") as file:
        assert file["node_position"].shape == (5, 9, 3)
    linear = run("linearize", lin_prism, "--settle", "--json").data
    assert linear["state_name"][:2] == ["bar1_elevation", "bar1_azimuth"]
    assert len(linear["natural_frequency"]) == 6
    run.good("show", lin_prism, "--trajectory", "run.npz", "--out", "moved.png")
    assert (folder / "moved.png").stat().st_size > 10_000


# A ball on the ground, and a lamp that touches nothing.
LAMP = """\
name = "lamp"
gravity = [0, 0, -10]
[nodes]
hook = { position = [1, 0, 1], anchored = true }
[members]
cord = { kind = "cable", nodes = ["hook", "lamp.top"], spring_constant = 100, rest_length = 0.3, damping = 1 }
[bodies.ball]
kind = "rigid"
mass = 1
inertia = [0.001, 0.001, 0.001]
position = [0, 0, 0.049]
points = { middle = { position = [0, 0, 0], radius = 0.05 } }
[bodies.lamp]
kind = "rigid"
mass = 0.1
inertia = [0.001, 0.001, 0.001]
position = [1, 0, 0.6]
points = { top = [0, 0, 0.1] }
[ground]
stiffness = 1e4
contacts = ["ball.middle"]
"""


@pytest.mark.parametrize("words", ["simulate --t-end 0.01 --scene-out", "equilibrium --out"])
def test_written_scenes_keep_bodies_that_touch_nothing(run: Run, folder: Path, words: str) -> None:
    (folder / "lamp.toml").write_text(LAMP)
    verb, *options = words.split()
    run.good(verb, "lamp.toml", *options, "written.toml")
    run.good("check", "written.toml")
    first, again = (load_scene(name)[0].ground for name in ("lamp.toml", "written.toml"))
    assert first is not None
    assert again == first
