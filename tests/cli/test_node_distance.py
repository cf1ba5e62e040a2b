"""The verbs on a scene in node distances."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run


@pytest.fixture
def in_distances(prism: Path) -> Path:
    """The example prism in node distances of all pairs."""
    text = prism.read_text(encoding="utf-8")
    model = '[model]\nformulation = "node_distance"\noptions = { pairs = "full", order = "uvec123" }\n'
    text = re.sub(r"\[model\].*?integrators[^\n]*\n", model, text, flags=re.DOTALL)
    path = prism.with_name("distances.toml")
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.thorough
def test_simulate_gives_what_node_positions_give(run: Run, prism: Path, in_distances: Path) -> None:
    results = []
    for scene in (prism, in_distances):
        words = [
            "--t-end",
            0.05,
            "--samples",
            6,
            "--method",
            "rk4",
            "--step",
            1e-5,
            "--out",
            f"{scene.stem}.npz",
        ]
        assert run("simulate", scene, *words, "--json").data["status"] == "ok"
        with np.load(f"{scene.stem}.npz", allow_pickle=False) as file:
            results.append({name: file[name] for name in file.files})
    for name in ("node_position", "node_velocity", "member_tension", "total_energy"):
        scale = np.abs(results[0][name]).max()
        np.testing.assert_allclose(results[1][name], results[0][name], rtol=0, atol=1e-9 * scale)


@pytest.mark.thorough
def test_simulate_settles_first(run: Run, in_distances: Path) -> None:
    data = run("simulate", in_distances, "--t-end", 0.05, "--samples", 6, "--settle", "--json").data
    assert data["largest_kinetic_energy"] < 1e-15


def test_linearize_gives_the_frequencies_of_node_positions(run: Run, prism: Path, in_distances: Path) -> None:
    found = [run("linearize", scene, "--settle", "--json").data for scene in (prism, in_distances)]
    np.testing.assert_allclose(found[1]["natural_frequency"], found[0]["natural_frequency"], rtol=1e-6)
    assert found[1]["n_states"] == 88


def test_build_names_the_differences(run: Run, in_distances: Path) -> None:
    run.good("build", in_distances, "--out", "library", "--json")
    assert "b1_t1_x" in (Path("library") / "prism.h").read_text(encoding="utf-8")


def test_wrong_options_end_with_2(run: Run, in_distances: Path) -> None:
    in_distances.write_text(
        in_distances.read_text(encoding="utf-8").replace('"full"', '"every"'), encoding="utf-8"
    )
    ended = run.refused("check", in_distances, "--json")
    assert "connected, full" in ended.out + ended.err


@pytest.mark.thorough
def test_equilibria_are_found_in_node_positions(run: Run, prism: Path, in_distances: Path) -> None:
    found = [run("equilibrium", scene, "--json").data for scene in (prism, in_distances)]
    assert found[1]["status"] == "converged"
    assert found[1]["energy"] == pytest.approx(found[0]["energy"], rel=1e-12)
