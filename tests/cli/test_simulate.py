import re
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.model import library
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.structure.ground import ENERGY_STATES
from tensegrity_codegen.structure.structure import Structure
from tests.cli.conftest import Run
from tests.cli.scenes import FRAME, GOOD, HANGING, write
from tests.models import ROOT

SCIPY_METHODS = ("scipy_dop853", "scipy_rk45", "scipy_lsoda", "scipy_radau")


def test_the_result_file_holds_what_it_must(run: Run, prism: Path) -> None:
    words = ["--t-end", 0.02, "--samples", 5, "--rtol", 1e-5, "--atol", 1e-8, "--out", "prism.npz"]
    ended = run.good("simulate", prism, *words, "--json")
    structure, _ = load_scene(prism)
    with np.load("prism.npz", allow_pickle=False) as file:
        data = {name: file[name] for name in file.files}
    assert data["time"].tolist() == pytest.approx([0.0, 0.005, 0.01, 0.015, 0.02])
    assert data["node_position"].shape == data["node_velocity"].shape == (5, 6, 3)
    assert data["member_tension"].shape == (5, 12)
    assert tuple(data["node_name"].tolist()) == structure.node_name
    assert tuple(data["member_name"].tolist()) == structure.member_name
    assert str(data["status"]) == ended.data["status"] == "ok"
    np.testing.assert_array_equal(data["node_position"][0], structure.node_position)
    np.testing.assert_array_equal(data["node_velocity"][0], structure.node_velocity)
    assert all(np.isfinite(value).all() for value in data.values() if value.dtype.kind == "f")
    assert ended.data["n_samples"] == 5
    assert ended.data["t_end"] == 0.02
    assert ended.data["energy_drift"] < 1e-6


def test_json_says_how_far_a_run_came_and_was_to_come(run: Run, prism: Path) -> None:
    words = ["--t-end", 5.0, "--max-steps", 40, "--control", "steps", "--method", "rk853", "--json"]
    ended = run("simulate", prism, *words)
    assert (ended.code, ended.data["status"]) == (3, "not_converged")
    assert ended.data["t_asked"] == 5.0
    assert 0.0 <= ended.data["t_end"] <= ended.data["t_stopped"] < 5.0
    assert f"stopped at t = {ended.data['t_stopped']:.6g} s" in ended.data["message"]
    whole = run.good("simulate", prism, "--t-end", 0.02, "--json").data
    assert (whole["t_asked"], whole["t_end"], whole["t_stopped"]) == (0.02, 0.02, None)


def test_a_motion_is_written_as_a_scene_where_it_ends(run: Run, folder: Path, two_nodes: Path) -> None:
    """The second half of a motion from there is that of the whole one; inputs are in the rest lengths."""
    winch = '\n[[actuators]]\nname = "winch"\nmembers = "cord"\n'
    path = write(folder / "winch.toml", two_nodes.read_text() + winch)
    words = ("simulate", path, "--samples", 3, "--rtol", 1e-9, "--input", "winch=-0.02")
    run.good(*words, "--t-end", 1.0, "--out", "whole.npz")
    ended = run.good(*words, "--t-end", 0.5, "--scene-out", "half.toml")
    assert "internal" not in ended.err
    whole, half = np.load("whole.npz"), load_scene("half.toml")[0]
    speed = np.linalg.norm(whole["node_velocity"][1], axis=1).max()
    assert f"begins in motion, with up to {speed:.3g} m/s of a node: a longer --t-end" in ended.err
    assert isinstance(half, Structure)
    np.testing.assert_allclose(half.node_position, whole["node_position"][1], atol=1e-8)
    np.testing.assert_allclose(half.node_velocity, whole["node_velocity"][1], atol=1e-7)
    assert half.rest_length[0] == pytest.approx(load_scene(path)[0].rest_length[0] - 0.02, abs=1e-15)
    run.good("simulate", "half.toml", "--samples", 3, "--rtol", 1e-9, "--t-end", 0.5, "--out", "rest.npz")
    np.testing.assert_allclose(
        np.load("rest.npz")["node_position"][-1], whole["node_position"][-1], atol=1e-7
    )
    refused = run("simulate", path, "--t-end", 0.5, "--scene-out", "half.npz")
    assert refused.code == 2
    assert "half.npz" in refused.err


def test_a_file_is_not_needed(run: Run, folder: Path, two_nodes: Path) -> None:
    data = run("simulate", two_nodes, "--t-end", 0.1, "--json").data
    assert data["out"] is None
    assert data["n_samples"] == 101
    assert list(folder.iterdir()) == [two_nodes]


def test_everything_may_differ_from_the_default(run: Run, two_nodes: Path) -> None:
    words = ["--t-end", 0.5, "--samples", 3, "--method", "rk4", "--step", 1e-3, "--flags", "native"]
    ended = run.good("simulate", two_nodes, *words, "-o", "a.npz", "--json")
    assert ended.data["method"] == "rk4"
    assert ended.data["n_steps"] == 500
    assert ended.data["step"] == pytest.approx(1e-3)
    with np.load("a.npz") as file:
        assert file["time"].tolist() == pytest.approx([0.0, 0.25, 0.5])


def test_a_mass_on_a_spring_swings_as_it_must(run: Run, folder: Path) -> None:
    path = write(
        folder / "small.toml", HANGING.replace("rest_length = 0.9", "rest_length = 0.9\ntension_only = false")
    )
    run("simulate", path, "--t-end", 1, "--samples", 41, "--rtol", 1e-10, "--atol", 1e-12, "--out", "a.npz")
    with np.load("a.npz") as file:
        found, when = file["node_position"][:, 1, 2], file["time"]
        tension = file["member_tension"][:, 0]
    rest = -0.9 - 0.0981
    np.testing.assert_allclose(found, rest + (-1 - rest) * np.cos(10 * when), rtol=1e-8)
    np.testing.assert_allclose(tension, 100 * (-found - 0.9), rtol=1e-9)


@pytest.mark.parametrize("method", SCIPY_METHODS)
def test_scipy_finds_the_same(method: str, run: Run, two_nodes: Path) -> None:
    same = ["--t-end", 0.3, "--samples", 4, "--rtol", 1e-8, "--atol", 1e-10]
    run("simulate", two_nodes, *same, "--out", "a.npz")
    ended = run.good("simulate", two_nodes, *same, "--method", method, "--out", "b.npz", "--json")
    assert ended.err == ""
    with np.load("a.npz") as ours, np.load("b.npz") as theirs:
        np.testing.assert_allclose(ours["node_position"], theirs["node_position"], atol=1e-5)


def test_a_step_too_large_ends_with_3_and_keeps_what_it_reached(run: Run, prism: Path) -> None:
    words = ["--t-end", 1, "--method", "rk4", "--step", 0.01, "--out", "a.npz"]
    ended = run("simulate", prism, *words, "--json")
    assert ended.code == 3
    assert ended.data["status"] == "unstable"
    assert "smaller step" in ended.data["message"]
    with np.load("a.npz") as file:
        assert str(file["status"]) == "unstable"
        assert 1 < len(file["time"]) < 101
        assert len(file["time"]) == len(file["member_tension"]) == ended.data["n_samples"]
        assert np.isfinite(file["node_position"]).all()


def test_a_step_slightly_too_large_is_noticed_by_its_energy(run: Run, prism: Path) -> None:
    ended = run("simulate", prism, "--t-end", 0.05, "--method", "rk4", "--step", 0.0015, "--json")
    assert ended.code == 3
    assert ended.data["status"] in ("unstable", "inaccurate")


def test_a_tolerance_below_rounding_ends_with_3_in_time(run: Run, prism: Path) -> None:
    words = ["--t-end", 0.02, "--rtol", 1e-16, "--atol", 1e-300, "--out", "a.npz"]
    ended = run("simulate", prism, *words, "--json")
    assert ended.code == 3
    assert ended.data["status"] == "not_converged"
    assert "--rtol" in ended.data["message"]
    assert "rounding error" in ended.data["message"]
    with np.load("a.npz") as file:
        assert str(file["status"]) == "not_converged"


def test_a_time_out_of_reach_ends_with_3_at_once(run: Run, prism: Path) -> None:
    ended = run("simulate", prism, "--t-end", 1e9, "--json")
    assert ended.code == 3
    assert ended.data["status"] == "not_converged"
    assert ended.data["n_samples"] == 1


@pytest.mark.parametrize(
    ("words", "where"),
    [
        (["--t-end", "0"], "--t-end"),
        (["--t-end", "-1"], "--t-end"),
        (["--t-end", "nan"], "--t-end"),
        (["--t-end", "inf"], "--t-end"),
        (["--t-end", "1", "--samples", "1"], "--samples"),
        (["--t-end", "1", "--samples", "-5"], "--samples"),
        (["--t-end", "1", "--samples", "1000000000000"], "--samples"),
        (["--t-end", "1", "--rtol", "0"], "--rtol"),
        (["--t-end", "1", "--rtol", "nan"], "--rtol"),
        (["--t-end", "1", "--atol", "-1"], "--atol"),
        (["--t-end", "1", "--method", "rk5"], "--method"),
        (["--t-end", "1", "--method", "rk4"], "--step"),
        (["--t-end", "1", "--method", "rk4", "--step", "0"], "--step"),
        (["--t-end", "1", "--method", "rk4", "--step", "nan"], "--step"),
        (["--t-end", "1e300", "--method", "rk4", "--step", "1e-320"], "--step"),
        (["--t-end", "1", "--step", "0.1"], "--step"),
        (["--t-end", "1", "--method", "scipy_rk45", "--rtol", "1e-16"], "--rtol"),
    ],
)
def test_an_option_out_of_range_is_refused(words: list[str], where: str, run: Run, two_nodes: Path) -> None:
    ended = run.refused("simulate", two_nodes, *words, "--out", "a.npz", "--json")
    assert ended.data["where"] == where
    assert ended.data["allowed"] or ended.data["hint"]
    assert not Path("a.npz").exists()


@pytest.mark.parametrize("out", ["missing/a.npz", "there", "file/a.npz", ""])
def test_a_result_without_a_place_is_refused_before_the_run(
    out: str, run: Run, folder: Path, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "there").mkdir()
    (folder / "file").write_text("", encoding="utf-8")
    monkeypatch.setattr(
        "tensegrity_codegen.pipeline.compile_scene.build_library", lambda *_, **__: pytest.fail("was built")
    )
    before = sorted(folder.rglob("*"))
    ended = run.refused("simulate", two_nodes, "--t-end", 1, "--out", out, "--json")
    assert ended.data["error"] == "OutputError"
    assert sorted(folder.rglob("*")) == before


def test_a_library_of_another_interface_is_refused(
    run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = run("simulate", two_nodes, "--t-end", 0.1, "--json").data["library"]
    monkeypatch.setattr(library, "ABI_VERSION", 999)
    ended = run.refused("simulate", two_nodes, "--t-end", 0.1, "--out", "a.npz", "--json")
    assert ended.data["error"] == "AbiMismatchError"
    assert ended.data["where"] == built
    assert ended.data["allowed"] == "999"
    assert not Path("a.npz").exists()


def test_it_may_start_from_the_equilibrium(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("simulate", path, "--t-end", 0.5, "--settle", "--json").data
    assert data["status"] == "ok"
    assert data["largest_kinetic_energy"] < 1e-15


def test_a_start_without_equilibrium_ends_with_3(run: Run, folder: Path) -> None:
    text = HANGING.replace("anchored = true", 'anchored = "xy", mass = 1.0')
    path = write(folder / "small.toml", text)
    ended = run("simulate", path, "--t-end", 0.5, "--settle", "--json")
    assert ended.code == 3
    assert ended.data["error"] == "ConvergenceError"
    assert ended.data["evidence"]["status"] == "no_equilibrium"


def test_a_node_without_mass_cannot_move_and_is_named(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", GOOD.replace(", mass = 1.0", ""))
    ended = run.refused("simulate", path, "--t-end", 0.5, "--json")
    assert ended.data["error"] == "FormulationError"
    assert ended.data["where"] == f"{path}: nodes.b.mass"


def test_the_first_events_are_listed_with_their_members(run: Run, folder: Path) -> None:
    """A mass that is thrown up on a string: the string goes slack."""
    text = HANGING.replace("mass = 1.0", "mass = 1.0, velocity = [0, 0, 3]")
    ended = run.good("simulate", write(folder / "small.toml", text), "--t-end", 0.3, "--method", "rk54")
    assert re.search(r"^events: 0\.0\d+ s s1 slack", ended.out, re.MULTILINE)


def test_samples_that_do_not_show_single_contacts_are_warned_of(run: Run, folder: Path) -> None:
    """1 kg on 1e4 N/m vibrates at 15.92 Hz, half a period is 0.0314 s."""
    path = write(folder / "small.toml", HANGING + "\n[ground]\noffset = -3\nstiffness = 1e4\n")
    words = ["simulate", path, "--t-end", 0.32, "--json", "--samples"]
    assert "samples are 0.032 s apart" in run.good(*words, 11).err
    assert "single contacts" not in run.good(*words, 12).err


def test_on_the_ground_a_settled_motion_stays_at_rest(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME.replace("[0, -9.81]", "[1, -9.81]"))
    data = run.good("simulate", path, "--settle", "--t-end", 1, "--out", "a.npz", "--json").data
    assert data["inputs"] == {}
    with np.load("a.npz", allow_pickle=False) as file:
        assert np.abs(file["node_velocity"]).max() < 1e-12
        assert file["internal"][0].sum() == pytest.approx(3e-5, rel=1e-9)  # 3 kg 1 m/s2 / kt


SLIDING = """name = "block"
gravity = [0, 0, -9.81]
[nodes.a]
position = [0, 0, -5e-4]
mass = 1
[nodes.b]
position = [0, 0, 1]
anchored = true
[members.cord]
kind = "cable"
nodes = ["a", "b"]
rest_length = 100
spring_constant = 1
[ground]
slope_deg = 30
stiffness = STIFFNESS
stick_damping = DAMPING
dissipation = 0.5
friction = 0.3
"""


def test_the_ground_check_compares_with_a_motion_on_a_ground_of_four_times_the_stiffness(
    run: Run, folder: Path
) -> None:
    ends = []
    for name, stiffness, damping in (("soft", 1e4, 50.0), ("stiff", 4e4, 100.0)):
        text = SLIDING.replace("STIFFNESS", f"{stiffness}").replace("DAMPING", f"{damping}")
        run("simulate", write(folder / f"{name}.toml", text), "--t-end", 0.5, "--out", f"{name}.npz")
        with np.load(folder / f"{name}.npz") as file:
            ends.append(file["node_position"])
    apart = np.linalg.norm(ends[0] - ends[1], axis=2)[:, 0]
    data = run("simulate", folder / "soft.toml", "--t-end", 0.5, "--ground-check", "--json").data
    found = data["ground_check"]
    assert (found["node"], found["status"], found["stiffness_factor"]) == ("a", "ok", 4.0)
    assert found["largest_change"] == pytest.approx(apart.max(), rel=1e-12)
    assert found["change_at_end"] == pytest.approx(apart[-1], rel=1e-12)
    assert found["largest_change"] > 1e-4


def test_motions_on_the_ground_tell_where_their_energy_goes(run: Run, folder: Path) -> None:
    scene, out = ROOT / "docs/gallery/superball_drop.toml", folder / "drop.npz"
    data = run.good("simulate", scene, "--t-end", 0.6, "--samples", 13, "--out", out, "--json").data
    assert data["energy_drift"] < 1e-6
    change = data["total_energy_end"] - data["total_energy_start"]
    work = {name: data[name] for name in ENERGY_STATES}
    assert sum(work.values()) == pytest.approx(change, rel=1e-6)
    assert work["friction_work"] < 0.0
    structure = load_scene(scene)[0]
    assert isinstance(structure, Structure)
    assert read_trajectory(out, structure).work == pytest.approx(work)
    assert "work of friction" in run.good("simulate", scene, "--t-end", 0.1).out


def test_a_ground_check_without_a_ground_is_refused(run: Run, two_nodes: Path) -> None:
    ended = run.refused("simulate", two_nodes, "--t-end", 0.1, "--ground-check", "--json")
    assert ended.data["where"] == "--ground-check: ground"
