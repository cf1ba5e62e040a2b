"""Identification from states at rest: shapes under loads, tensions, natural frequencies."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.sweeps.fitting.identify import identify
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError
from tests.cases import thorough
from tests.sweeps.fitting.scenes import PRISM, change

FORCE = "loads[0].force[0]"
FORCES = (0.0, 2.0, 5.0, 8.0)
KEYS = ("classes.cable.spring_constant", "shape.prestress", "shape.node_mass")
TRUTH = np.array([300.0, 5.0, 0.05])


def load(force: float) -> dict[str, Any]:
    return {**PRISM, "loads": [{"node": "t1", "force": [force, 0.0, 0.0]}]}


@pytest.fixture(scope="module")
def exact() -> dict[str, Any]:
    """Shapes, a tension and two frequencies under four loads, without noise."""
    rows: dict[str, Any] = {FORCE: list(FORCES)}
    for force in FORCES:
        model = compile_scene(load(force), for_=("equilibrium", "linearize"))
        found = find_equilibrium(model)
        frequency = linearize(model, found).natural_frequency
        names, members = model.manifest.node_name, model.manifest.member_name
        for node, axis in (("t1", 0), ("t2", 1), ("t3", 2)):
            value = found.node_position[names.index(node), axis]
            rows.setdefault(f"{node}.{'xyz'[axis]}", []).append(value)
        rows.setdefault("vertical1.tension", []).append(found.member_tension[members.index("vertical1")])
        for number in (1, 2):
            rows.setdefault(f"frequency.{number}", []).append(frequency[number - 1])
    return rows


NOISE = {"position": 1e-4, "tension": 0.02, "frequency": 0.01}


def with_noise(exact: dict[str, Any], seed: int) -> dict[str, Any]:
    draw, found = np.random.default_rng(seed), {FORCE: exact[FORCE]}
    for name, values in exact.items():
        kind = "tension" if "tension" in name else "frequency" if "freq" in name else "position"
        if name != FORCE:
            found[name] = np.array(values) + NOISE[kind] * draw.normal(size=len(values))
    return found


def test_prestress_stiffness_and_mass_follow_from_shapes_and_frequencies(exact: dict[str, Any]) -> None:
    start = change(PRISM, classes__cable__spring_constant=250.0, shape__prestress=4.0, shape__node_mass=0.07)
    found = identify(start, with_noise(exact, 0), KEYS, noise=NOISE)
    assert found.status == "ok"
    assert np.abs((found.value - TRUTH) / found.standard_error).max() < 4.0
    assert (found.standard_error / TRUTH).max() < 0.01
    assert np.isnan(found.whiteness)
    assert 0.5 < found.residual < 1.6


@pytest.mark.parametrize("seeds", [range(8), *thorough(range(100, 300))], ids=len)
def test_intervals_hold_the_truth_as_often_as_they_say(exact: dict[str, Any], seeds: range) -> None:
    hits = np.zeros(3)
    for seed in seeds:
        found = identify(PRISM, with_noise(exact, seed), KEYS, noise=NOISE)
        hits += (found.interval[:, 0] <= TRUTH) & (found.interval[:, 1] >= TRUTH)
    share = hits / len(seeds)
    assert (share >= (0.7 if len(seeds) < 100 else 0.9)).all()
    assert share.mean() <= (1.0 if len(seeds) < 100 else 0.985)


def test_mass_has_no_influence_on_shapes(exact: dict[str, Any]) -> None:
    """Gravity left out: of the rest only frequencies know the mass."""
    weightless = {**PRISM, "gravity": [0, 0, 0]}
    shapes = {FORCE: [0.0, 2.0], "t1.x": exact["t1.x"][:2], "t2.y": exact["t2.y"][:2]}
    found = identify(weightless, shapes, ["shape.prestress", "shape.node_mass"], noise=1e-4)
    assert found.without_influence == ("shape.node_mass",)


@pytest.mark.parametrize(
    ("columns", "error", "word"),
    [
        ({"loads[3].force[0]": FORCES}, InvalidValueError, "loads"),
        ({"colour": FORCES}, UnknownKeyError, "colour"),
        ({"frequency.19": FORCES}, InvalidValueError, "frequency.19"),
        ({"t1.vx": FORCES}, InvalidValueError, "no velocities"),
    ],
    ids=str,
)
def test_wrong_columns_are_refused(
    exact: dict[str, Any], columns: dict[str, Any], error: type[Exception], word: str
) -> None:
    with pytest.raises(error, match=word):
        identify(PRISM, {**exact, **columns}, KEYS[:1])


@pytest.mark.parametrize("stiffness", [1.7e3, *thorough(1.6e3)])
def test_shapes_on_the_ground_are_data_too(stiffness: float) -> None:
    """A frame on its feet: the stiffness of a strut from how far its top sinks and shifts under loads."""
    frame: dict[str, Any] = {
        "name": "frame",
        "axes": "xz",
        "gravity": [0, -9.81],
        "classes": {"strut": {"kind": "bar", "spring_constant": 2e3}},
        "nodes": {
            "left": {"position": [0, 0], "mass": 1.0},
            "right": {"position": [1, 0], "mass": 1.0},
            "top": {"position": [0.5, 1], "mass": 1.0},
        },
        "members": {
            "base": {"class": "strut", "nodes": ["left", "right"]},
            "west": {"class": "strut", "nodes": ["left", "top"]},
            "east": {"class": "strut", "nodes": ["right", "top"]},
        },
        "loads": [{"node": "top", "force": [0, 0]}],
        "ground": {"stiffness": 1e5, "friction": 0.8},
    }
    down, rows = "loads[0].force[1]", {"top.z": [], "top.x": []}
    for force in (0.0, -10.0):
        frame["loads"][0]["force"] = [1.0, force]
        found = find_equilibrium(compile_scene(frame, for_="equilibrium"))
        rows["top.x"].append(found.node_position[2, 0])
        rows["top.z"].append(found.node_position[2, 2])
    frame["loads"][0]["force"] = [1.0, 0.0]
    start = change(frame, classes__strut__spring_constant=stiffness)
    fitted = identify(start, {down: [0.0, -10.0], **rows}, ["classes.strut.spring_constant"], noise=1e-4)
    assert fitted.status == "ok"
    assert fitted.value[0] == pytest.approx(2e3, rel=1e-6)
