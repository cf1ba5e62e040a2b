"""The verb `plan`: files, JSON, exit codes, wrong input, and a motion that follows a plan."""

import os
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cli.conftest import Run


@pytest.fixture
def prism12(folder: Path) -> Path:
    path = folder / "prism12.toml"
    path.write_text(list_examples()["prism12"], encoding="utf-8")
    return path


def test_a_plan_is_found_written_and_followed_by_a_motion(run: Run, folder: Path, prism12: Path) -> None:
    words = ("plan", prism12, "--to", "twist=157deg", "--steps", 5, "--duration", 0.5)
    data = run(*words, "--out", "plan.csv", "--out", "plan.npz", "--json").data
    assert data["status"] == "found"
    assert data["n_steps"] == 5
    assert data["targets"][0] == {
        "name": "twist", "unit": "deg", "start": pytest.approx(155.0), "reached": pytest.approx(157.0),
        "goal": pytest.approx(157.0),
    }  # fmt: skip
    assert data["duration"] == pytest.approx(0.5)
    assert data["least_tension"]["value"] > 1.0
    assert (folder / "plan.csv").read_text().splitlines()[0] == "time,v1,v2,v3,o1,o2,o3"
    with np.load("plan.npz", allow_pickle=False) as file:
        assert file["rest_length"].shape == (6, 6)
        assert file["member_tension"].shape == (6, 15)
        assert file["node_position"].shape == (6, 6, 3)
        assert str(file["status"]) == "found"
        change = file["change"]
    moved = run("simulate", prism12, "--profile", "plan.csv", "--t-end", 0.5, "--out", "motion.npz", "--json")
    assert moved.code == 0, moved.err
    with np.load("motion.npz", allow_pickle=False) as file:
        np.testing.assert_allclose(file["input"][-1], change[-1], atol=1e-12)


@pytest.mark.thorough
def test_a_plan_in_time_is_followed_by_a_motion(run: Run, folder: Path, prism12: Path) -> None:
    words = ("plan", prism12, "--to", "twist=157", "--steps", 5, "--duration", 0.5)
    data = run(*words, "--motion", "motion.csv", "--json").data
    motion = data["motion"]
    assert motion["duration"] == 0.5
    assert 0 < motion["shortest_duration"] < 0.5
    assert max(motion["peak_rate"].values()) <= 0.05
    assert (folder / "motion.csv").read_text().splitlines()[0] == "time,v1,v2,v3,o1,o2,o3"
    words = ("simulate", prism12, "--profile", "motion.csv", "--profile-kind", "cubic", "--t-end", 0.5)
    moved = run(*words, "--samples", 2, "--out", "run.npz", "--json")
    assert moved.code == 0, moved.err
    run(
        "plan", prism12, "--to", "twist=157", "--steps", 5, "--out", "plan.npz", "--motion", "m.npz", "--json"
    )
    with np.load("run.npz", allow_pickle=False) as file, np.load("plan.npz", allow_pickle=False) as plan:
        assert np.abs(file["node_position"][-1] - plan["node_position"][-1]).max() < 1e-4
    with np.load("m.npz", allow_pickle=False) as file:
        assert file["coordinate"].shape == (201, 18)
        assert file["actuator_name"].tolist() == ["v1", "v2", "v3", "o1", "o2", "o3"]


@pytest.mark.thorough
def test_a_motion_that_is_too_fast_is_refused_by_its_cable(run: Run, folder: Path, prism12: Path) -> None:
    words = ("plan", prism12, "--to", "twist=157", "--steps", 5, "--duration", 0.12)
    ended = run.refused(*words, "--motion", "motion.csv", "--out", "plan.npz")
    assert "of opposite" in ended.err
    assert "m/s at 0.0" in ended.err
    assert not (folder / "motion.csv").exists()
    assert not (folder / "plan.npz").exists()


def test_linear_algebra_uses_one_thread(run: Run, prism12: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert run("plan", prism12, "--to", "height=-1", "--json").code == 3
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_text_and_page_have_targets_rest_lengths_and_the_outcome(
    run: Run, folder: Path, prism12: Path
) -> None:
    pytest.importorskip("matplotlib")
    ended = run.good("plan", prism12, "--to", "twist=156", "--steps", 2, "--page", "plan.html")
    assert "<svg" in (folder / "plan.html").read_text(encoding="utf-8")
    assert "twist" in ended.out
    assert "found: a path of 2 steps" in ended.out
    assert "takes" in ended.out


def test_a_blocked_plan_ends_with_code_three_and_what_binds(run: Run, prism12: Path) -> None:
    ended = run("plan", prism12, "--to", "twist=165", "--actuate", "v1", "--actuate", "v2", "--actuate", "v3")
    assert ended.code == 3
    assert "least tension of 1 N (opposite1, opposite2, opposite3)" in ended.out
    assert "158.6" in ended.out


def test_an_infeasible_plan_ends_with_code_three_and_the_proof(run: Run, folder: Path, prism12: Path) -> None:
    text = prism12.read_text(encoding="utf-8").replace('opposite_class = "cable"', "#")
    text = text.replace("twist = 155", "twist = 160").replace("prestress = 20 ", "# ")
    text = text.replace("spring_constant = 1000 ", "spring_constant = 1000\nprestress = 5 ")
    nine = folder / "nine.toml"
    nine.write_text(text.partition("[[actuators]]")[0] + "[limits]\nleast_tension = 1.0\n", encoding="utf-8")
    data = run("plan", nine, "--to", "twist=165", "--actuate", "cables", "--json")
    assert data.code == 3
    proof = data.data["certificate"]
    assert data.data["status"] == "infeasible"
    assert proof["is_verified"] is True
    assert len(proof["shortening"]) == 9
    assert "change of length" in run("plan", nine, "--to", "twist=165", "--actuate", "cables").out


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--to", "twst=160"], "did you mean 'twist'"),
        (["--to", "twist=soon"], "twist=soon"),
        (["--to", "twist=160", "--actuate", "cable9"], "unknown member or actuator"),
        (["--to", "twist=160", "--actuate", "v1", "--actuate", "vertical1"], "twice"),
        (["--to", "twist=160", "--input", "v9=1"], "unknown input"),
        (["--to", "twist=160", "--input", "v1=0", "--input", "v1=0"], "given twice"),
        (["--to", "twist=160", "--out", "plan.txt"], "plan.txt"),
        (["--to", "twist=160", "--duration", "0.001"], "more time"),
        (["--to", "twist=160", "--steps", "0"], "steps"),
    ],
)
def test_bad_input_is_named(run: Run, folder: Path, prism12: Path, words: list[str], problem: str) -> None:
    ended = run.refused("plan", prism12, *words)
    assert problem in ended.err
    assert [item.name for item in folder.iterdir()] == ["prism12.toml"]


def test_a_scene_without_actuators_is_told_what_to_add(run: Run, prism12: Path) -> None:
    text = prism12.read_text(encoding="utf-8").partition("[[actuators]]")[0]
    prism12.write_text(text, encoding="utf-8")
    ended = run.refused("plan", prism12, "--to", "twist=160", "--json")
    assert "no actuators" in ended.data["problem"]
    assert "[[actuators]]" in ended.data["allowed"]
    assert "--actuate cables" in ended.data["hint"]


def test_a_start_outside_the_limits_is_refused_with_the_amount(run: Run, prism12: Path) -> None:
    text = prism12.read_text(encoding="utf-8").replace("least_tension = 1.0", "least_tension = 5.0")
    prism12.write_text(text, encoding="utf-8")
    ended = run.refused("plan", prism12, "--to", "twist=160", "--json")
    assert "least tension of opposite1: violated by 2.54072 N" in ended.data["problem"]


def test_a_rope_without_tension_at_the_stated_place_is_settled_first(run: Run, folder: Path) -> None:
    """The stiffness at the stated place is zero; the mass hangs below the anchor."""
    (folder / "rope.toml").write_text(
        'name = "rope"\naxes = "xz"\n'
        '[classes.rope]\nkind = "cable"\nspring_constant = 1000\n'
        "[nodes]\nl = { position = [0, 1], anchored = true }\nm = { position = [0.3, 0.1] }\n"
        '[members]\ncl = { class = "rope", nodes = ["l", "m"], rest_length = 0.99 }\n'
        '[[loads]]\nnode = "m"\nforce = [0, -10]\n',
        encoding="utf-8",
    )
    ended = run.good(
        "plan", "rope.toml", "--to", "m.z=0.2", "--actuate", "cables", "--out", "rope.csv", "--json"
    )
    assert ended.data["status"] == "found"
    assert "--duration SECONDS" in ended.err  # without a rate the file has no times


def test_the_actuator_that_needs_more_time_is_named(run: Run, prism12: Path) -> None:
    ended = run.refused("plan", prism12, "--to", "twist=157", "--steps", 2, "--duration", 0.01, "--json")
    assert "actuator 'o" in ended.data["hint"]
