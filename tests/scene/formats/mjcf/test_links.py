"""Bodies of MJCF: places, masses and inertias are those of MuJoCo; what moves otherwise is refused."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.formats.import_mjcf import WHAT
from tensegrity_codegen.scene.formats.mjcf.defaults import read_defaults
from tensegrity_codegen.scene.formats.mjcf.frames import read_compiler
from tensegrity_codegen.scene.formats.mjcf.include import read_model
from tensegrity_codegen.scene.formats.mjcf.links import Link, read_links
from tensegrity_codegen.system.errors import InvalidValueError
from tests.scene.formats.mjcf.models import BODIES, ROBOT, load, write_body

CASES = [
    *[(name, "") for name in BODIES],
    ("shapes", 'angle="radian" eulerseq="zyx"'),
    ("shapes", 'eulerseq="XzY"'),
    ("shapes", 'inertiagrouprange="1 3"'),
    ("inertial", 'inertiafromgeom="true" angle="radian"'),
    ("inertial", 'inertiafromgeom="false"'),
]


def read_link(tmp_path: Path, text: str) -> Link:
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    root = read_model(path, WHAT)
    defaults = read_defaults(root, "model.xml")
    return read_links(root, defaults, read_compiler(root, defaults, "model.xml"), None, "model.xml")[1]


@pytest.mark.peers
@pytest.mark.parametrize(("name", "compiler"), CASES)
def test_masses_inertias_and_places_are_those_of_mujoco(name: str, compiler: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    text = write_body(name, compiler)
    if "grouprange" in compiler:
        text = text.replace('name="g3"', 'name="g3" group="2"')
    link = read_link(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    masses, centres = model.body_mass[1:], data.xipos[1:]
    centre = masses @ centres / masses.sum()
    inertia = np.zeros((3, 3))
    for k, mass in enumerate(masses, 1):
        turned, apart = data.ximat[k].reshape(3, 3), data.xipos[k] - centre
        inertia += turned @ np.diag(model.body_inertia[k]) @ turned.T
        inertia += mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    np.testing.assert_allclose(link.mass, masses.sum(), rtol=1e-12)
    np.testing.assert_allclose(link.place(link.centre), centre, atol=1e-12)
    own = link.rotation @ link.inertia @ link.rotation.T
    np.testing.assert_allclose(own, inertia, atol=1e-12 * np.abs(inertia).max())
    np.testing.assert_allclose(link.locate("s"), data.site("s").xpos, atol=1e-12)
    for geom in link.geoms:
        np.testing.assert_allclose(link.place(geom.position), data.geom(geom.name).xpos, atol=1e-12)
        axes = data.geom(geom.name).xmat.reshape(3, 3)
        np.testing.assert_allclose(link.rotation @ geom.rotation, axes, atol=1e-12)


def test_inertia_of_shapes_is_that_of_their_formulas(tmp_path: Path) -> None:
    link = read_link(tmp_path, write_body("shapes"))
    capsule, _, box, ellipsoid, ball = link.geoms
    radius, half = 0.05, 0.2
    cylinder, halves = math.pi * radius**2 * 2 * half, 4 / 3 * math.pi * radius**3
    assert capsule.compute_inertia()[0] == pytest.approx(1000 * (cylinder + halves), rel=1e-14)
    # Half balls have their centres 3/8 of the radius beyond the ends.
    about = cylinder * radius**2 / 2 + 0.4 * halves * radius**2
    across = cylinder * (3 * radius**2 + 4 * half**2) / 12
    across += halves * (0.4 * radius**2 - (3 / 8 * radius) ** 2 + (half + 3 / 8 * radius) ** 2)
    moments = np.linalg.eigvalsh(capsule.compute_inertia()[1])
    np.testing.assert_allclose(moments, 1000 * np.array([about, across, across]), rtol=1e-12)
    principal = np.array([0.05, 0.1, 0.13])
    for geom, mass, share in ((box, 48.0, 1 / 3), (ellipsoid, 3.0, 1 / 5)):
        own, inertia = geom.compute_inertia()
        assert own == pytest.approx(mass, rel=1e-14)
        np.testing.assert_allclose(np.linalg.eigvalsh(inertia), mass * share * principal, rtol=1e-12)
    mass, inertia = ball.compute_inertia()
    np.testing.assert_allclose(inertia, 0.4 * mass * 0.01 * np.eye(3), atol=1e-15)


def test_nested_classes_and_frames_count(tmp_path: Path) -> None:
    link = read_link(tmp_path, write_body("classes"))
    assert [geom.compute_inertia()[0] for geom in link.geoms] == [
        pytest.approx(5000 * math.pi * 0.004),
        3.0,
        3.0,
    ]
    assert [geom.size[1] for geom in link.geoms] == [0.2, 0.9, 0.9]
    assert read_link(tmp_path, write_body("joint of a class")).kind == "free"
    framed = read_link(tmp_path, write_body("frames"))
    # The body is 1 m along the x axis of a frame at z = 1 whose x axis points down; the site in it is at
    # (1, 1, 1) + half a turn about x of (0, 0, 1).
    np.testing.assert_allclose(framed.position, [0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(framed.sites["s"], [1, 1, 0], atol=1e-15)
    np.testing.assert_allclose(framed.locate("s"), [0, 1, -1], atol=1e-15)


def test_global_coordinates_are_those_of_the_world(tmp_path: Path) -> None:
    text = write_body("welded", 'coordinate="global"')
    link = read_link(tmp_path, text)
    np.testing.assert_allclose(link.locate("s"), [0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(link.place(link.geoms[0].position), [0, 0, 0], atol=1e-15)


EQUALITY = '<equality><weld body1="rod0" body2="rod1"/></equality><tendon>'
MESH = '<geom type="mesh" mesh="m"/><site name="rod0_out"'
REFUSED: list[tuple[str, str, str]] = [
    ("<freejoint/>", '<joint type="hinge" axis="0 0 1"/>', "these joints are not read"),
    ("<freejoint/>", '<freejoint/><body><freejoint/><geom size="1"/></body>', "a free body within a body"),
    ('name="rod0" pos', 'name="rod0" mocap="true" pos', "motion capture"),
    ("<freejoint/>", '<freejoint/><geom size="1" mass="-1"/>', "a negative mass"),
    ('quat="0.927160881 -0.0969700367 -0.361897104 0"', 'quat="0 0 0 0"', "a quaternion of length 0"),
    ("<tendon>", EQUALITY, "constraint <weld>"),
    ('<site name="rod0_out"', MESH, "mass and inertia of this geom are not known"),
    ('type="plane"', 'type="hfield" hfield="h"', "height field"),
    ("<tendon>", '<tendon/><worldbody><composite type="cable"/></worldbody><tendon>', "<composite>"),
    ('<site site="hook"/><site site="rod1_top"', '<site site="hook"/><geom geom="g"', "around geoms"),
]


@pytest.mark.parametrize(("old", "new", "words"), REFUSED)
def test_what_cannot_be_read_is_refused_by_name(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in ROBOT
    with pytest.raises(InvalidValueError, match=words) as caught:
        load(tmp_path, ROBOT.replace(old, new, 1))
    assert "model.xml" in caught.value.where


def test_a_mesh_of_a_body_with_an_inertial_is_a_picture_that_is_left_out(tmp_path: Path) -> None:
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    text = ROBOT.replace(' inertiafromgeom="true"', "").replace("<freejoint/>", f"<freejoint/>{inertial}", 1)
    result = load(tmp_path, text.replace('<site name="rod0_out"', MESH, 1))
    assert result.document["bodies"]["rod0"]["mass"] == 1.0
    assert any(note == "meshes are left out: rod0" for note in result.notes)


def test_a_rod_is_a_bar_where_its_spin_moves_nothing_and_a_body_elsewhere(tmp_path: Path) -> None:
    def read(change: Any) -> dict[str, Any]:
        text = """<mujoco><worldbody>PLANE<site name="hook" pos="0 0 2"/>
          <body name="rod"><freejoint/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 1"/>
          <site name="x" pos="0 0 0"/><site name="y" pos="0 0 1"/></body></worldbody>
          <tendon><spatial stiffness="9" springlength="0 1"><site site="hook"/><site site="x"/></spatial>
          <spatial stiffness="9" springlength="0 1"><site site="hook"/><site site="y"/></spatial></tendon>
          </mujoco>"""
        return load(tmp_path, change(text).replace("PLANE", "")).document

    mass = 1000 * math.pi * 0.02**2 * (1 + 4 / 3 * 0.02)
    bar = read(lambda text: text)
    assert "bodies" not in bar
    ends = sum(bar["nodes"][name]["mass"] for name in "xy")
    assert bar["members"]["rod"]["mass"] + ends == pytest.approx(mass, rel=1e-12)
    for old, new in (
        ('name="y" pos="0 0 1"', 'name="y" pos="0.01 0 1"'),
        ("PLANE", '<geom type="plane" size="1 1 1"/>'),
        ("</worldbody>", '</worldbody><keyframe><key qvel="0 0 0 0 0 9"/></keyframe>'),
    ):
        body = read(lambda text, old=old, new=new: text.replace(old, new))["bodies"]["rod"]
        assert body["mass"] == pytest.approx(mass, rel=1e-12)
        assert set(body["points"]) >= {"x", "y"}
    assert body["angular_velocity"] == [0, 0, 9]
