"""The verb analyse."""

import math
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import read_example
from tests.cli.conftest import Run
from tests.cli.scenes import FRAME, GOOD, HANGING, write

PRISM = """\
name = "prism9"

[classes.bar]
kind = "bar"
spring_constant = 1e6
radius = 0.005

[classes.cable]
kind = "cable"
spring_constant = 1000

[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
height = 0.30
"""
TWISTED = PRISM + "twist = 160\n"


def test_a_prism_with_a_prestress(run: Run, folder: Path) -> None:
    """Without masses: everything but natural frequencies."""
    path = write(folder / "prism9.toml", PRISM + "prestress = 20\n")
    ended = run.good("analyse", path, "--json", "--out", "a.npz")
    data = ended.data
    assert data["status"] == "stable"
    assert (data["rank"]["rank"], data["rank"]["largest_rank"]) == (11, 12)
    assert (data["n_selfstress"], data["n_rigid_motions"], data["n_mechanisms"]) == (1, 6, 1)
    assert data["rank"]["gap"] > 1e9
    assert data["prestress"]["is_found"]
    assert data["prestress"]["tension"]["bar1"] == pytest.approx(-1.0)
    assert data["certificate"] is None
    assert data["is_balanced"]
    assert data["smallest_eigenvalue"] > 0
    assert data["modes"] is None
    assert "no mass" in data["modes_note"]
    assert data["limits"]["worst"] is None
    with np.load("a.npz", allow_pickle=False) as file:
        assert file["selfstress"].shape == (1, 12)
        assert file["mechanism"].shape == (6, 3, 1)
        assert file["member_name"].tolist()[:2] == ["bar1", "bar2"]
        assert "frequency" not in file


def test_a_twist_without_prestress_ends_with_a_proof(run: Run, folder: Path) -> None:
    """All nine cables shorten equally; anyone can check it from displacements and positions."""
    path = write(folder / "prism9.toml", TWISTED)
    ended = run("analyse", path, "--json", "--out", "a.npz")
    assert ended.code == 3
    data = ended.data
    assert data["status"] == "infeasible"
    proof = data["certificate"]
    assert proof["is_verified"]
    assert len(proof["shortening"]) == 9
    assert proof["least_shortening"] == pytest.approx(1.0, abs=1e-9)
    assert proof["largest_bar_change"] < 1e-9
    with np.load("a.npz", allow_pickle=False) as file:
        place = dict(zip(file["node_name"].tolist(), file["node_position"], strict=True))
    motion = {name: np.array(value) for name, value in proof["displacement"].items()}
    for kind, first, second, change in (("bar", "b1", "t1", 0.0), ("vertical", "b1", "t3", -1.0)):
        vector = place[first] - place[second]
        unit = vector / np.linalg.norm(vector)
        assert unit @ (motion[first] - motion[second]) == pytest.approx(change, abs=1e-9), kind
    text = run("analyse", path, "--page", "a.html").out
    assert "Why no self-stress keeps every cable in tension" in (folder / "a.html").read_text(
        encoding="utf-8"
    )
    assert "proof that no self-stress tightens all cables" in " ".join(text.split())
    assert "infeasible: no self-stress has every cable in tension" in " ".join(text.split())


@pytest.mark.thorough
def test_limits_and_inputs(run: Run, folder: Path) -> None:
    """Two motors let the prism of 12 cables go; the present forces are then out of balance."""
    path = write(folder / "prism12.toml", read_example("prism12"))
    data = run("analyse", path, "--json").data
    assert data["status"] == "stable"
    assert data["is_balanced"]
    assert data["limits"]["is_met"]
    assert data["limits"]["worst"]["limit"] == "least_tension"
    assert data["limits"]["least_bar_distance"] > 0.002
    assert len(data["modes"]["frequency"]) == 10
    loose = run("analyse", path, "--input", "v1=0.02", "--input", "v2=0.02", "--json").data
    assert not loose["is_balanced"]
    assert not loose["limits"]["is_met"]
    assert {item["member"] for item in loose["limits"]["exceeded"]} == {"vertical1", "vertical2"}
    assert any("vertical" in text and "allowed is at least 1 N" in text for text in loose["warnings"])
    settled = run("analyse", path, "--input", "v1=0.005", "--settle", "--json").data
    assert settled["is_balanced"]
    assert settled["status"] == "stable"


def test_a_hanging_mass_at_its_equilibrium(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("analyse", path, "--settle", "--json").data
    assert data["status"] == "stable"
    assert data["load_prestress"]["tension"]["s1"] == pytest.approx(9.81)
    pendulum = math.sqrt(9.81 / 0.9981) / (2 * math.pi)
    assert data["modes"]["frequency"] == pytest.approx([pendulum, pendulum, 10 / (2 * math.pi)], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "where"),
    [
        (("--rank-tolerance", "2"), "--rank-tolerance"),
        (("--rank-tolerance", "nan"), "--rank-tolerance"),
        (("--modes", "-1"), "--modes"),
        (("--out", "a.txt"), "a.txt"),
        (("--out", "missing/a.npz"), "missing/a.npz"),
        (("--page", "a.png"), "a.png"),
        (("--input", "m=1"), "--input"),
    ],
)
def test_bad_options(run: Run, folder: Path, options, where) -> None:
    path = write(folder / "small.toml", GOOD)
    ended = run.refused("analyse", path, "--json", *options)
    assert where in ended.data["where"]
    assert sorted(item.name for item in folder.iterdir()) == ["small.toml"]


@pytest.mark.thorough
def test_a_scene_in_node_distances_far_away(run: Run, folder: Path) -> None:
    """It is analysed in node positions, near the origin; positions are those of the scene."""
    text = read_example("planar").replace("[model]\n", '[model]\nformulation = "node_distance"\n')
    text = text.replace("position = [0,", "position = [1000,").replace(
        "position = [0.6,", "position = [1000.6,"
    )
    path = write(folder / "planar.toml", text)
    ended = run.good("analyse", path, "--json", "--out", "a.npz")
    assert (ended.data["rank"]["rank"], ended.data["n_selfstress"]) == (5, 1)
    with np.load("a.npz", allow_pickle=False) as file:
        assert file["node_position"][:, 0].min() == pytest.approx(1000.0)


def test_on_the_ground_it_analyses_the_equilibrium(run: Run, folder: Path) -> None:
    """With the frequencies of the linear model; a prestress that feet hold is not written."""
    path = write(folder / "frame.toml", FRAME.replace("[0, -9.81]", "[1, -9.81]"))
    data = run.good("analyse", path, "--settle", "--json").data
    assert (data["status"], data["n_rigid_motions"], data["n_mechanisms"]) == ("stable", 0, 0)
    assert data["is_balanced"]
    assert run("analyse", path, "--prestress", 10, "--scene-out", "b.toml").code == 2
