"""Identification: known numbers are found again from motions with noise, and how sure they are is right."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.sweeps.fitting.identify import identify
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.cases import thorough
from tests.sweeps.fitting.scenes import FALL, PRISM, RING, ROD, ROPE, change, measure

TIMES = np.arange(1, 301) / 100.0
START = change(
    FALL,
    members__rope__spring_constant=120.0,
    members__rope__damping=1.6,
    members__rope__rest_length=0.9,
)
TRUTH = np.array([100.0, 2.0, 1.0])


def test_a_damped_cable_is_found_again_through_the_jumps_of_its_force() -> None:
    """Standard errors of 300 samples with 0.5 mm of noise by an independent program: 0.023, 0.00035, 5e-5."""
    found = identify(START, measure(FALL, TIMES, ["weight.z"], 5e-4), ROPE)
    assert found.status == "ok"
    np.testing.assert_allclose(found.standard_error, [0.023, 0.00036, 0.000054], rtol=0.1)
    assert np.abs((found.value - TRUTH) / found.standard_error).max() < 4.0
    assert found.noise["position"] == pytest.approx(5e-4, rel=0.1)
    assert found.whiteness > 1e-3
    assert found.warnings == ()
    assert found.document["members"]["rope"]["spring_constant"] == found.value[0]


def test_inputs_of_a_file_of_a_motion_are_its_profile(tmp_path: Path) -> None:
    """Written by simulate with a winch that pulls; 100 N/m is found from 60 N/m, also from arrays by name."""
    rope = {"kind": "cable", "spring_constant": 100.0, "rest_length": 0.9}
    scene: dict[str, Any] = {
        "name": "lift",
        "gravity": [0, 0, -9.81],
        "nodes": {
            "a": {"position": [0, 0, 0], "anchored": True},
            "b": {"position": [1, 0, -0.2], "mass": 1.0},
            "c": {"position": [2, 0, 0], "anchored": True},
        },
        "classes": {"rope": rope},
        "members": {"m": {"class": "rope", "nodes": ["a", "b"]}, "n": {"class": "rope", "nodes": ["b", "c"]}},
        "actuators": [{"name": "w", "members": ["m"], "rate": 0.1, "range": [0.5, 1.5]}],
    }
    pull = Profile([0.0, 1.0], {"w": [0.0, -0.1]})
    motion = simulate(compile_scene(scene, for_="simulate"), 1.0, samples=21, schedule=pull, rtol=1e-9)
    motion.write(tmp_path / "run.csv")
    assert "input.w [m]" in (tmp_path / "run.csv").read_text().splitlines()[0]
    scene["classes"] = {"rope": {**rope, "spring_constant": 60.0}}
    arrays = {"time": motion.time, "b.z": motion.position("b")[:, 2], "input.w": -0.1 * motion.time}
    for measured in (tmp_path / "run.csv", arrays):
        found = identify(scene, measured, ["classes.rope.spring_constant"])
        assert found.status == "ok"
        assert found.value[0] == pytest.approx(100.0, rel=1e-5)
    still = identify(scene, arrays, ["classes.rope.spring_constant"], schedule=Profile([0, 1], {"w": [0, 0]}))
    assert abs(still.value[0] - 100.0) > 1.0  # a profile that is given counts


def test_a_slipping_rod_shows_its_ground() -> None:
    """From 1.2 and 0.8 times the truth, by the positions of both ends at 200 Hz with 0.1 mm of noise."""
    data = measure(ROD, np.arange(1, 121) / 200.0, ["low.x", "low.z", "high.x", "high.z"], 1e-4)
    start = change(ROD, ground__stiffness=1.2e5, ground__friction=0.32, ground__dissipation=0.42)
    keys = ["ground.stiffness", "ground.friction", "ground.dissipation"]
    found = identify(start, data, keys, noise=1e-4)
    truth = np.array([1e5, 0.4, 0.35])
    assert (found.standard_error / truth < [0.02, 0.002, 0.001]).all()
    assert np.abs((found.value - truth) / found.standard_error).max() < 4.0
    assert found.n_motions < 25


def test_a_cable_that_slips_at_a_ring_shows_its_stiffness_and_damping() -> None:
    data = measure(RING, np.arange(1, 41) / 100.0, ["a.x", "a.z", "b.x", "b.z"], 1e-5)
    start = change(RING, classes__cord__damping=4.5, members__rope__rest_length=1.88)
    found = identify(start, data, ["classes.cord.damping", "members.rope.rest_length"], noise=1e-5)
    assert np.abs((found.value - [5.0, 1.9]) / found.standard_error).max() < 4.0
    assert (found.standard_error < [0.05, 1e-4]).all()


def test_a_class_of_cables_is_one_number() -> None:
    """By lengths and tensions too, with cells that are missing."""
    from tensegrity_codegen.pipeline.compile_scene import compile_scene
    from tensegrity_codegen.runtime.simulate.simulate import simulate

    times = np.linspace(0.0, 0.5, 101)
    motion = simulate(compile_scene(PRISM, for_="simulate"), 0.5, samples=times, rtol=1e-9)
    draw = np.random.default_rng(3)
    top = motion.node_position[:, motion.node_name.index("t1"), 0] + 1e-4 * draw.normal(size=101)
    top[20:40] = np.nan
    ends = [motion.node_name.index(name) for name in ("t1", "t2")]
    length = np.linalg.norm(motion.node_position[:, ends[0]] - motion.node_position[:, ends[1]], axis=1)
    names = motion.member_name
    pairs = dict(zip(names, load_scene(PRISM)[0].connectivity.tolist(), strict=True))
    edge = next(name for name, pair in pairs.items() if sorted(pair) == sorted(ends))
    tension = motion.member_tension[:, names.index(edge)] + 0.05 * draw.normal(size=101)
    data = {"time": times, "t1.x": top, f"{edge}.length": length + 1e-4 * draw.normal(size=101)}
    data |= {f"{edge}.tension [N]": tension}
    keys = ["classes.cable.spring_constant", "classes.cable.damping", "shape.node_mass", "loads[0].force[0]"]
    start = change(PRISM, classes__cable__spring_constant=250.0, classes__cable__damping=0.6)
    found = identify(start, data, keys)
    truth = np.array([300.0, 0.4, 0.05, 2.0])
    assert found.status == "ok"
    assert found.n_values == 3 * 101 - 20
    assert np.abs((found.value - truth) / found.standard_error).max() < 4.0
    assert (found.standard_error / truth).max() < 0.05
    assert found.noise["tension"] == pytest.approx(0.05, rel=0.25)


@pytest.mark.parametrize("seeds", [range(24), *thorough(range(200, 400))], ids=len)
def test_intervals_hold_the_truth_as_often_as_they_say(seeds: range) -> None:
    hits = np.zeros(3)
    for seed in seeds:
        found = identify(START, measure(FALL, TIMES[::6], ["weight.z"], 1e-3, seed), ROPE)
        hits += (found.interval[:, 0] <= TRUTH) & (found.interval[:, 1] >= TRUTH)
    assert (hits / len(seeds) >= 0.9 - 0.05 * (len(seeds) < 100)).all()
    assert (hits / len(seeds)).mean() <= 0.99


def test_what_is_known_as_a_ratio_only_is_said_to_be_so() -> None:
    found = identify(FALL, measure(FALL, TIMES, ["weight.z"], 5e-4), [*ROPE[:2], "nodes.weight.mass"])
    (only,) = found.undetermined
    assert only.describe().startswith("the sizes of ")
    assert only.describe().endswith("only their ratios")
    assert set(only.part) == {*ROPE[:2], "nodes.weight.mass"}
    assert any("only their ratios" in text for text in found.warnings)
    assert found.value[0] / found.value[2] == pytest.approx(100.0, rel=1e-3)


def test_numbers_without_influence_are_named() -> None:
    before = measure(FALL, TIMES[:30], ["weight.z"], 5e-4)  # the cable is slack so far
    found = identify(FALL, before, ["members.rope.spring_constant", "gravity[2]"])
    assert found.without_influence == ("members.rope.spring_constant",)
    assert found.value[0] == 100.0
    assert found.value[1] == pytest.approx(-9.81, rel=1e-3)


def test_times_that_are_held_out_are_predicted() -> None:
    data = measure(FALL, TIMES, ["weight.z"], 5e-4)
    found = identify(START, data, ROPE, noise=5e-4, hold_out=0.3)
    assert 0.8 < found.held_out < 1.3
    assert found.n_values == 210


PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {
        "top": {"position": [0, 0], "anchored": True},
        "a": {"position": [1, 0.2], "mass": 1.0},
        "b": {"position": [2, 0.5], "mass": 1.0},
    },
    "members": {
        "one": {"nodes": ["top", "a"], "kind": "bar", "spring_constant": 2000.0},
        "two": {"nodes": ["a", "b"], "kind": "bar", "spring_constant": 2000.0},
    },
    "model": {"quantities": ["acceleration"]},
}


def test_a_motion_that_tumbles_loses_its_derivatives_at_a_time() -> None:
    """A double pendulum of two elastic rods: right for 3 s, without meaning after 16 s."""
    keys = ["nodes.b.mass"]
    short = identify(PENDULUM, measure(PENDULUM, np.linspace(0.1, 3, 30), ["b.x"], 1e-3), keys, noise=1e-3)
    assert short.status == "ok"
    times = np.linspace(0.2, 16, 80)
    with_error = {"time": times, "b.x": np.sin(times)}  # its own motion is not known either
    long = identify(PENDULUM, with_error, keys, noise=10.0)
    assert long.status == "sensitive"
    assert 8.0 < float(long.message.split()[1]) < 16.0


def test_data_that_no_motion_explains_are_said_to_be_so() -> None:
    data = measure(FALL, TIMES, ["weight.z"], 5e-4)
    millimetres = {**data, "weight.z": 1000.0 * data["weight.z"]}
    found = identify(FALL, millimetres, ["members.rope.rest_length"], noise=5e-4)
    assert found.status == "not_explained"
    assert any("units" in text for text in found.warnings)
    drifting = {**data, "weight.z": data["weight.z"] + 0.02 * np.sin(3.0 * TIMES)}
    found = identify(FALL, drifting, ROPE[:1])
    assert any("follow each other in time" in text for text in found.warnings)


@pytest.mark.parametrize(
    ("changes", "error", "word"),
    [
        ({"keys": ["members.rope.stiffness"]}, UnknownKeyError, "spring_constant"),
        ({"keys": []}, InvalidValueError, "no keys"),
        ({"keys": [ROPE[0], ROPE[0]]}, DuplicateNameError, "twice"),
        ({"keys": ["members.rope.mass"]}, InvalidValueError, "does not state"),
        ({"bounds": {ROPE[0]: (110.0, 200.0)}}, InvalidValueError, "exclude"),
        ({"bounds": {"members.rope.mass": (0.0, 1.0)}}, UnknownNameError, "rope"),
        ({"noise": {"lengths": 1.0}}, UnknownNameError, "length"),
        ({"noise": 0.0}, InvalidValueError, "noise"),
        ({"noise": {"length": 1.0}}, InvalidValueError, "position"),
        ({"hold_out": 1.0}, InvalidValueError, "hold_out"),
        ({"method": "radau"}, FormulationError, "radau"),
    ],
    ids=str,
)
def test_wrong_calls_are_refused(changes: dict[str, Any], error: type[Exception], word: str) -> None:
    call = {"keys": list(ROPE), **changes}
    with pytest.raises(error, match=word):
        identify(FALL, measure(FALL, TIMES, ["weight.z"]), call.pop("keys"), **call)


def test_constants_of_the_code_are_refused() -> None:
    data = measure(PRISM, TIMES[:20], ["t1.x"])
    with pytest.raises(InvalidValueError, match="constants of the code") as caught:
        identify(PRISM, data, ["classes.bar.mass", "classes.cable.damping"])
    assert "classes.bar.mass" in str(caught.value)
    with pytest.raises(InvalidValueError, match="whole number"):
        identify(PRISM, data, ["shape.bars"])


def test_the_scene_found_can_be_read_and_is_not_replaced(tmp_path: Path) -> None:
    from tensegrity_codegen.system.errors import OutputError

    found = identify(START, measure(FALL, TIMES, ["weight.z"], 5e-4), ROPE)
    found.write_scene(tmp_path / "found.toml")
    structure, _ = load_scene(tmp_path / "found.toml")
    assert structure.rest_length[0] == found.value[2]
    with pytest.raises(OutputError):
        found.write_scene(tmp_path / "found.toml")


def test_an_interrupted_search_keeps_its_best_values() -> None:
    calls = []

    def interrupt(part: float) -> None:
        calls.append(part)
        if len(calls) == 3:
            raise KeyboardInterrupt

    found = identify(START, measure(FALL, TIMES, ["weight.z"], 5e-4), ROPE, progress=interrupt)
    assert found.status == "interrupted"
    assert np.abs(found.value / TRUTH - 1.0).max() < 0.2
