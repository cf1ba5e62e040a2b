"""The ground of MJCF: plane, balls that touch it, friction, stiffness and damping."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.formats.mjcf.contacts import (
    Ball,
    _drop_inner,
    _find_depth,
    _find_restitution,
)
from tests.scene.formats.mjcf.models import ROBOT, load

STANDARD = (0.9, 0.95, 0.001, 0.5, 2.0)  # solimp of MuJoCo


def read(tmp_path: Path, *changes: tuple[str, str]) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    text = ROBOT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    result = load(tmp_path, text)
    return result.document.get("ground", {}), result.document["bodies"], list(result.notes)


def test_a_plane_is_the_ground_and_spheres_that_are_not_inside_others_touch_it(tmp_path: Path) -> None:
    ground, bodies, notes = read(tmp_path)
    slope = math.radians(10)
    np.testing.assert_allclose(ground["normal"], [math.sin(slope), 0, math.cos(slope)], atol=1e-15)
    assert ground["offset"] == pytest.approx(-0.1 * math.cos(slope), rel=1e-14)
    assert ground["contacts"] == [
        f"{rod}.{end}" for rod in ("rod0", "rod1") for end in (f"low_{rod}", "contact4")
    ]
    assert bodies["rod0"]["points"]["low_rod0"] == {"position": [0, 0, -0.17], "radius": 0.024}
    assert ground["friction"] == 0.8
    assert ground["stiffness"] == 5000
    ratio = 50 / (2 * math.sqrt(5000))
    damped = math.sqrt(1 - ratio**2)
    until = math.pi - math.atan(2 * ratio * damped / (1 - 2 * ratio**2))  # where the force ends, in radians
    expected = math.exp(-ratio / damped * until)
    assert ground["restitution"] == {"value": pytest.approx(expected, rel=1e-12), "speed": 1.0}
    assert any("stiffness 5000 N/m (in MuJoCo it acts for each kilogram" in note for note in notes)
    assert not any("cylinders" in note for note in notes)


def test_heavy_models_and_time_constants_have_the_depth_at_rest_of_mujoco(tmp_path: Path) -> None:
    down = 9.81 * math.cos(math.radians(10))
    heavy, _, _ = read(tmp_path, ('mass="0.06"', 'mass="600"'))
    depth = _find_depth(STANDARD, 5000 / 0.95**2, down)
    assert heavy["stiffness"] == pytest.approx(2 * 600.18 * down / (3 * depth), rel=1e-12)  # on three feet
    floating, _, _ = read(tmp_path, ('mass="0.06"', 'mass="600"'), ('gravity="0 0 -9.81"', 'gravity="0 0 0"'))
    depth = _find_depth(STANDARD, 5000 / 0.95**2, 9.81)
    assert floating["stiffness"] == pytest.approx(2 * 600.18 * 9.81 / (3 * depth), rel=1e-12)
    timed, _, notes = read(tmp_path, (' solref="-5000 -50"', ' solref="0.04 0.5"'))
    depth = 2 * 0.24 * down / (3 * timed["stiffness"])
    stiffness = 1 / (0.95 * 0.04 * 0.5) ** 2
    x = depth / 0.001
    impedance = 0.9 + 0.05 * (2 * x**2 if x < 0.5 else 1 - 2 * (1 - x) ** 2) if x < 1 else 0.95
    assert depth == pytest.approx(down * (1 - impedance) / (impedance**2 * stiffness), rel=1e-9)
    assert timed["restitution"]["value"] == pytest.approx(_find_restitution(0.5))
    assert any("as deep as each is" in note and "damping ratio 0.5" in note for note in notes)


@pytest.mark.peers
@pytest.mark.parametrize("solref", ["-5000 -50", "0.02 1", "0.01 0.7"])
def test_depth_and_restitution_are_those_of_mujoco(solref: str) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    text = """<mujoco><option timestep="2e-6" integrator="RK4" gravity="0 0 {}"/>
      <default><geom solref="{}"/></default>
      <worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 {}"><freejoint/><geom size="0.05" mass="3"/>
      </body></worldbody></mujoco>"""
    first, second = (float(word) for word in solref.split())
    stiffness = -first / 0.95**2 if first < 0 else 1 / (0.95 * first * second) ** 2
    damping = -second / 0.95 if first < 0 else 2 / (0.95 * first)
    model = mujoco.MjModel.from_xml_string(text.format(-9.81, solref, 0.05))
    model.opt.timestep = 1e-4
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=20000)
    assert 0.05 - data.qpos[2] == pytest.approx(_find_depth(STANDARD, stiffness, 9.81), rel=1e-6)
    model = mujoco.MjModel.from_xml_string(text.format(0, solref, 0.05))
    data = mujoco.MjData(model)
    data.qvel[2] = -0.001
    mujoco.mj_step(model, data, nstep=60000)
    expected = _find_restitution(damping / (2 * math.sqrt(stiffness)))
    assert data.qvel[2] / 0.001 == pytest.approx(expected, rel=2e-2)


def test_values_of_a_contact_are_combined_as_in_mujoco(tmp_path: Path) -> None:
    floor = '<geom name="floor" type="plane"'
    rough, _, _ = read(tmp_path, (floor, f'{floor} friction="0.9" solref="-7000 -20"'))
    assert (rough["friction"], rough["stiffness"]) == (0.9, 7000)  # the lesser of -7000 and -5000
    first, _, _ = read(tmp_path, (floor, f'{floor} friction="0.1" priority="2" solref="-900 -9"'))
    assert (first["friction"], first["stiffness"]) == (0.1, 900)
    plain, _, _ = read(tmp_path, ('condim="3"', 'condim="1"'))
    assert plain["friction"] == 0
    rolling, _, notes = read(tmp_path, (floor, f'{floor} condim="6"'))
    assert rolling["friction"] == 0.8
    assert any("condim 6" in note for note in notes)
    pair = '<contact><pair geom1="low_rod0" geom2="floor" friction="0.3 0.3"/></contact><tendon>'
    paired, _, _ = read(tmp_path, ("<tendon>", pair), ('cone="elliptic"', 'collision="predefined"'))
    assert paired["contacts"] == ["rod0.low_rod0"]
    assert paired["friction"] == 0.3
    assert paired["stiffness"] == 5000  # of the geoms, since the pair states none


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<geom condim="3"', '<geom contype="0" conaffinity="0"'),
        ('cone="elliptic"/>', '><flag contact="disable"/></option>'),
        ('type="plane" size="5 5 1"', 'type="plane" size="5 5 1" contype="2" conaffinity="4"'),
        ('<geom name="floor" type="plane" size="5 5 1" pos="0 0 -0.1" euler="0 10 0"/>', ""),
    ],
)
def test_without_contacts_there_is_no_ground(old: str, new: str, tmp_path: Path) -> None:
    ground, _, notes = read(tmp_path, (old, new))
    assert not ground
    assert "geoms are read for their masses only: there are no contacts" in notes


def test_other_shapes_touch_by_balls_too(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><geom name="wall" type="box" size="1 1 1"/>
      <body name="b"><freejoint/><geom name="box" type="box" size="0.1 0.2 0.3" pos="1 0 0"/></body>
      <body name="c"><freejoint/><geom name="rod" type="cylinder" size="0.1" fromto="0 0 0 0 0 1"/></body>
      <body name="d"><freejoint/><geom name="egg" type="ellipsoid" size="0.1 0.2 0.3"/></body>
      </worldbody></mujoco>"""
    result = load(tmp_path, text)
    points = {name: body["points"] for name, body in result.document["bodies"].items()}
    assert [point["position"] for point in points["b"].values()] == [
        [1 + x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)
    ]
    assert points["c"] == {
        "rod_a": {"position": [0, 0, 0], "radius": 0.1}, "rod_b": {"position": [0, 0, 1], "radius": 0.1}
    }  # fmt: skip
    assert points["d"] == {}
    assert "cylinders touch the ground by balls of their radius at their two ends" in result.notes
    assert "geoms whose contact with the ground is not read: egg" in result.notes
    assert "pictures of ellipsoids are left out: egg" in result.notes
    assert "fixed geoms beside the ground, which nothing touches here: wall" in result.notes
    assert "members" not in result.document


def test_balls_inside_others_or_their_hull_are_left_out() -> None:
    def ball(x: float, radius: float, y: float = 0.0) -> Ball:
        return Ball(f"{x} {radius}", np.array([x, y, 0.0]), radius)

    ends = [ball(0, 0.1), ball(1, 0.2)]  # their hull has the radius 0.15 half way
    assert _drop_inner([*ends, ball(0.5, 0.15), ball(0, 0.05, 0.04), ball(0.9, 0.0, 0.1)]) == ends
    assert len(_drop_inner([*ends, ball(0, 0.1)])) == 2
    for outside in (ball(0.5, 0.151), ball(0.5, 0.01, 0.15), ball(-0.1, 0.0, 0.05)):
        assert outside in _drop_inner([*ends, outside])
