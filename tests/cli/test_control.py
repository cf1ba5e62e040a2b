"""The verb `control`: a motion held under disturbances, files, JSON, exit codes, wrong input."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.scene_case import SceneCase
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.control.feedback import time_motion as motions
from tensegrity_codegen.control.feedback.study.read_files import read_weights
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.system.errors import SceneSyntaxError
from tests.cases import thorough
from tests.cli.conftest import Run

TWIST = 'twist("bar*_B", "base_*")=157'
LIFT = (
    'axes = "z"\n'
    + list_examples()["two_nodes"]
    + '\n[[actuators]]\nname = "winch"\nmembers = "cord"\nrate = 1.0\n'
)
SENSOR = '[[sensors]]\nkind = "member_length"\nmembers = "cord"\nnoise = 1e-4\n'


@pytest.fixture
def pinned(folder: Path) -> Path:
    path = folder / "pinned_prism.toml"
    path.write_text(list_examples()["pinned_prism"], encoding="utf-8")
    return path


@pytest.fixture
def lift(folder: Path) -> Path:
    path = folder / "lift.toml"
    path.write_text(LIFT + SENSOR, encoding="utf-8")
    return path


def change(path: Path, *pairs: tuple[str, str]) -> None:
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")


@pytest.mark.thorough
def test_a_motion_is_planned_held_and_written(run: Run, folder: Path, pinned: Path) -> None:
    words = ("control", pinned, "--to", TWIST, "--draws", 2, "--gust", "bar*_B=3@0.05+0.05")
    ended = run.good(*words, "--least-tension", "scene", "--out", "c.npz", "--json")
    data = ended.data
    assert data["status"] == "holds"
    assert data["motion"]["duration"] == pytest.approx(2 * data["motion"]["shortest_duration"])
    assert data["t_end"] > 3 * data["motion"]["duration"]  # the motion is short: errors decay after it
    needed = data["motion"]["duration"] + 3 * data["gains"]["time_constant"]
    assert data["t_end"] * 5 / 6 >= (1 - 1e-12) * needed  # the same number, but for rounding
    assert all(item["is_stable"] and item["delay"] > 0.005 for item in data["margins"].values())
    assert set(data["loops"]) == {"open", "true_state", "estimator"}
    ends = {name: loop["end_error"]["largest"] for name, loop in data["loops"].items()}
    assert ends["true_state"] < ends["estimator"] < ends["open"]
    assert len(data["least_tension"]) == 9
    assert len(data["errors"]["gusts"]) == 2
    assert all(use["peak_rate"] <= use["rate"] * (1 + 1e-9) for use in data["actuators"].values())
    with np.load("c.npz", allow_pickle=False) as file:
        assert file["estimator_draws_end_error"].tolist() == data["loops"]["estimator"]["end_error"]["draws"]
        assert file["open_coordinate"].shape[1] == 6


def test_a_rise_of_a_weight_is_planned_held_and_written(
    run: Run, folder: Path, lift: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the motion at 21 times instead of 201."""
    monkeypatch.setattr(motions, "time_motion", partial(motions.time_motion, samples=21))
    words = ("--to", "n2.z=-1.02", "--t-end", 1, "--draws", 1, "--gust", "n2=0.1@0.05+0.05", "--out", "c.npz")
    ended = run.good("control", lift, *words, "--json")
    data = ended.data
    assert data["motion"]["duration"] == pytest.approx(2 * data["motion"]["shortest_duration"])
    assert set(data["loops"]) == {"open", "true_state", "estimator"}
    assert all(item["is_stable"] for item in data["margins"].values())
    with np.load("c.npz", allow_pickle=False) as file:
        assert file["estimator_draws_end_error"].tolist() == data["loops"]["estimator"]["end_error"]["draws"]


@pytest.mark.thorough
def test_the_weights_of_a_file_serve_again(run: Run, folder: Path, pinned: Path) -> None:
    words = ("control", pinned, "--draws", 1, "--t-end", 0.5, "--json")
    first = run(*words, "--to", TWIST, "--out", "c.npz")
    assert first.code == 0, first.err
    again = run(*words, "--weights", "c.npz", "--no-estimator")
    assert again.code == 0, again.err
    assert "estimator" not in again.data["loops"]


@pytest.mark.thorough
def test_a_plan_in_a_file_is_held(run: Run, folder: Path, pinned: Path) -> None:
    run("plan", pinned, "--to", TWIST, "--steps", 3, "--out", "plan.npz", "--json")
    ended = run.good("control", pinned, "--plan", "plan.npz", "--duration", 0.5, "--draws", 1)
    assert "motion of 0.5 s" in ended.out
    assert "holds: largest errors at the end: open loop" in ended.out


@pytest.mark.thorough
def test_an_equilibrium_is_held_and_the_page_is_written(run: Run, folder: Path, lift: Path) -> None:
    pytest.importorskip("matplotlib")
    words = ("control", lift, "--t-end", 1, "--draws", 1, "--gust", "n2=1@0.1+0.1")
    ended = run.good(*words, "--page", "c.html", "--json")
    assert ended.data["motion"]["is_rest"] is True
    page = (folder / "c.html").read_text(encoding="utf-8")
    assert "tensegrity-codegen control" in page
    assert "n2=1@0.1+0.1" in page


def test_the_controller_is_written_in_c_where_feedback_holds(run: Run, folder: Path, lift: Path) -> None:
    words = ("control", lift, "--t-end", 1, "--draws", 1, "--json")
    ended = run.good(*words, "--build", "ctl", "--precision", "single")
    made = ended.data["build"]
    assert made["precision"] == "single"
    assert set(made["files"]) <= {path.name for path in (folder / "ctl").iterdir()}
    assert run(*words, "--build", "ctl", "--in-c").code == 0  # replaces its own files
    named = run.good(*words, "--build", "second", "--name", "hoist").data["build"]
    assert (made["name"], named["name"]) == ("two_nodes", "hoist")
    header = (folder / "second" / "hoist_control.h").read_text(encoding="utf-8")
    assert "hoist_control_step" in header
    assert "two_nodes" not in header
    (folder / "ctl" / "precious.txt").write_text("mine", encoding="utf-8")
    (folder / "ctl" / "manifest.json").write_text("mine", encoding="utf-8")
    refused = run(*words, "--build", "ctl")
    assert refused.code == 2
    assert "manifest.json" in refused.data["given"]
    assert "precious.txt" not in refused.data["given"]  # no file of the controller: it stays
    assert refused.data["hint"].endswith("--overwrite to replace these files")
    assert (folder / "ctl" / "precious.txt").read_text(encoding="utf-8") == "mine"
    (folder / "file").touch()
    refused = run(*words, "--build", "file")
    assert refused.code == 2


def test_without_sensors_the_true_state_is_fed_back(run: Run, lift: Path) -> None:
    change(lift, (SENSOR, ""))
    ended = run.good("control", lift, "--t-end", 1, "--draws", 1, "--json")
    assert list(ended.data["loops"]) == ["open", "true_state"]
    assert "no [[sensors]]" in ended.data["warnings"][0]


def test_feedback_that_does_not_hold_ends_with_code_three_and_no_controller(
    run: Run, folder: Path, lift: Path
) -> None:
    """Strong feedback through a delay of 0.35 s."""
    change(lift, ("rate = 1.0", "rate = 1.0\ndelay = 0.35"))
    strong = ("--tolerance", 1e-3, "--effort", 10, "--response-time", 0.01, "--start-error", "1mm")
    once = ("--t-end", 6, "--draws", 1, "--stiffness-error", 0, "--no-estimator")
    ended = run("control", lift, *strong, *once, "--build", "no", "--json")
    assert ended.code == 3
    assert ended.data["status"] in ("does_not_hold", "unstable")
    assert ended.data["build"] is None
    assert any("not written" in text for text in ended.data["warnings"])
    assert not (folder / "no").exists()


def test_a_blocked_plan_ends_with_code_three(run: Run, lift: Path) -> None:
    """A cord cannot hold the weight above its anchor."""
    ended = run("control", lift, "--to", "n2.z=1", "--json")
    assert ended.code == 3
    assert "there is no plan to hold" in ended.data["problem"]


BAD: Sequence[tuple[list[str], str]] = [
    (["--gust", "n9=1"], "no free node has this name"),
    (["--gust", "n1=1"], "only anchored nodes have this name"),
    (["--gust", "n2"], "not a gust"),
    (["--gust", "n2=1@soon"], "not a gust"),
    (["--gust", "n2=x"], "not a force"),
    (["--gust", "n2=nan,0,0"], "not finite"),
    (["--gust", "n2=0,0,1@-1"], "gust.start"),
    (["--start-error", "soon"], "--start-error: not an error of the start"),
    (["--start-error", "1mm", "--start-error", "2mm"], "given twice"),
    (["--start-error", "1deg"], "no coordinate is an angle"),
    (["--stiffness-error", "1.5"], "--stiffness-error"),
    (["--least-tension", "much"], "--least-tension"),
    (["--integral", "n9.x"], "unknown coordinate"),
    (["--sample", "0"], "--sample"),
    (["--sample", "3"], "--sample"),
    (["--tolerance", "-1"], "--tolerance"),
    (["--draws", "0"], "--draws"),
    (["--last", "9"], "--last"),
    (["--duration", "1"], "--t-end sets the simulated time"),
    (["--disturbance", "-1"], "--disturbance"),
    (["--weights", "lift.toml"], "an .npz file with arrays Q and R"),
    (["--plan", "lift.toml"], "that the verb plan wrote"),
    (["--to", "n2.z=-1.1", "--plan", "plan.npz"], "given twice"),
    (["--out", "c.txt"], "c.txt"),
    (["--precision", "half"], "--precision"),
    (["--build", "lift.toml"], "lift.toml"),
    (["--name", "for"], "--name"),
    (["--to", "n2.x=0.1"], "target n2.x: the scene has no such axis"),
    (["--page", "c.pdf"], "c.pdf"),
]


@pytest.mark.parametrize(
    ("words", "problem"), BAD, ids=lambda item: " ".join(item) if isinstance(item, list) else ""
)
def test_bad_input_is_named(run: Run, folder: Path, lift: Path, words: list[str], problem: str) -> None:
    ended = run.refused("control", lift, "--t-end", 1, *words)
    assert problem in ended.err
    assert [item.name for item in folder.iterdir()] == ["lift.toml"]


TIMES: Sequence[tuple[list[str], str]] = [
    (["--t-end", "0"], "--t-end: out of range"),
    (["--t-end", "-1"], "--t-end: out of range"),
    (["--t-end", "nan"], "--t-end: out of range"),
    (["--t-end", "0.001"], "--t-end: the simulated time is shorter than a sample"),
    (["--t-end", "0.01"], "--t-end: errors are compared in the last sixth"),
    (["--last", "3", "--t-end", "1"], "--last: out of range"),
    (["--sample", "inf"], "--sample: out of range"),
]
MOVES = [*TIMES, (["--duration", "1", "--sample", "2"], "--sample: the sample time does not fit the motion")]


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        *((words, text) for words, text in TIMES),
        *((["--to", "n2.z=1", *words], text) for words, text in MOVES),
    ],
    ids=lambda item: " ".join(item) if isinstance(item, list) else "",
)
def test_wrong_times_are_named_before_work_begins(
    run: Run, folder: Path, words: list[str], problem: str
) -> None:
    """Of a scene that does not exist: nothing was read."""
    ended = run.refused("control", folder / "missing.toml", *words)
    assert problem in ended.err


@pytest.mark.parametrize("start", ["1", "50"])
def test_a_gust_after_the_simulated_time_is_named(run: Run, lift: Path, start: str) -> None:
    ended = run.refused("control", lift, "--t-end", 1, "--gust", f"n2=1@{start}+0.1")
    assert "gust.start: the gust begins after the simulated time" in ended.err


@pytest.mark.parametrize("verb", [("control", "--build"), ("build", "--out")])
def test_a_folder_needs_a_name(run: Run, folder: Path, lift: Path, verb: tuple[str, str]) -> None:
    """An empty text would be the current folder."""
    ended = run.refused(verb[0], lift, verb[1], "")
    assert "a folder needs a name" in ended.err
    assert [item.name for item in folder.iterdir()] == ["lift.toml"]


def test_a_plan_of_another_scene_is_named_with_its_file(run: Run, folder: Path, lift: Path) -> None:
    """The same members and coordinates, but elsewhere."""
    members = np.array(load_scene(lift)[0].member_name)
    found = {"member_name": members, "actuator_name": np.array(["winch"]), "status": np.array("found")}
    np.savez("plan.npz", change=[[0.0], [0.01]], progress=[0.0, 1.0], coordinate=[[-7.0], [-7.1]], **found)
    ended = run.refused("control", lift, "--plan", "plan.npz", "--duration", 1)
    assert "plan.npz: path: point 0 of the path is no equilibrium" in ended.err
    assert "another scene" in ended.err


@pytest.mark.parametrize("kind", [complex, str, object, bool])
def test_weights_that_are_not_real_numbers_are_refused(folder: Path, kind: type) -> None:
    np.savez("w.npz", Q=np.ones(3), R=np.ones(1).astype(kind))
    with pytest.raises(SceneSyntaxError) as caught:
        read_weights("w.npz")
    assert "w.npz" in str(caught.value)
    assert "real numbers" in str(caught.value) or "cannot be read" in str(caught.value)


def test_weights_of_another_size_or_not_definite_are_named_with_their_file(
    run: Run, folder: Path, lift: Path
) -> None:
    for q, r, problem in (
        (np.ones(4), np.ones(1), "w.npz: Q: the weight has another size"),
        (np.ones(3), -np.ones(1), "w.npz: R: the weight is not positive definite"),
        (np.eye(3) + 5 * np.eye(3, k=1), np.ones(1), "5.0 at (0, 1), 0.0 at (1, 0)"),
        (np.diag([1.0, 1.0, -1.0]), np.ones(1), "w.npz: Q: the weight is not positive semidefinite"),
    ):
        np.savez("w.npz", Q=q, R=r)
        ended = run.refused("control", lift, "--t-end", 1, "--weights", "w.npz")
        assert problem in ended.err


def test_an_actuator_without_effect_is_named(run: Run, pinned: Path) -> None:
    base = 'base1 = { class = "top", points = ["base.b1", "base.b2"] }\n'
    change(pinned, ("[tendons]\n", "[tendons]\n" + base))
    change(pinned, ("[[sensors]]", '[[actuators]]\nname = "base"\nmembers = "base1"\n\n[[sensors]]'))
    ended = run.refused("control", pinned, "--t-end", 1)
    assert "base1 connects points that cannot move" in ended.err


def test_a_delay_longer_than_the_motion_is_named(run: Run, lift: Path) -> None:
    change(lift, ("rate = 1.0", "rate = 1.0\ndelay = 2.0"))
    ended = run.refused("control", lift, "--t-end", 1)
    assert "actuators.winch.delay: the delay is longer than the motion" in ended.err


def test_sensors_that_do_not_show_the_state_are_named(run: Run, pinned: Path) -> None:
    change(pinned, ('["top", "vertical", "opposite"]', '["top"]'))
    ended = run.refused("control", pinned, "--t-end", 1, "--json")
    assert "rank 15 of 18" in ended.data["given"]
    assert "force on bar" in ended.data["problem"]
    assert "--disturbance 0" in ended.data["hint"]


def test_a_least_tension_that_the_range_does_not_allow_is_named(run: Run, pinned: Path) -> None:
    change(pinned, ("range = [0.1, 0.5] ", "range = [0.2485, 0.26] "))
    ended = run.refused("control", pinned, "--t-end", 1, "--least-tension", 60, "--json")
    assert ended.data["where"] == "least_tension of top1"
    assert "does not allow the least tension" in ended.data["problem"]


@pytest.mark.thorough
def test_a_motion_that_is_too_fast_is_refused_by_its_cable(run: Run, pinned: Path) -> None:
    ended = run.refused("control", pinned, "--to", TWIST, "--duration", 0.01)
    assert "--duration: the motion is too fast for the actuator" in ended.err


def test_a_scene_without_actuators_or_masses_is_refused(
    run: Run, folder: Path, pinned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change(pinned, ("[[actuators]]", "[limits]\n[[actuators]]"))
    text = pinned.read_text(encoding="utf-8").partition("[limits]")[0]
    pinned.write_text(text, encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(SceneCase, "build_library", None)  # nothing is compiled
        ended = run.refused("control", pinned)
    assert "no actuators" in ended.err
    massless = folder / "massless.toml"
    massless.write_text(LIFT.replace("mass = ", "mass = 0  # "), encoding="utf-8")
    ended = run.refused("control", massless)
    assert "mass" in ended.err


def test_rigid_bars_are_controlled(run: Run, folder: Path) -> None:
    """A bar that swings about its anchor by a cord with a winch."""
    rigid = folder / "rigid.toml"
    rigid.write_text(
        'name = "rigid"\naxes = "xz"\n'
        '[classes.bar]\nkind = "bar"\n[classes.cord]\nkind = "cable"\nspring_constant = 100\n'
        "[nodes]\na = { position = [0, 0], anchored = true }\nb = { position = [0, 1], mass = 1 }\n"
        "c = { position = [1, 1], anchored = true }\nd = { position = [-1, 1], anchored = true }\n"
        '[members]\nab = { class = "bar", nodes = ["a", "b"] }\n'
        'bc = { class = "cord", nodes = ["b", "c"], rest_length = 0.9 }\n'
        'bd = { class = "cord", nodes = ["b", "d"], rest_length = 0.9 }\n'
        '[[actuators]]\nname = "m"\nmembers = "bc"\n',
        encoding="utf-8",
    )
    pytest.importorskip("matplotlib")
    ended = run("control", rigid, "--draws", 1, "--t-end", 2, "--page", "c.html", "--json")
    page = (folder / "c.html").read_text(encoding="utf-8")
    assert "2 coordinates (1 independent)" in page
    assert "no estimator: all states are fed back" in page
    ends = {name: loop["end_error"]["largest"] for name, loop in ended.data["loops"].items()}
    assert ends["true_state"] < 0.7 * ends["open"]
    sensor = '[[sensors]]\nkind = "member_length"\nmembers = "bd"\n'
    rigid.write_text(rigid.read_text(encoding="utf-8") + sensor, encoding="utf-8")
    refused = run.refused("control", rigid, "--build", "c")
    assert "an estimator in C" in refused.err
    assert "--no-estimator" in refused.err
    assert "compil" not in refused.err


@pytest.mark.parametrize(("t_end", "draws"), [(3, 1), *thorough((3, 2))])
def test_model_predictive_control_is_simulated_and_written_in_c(
    run: Run, folder: Path, lift: Path, t_end: int, draws: int
) -> None:
    words = ("control", lift, "--t-end", t_end, "--draws", draws, "--no-estimator", "--mpc", "--horizon", 8)
    ended = run.good(*words, "--build", "ahead", "--json")
    assert ended.data["mpc"] == {"horizon": 8, "blocks": [1, 1, 2, 4], "substeps": 1}
    assert ended.data["status"] == "holds"
    ends = {name: loop["end_error"]["largest"] for name, loop in ended.data["loops"].items()}
    assert ends["true_state"] < 0.4 * ends["open"]
    assert ended.data["build"]["gain_knots"] is None
    assert "N_HORIZON" in (folder / "ahead" / "two_nodes_control.h").read_text()


def test_the_problem_is_exported_to_acados_by_the_same_options(run: Run, folder: Path, lift: Path) -> None:
    words = ("--horizon", 8, "--sample", 0.01, "--effort", 0.002, "--least-tension", 1)
    ended = run.good("export", "acados", lift, *words, "-o", "project", "--json")
    assert (ended.facts["n_actuators"], ended.facts["blocks"]) == (1, [1, 1, 2, 4])
    assert "sensors" in ended.facts["notes"][0]
    problem = json.loads((folder / "project" / "problem.json").read_text(encoding="utf-8"))
    assert (problem["sample"], problem["numbers"]["R"]) == (0.01, [[pytest.approx(0.002**-2)]])
    assert problem["numbers"]["soft_most"] == [0.0]


@pytest.mark.parametrize(
    ("words", "where", "hint"),
    [
        (("acados", "--horizon", 0), "--horizon", "1 to 200"),
        (("acados", "--sample", 0), "--sample", "> 0"),
        (("acados", "--duration", 2), "--duration", "--to or --plan"),
        (("acados", "--least-tension", "low"), "--least-tension", "scene"),
        (("acados", "--to", "sideways"), "--to", "sideways"),
        (("acados", "--t-end", 2), "--t-end", "with fmu only"),
        (("mjcf", "--effort", 0.1), "--effort", "with acados only"),
        (("late", "--horizon", 8), "actuators.winch.delay", "delays"),
    ],
)
def test_what_acados_cannot_have_is_refused(
    words: tuple[Any, ...], where: str, hint: str, run: Run, folder: Path, lift: Path
) -> None:
    if words[0] == "late":
        change(lift, ('name = "winch"', 'name = "winch"\ndelay = 0.01'))
    before = sorted(folder.rglob("*"))
    format_name = words[0].replace("late", "acados")
    ended = run.refused("export", format_name, lift, *words[1:], "-o", "project", "--json")
    assert where in ended.data["where"]
    assert hint in ended.out
    assert sorted(folder.rglob("*")) == before
