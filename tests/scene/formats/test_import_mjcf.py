"""Models of MuJoCo: those of the exporter come back, others are read or refused by the element's name."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tensegrity_codegen import compile_scene, load_scene, simulate
from tensegrity_codegen.cli.verbs.examples import read_example
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    UnknownNameError,
)
from tests.export.test_export_mjcf import build_scene
from tests.scene.formats.mjcf.models import ROBOT

TEXT = """<mujoco model="two rods">
  <compiler angle="degree"/>
  <option timestep="1e-3" gravity="0 0 -5"/>
  <default>
    <site size="0.01"/>
    <default class="rope"><tendon stiffness="300" damping="0.5"/></default>
    <default class="rod"><geom type="capsule" size="0.02" density="700"/></default>
  </default>
  <worldbody>
    <site name="hook" pos="0 0 2"/>
    <body name="rod1" pos="0 0 1" euler="0 90 0" childclass="rod">
      <freejoint/>
      <geom name="g1" fromto="0 0 -0.5 0 0 0.5" mass="0.6"/>
      <site name="a" pos="0 0 -0.5"/><site name="b" pos="0 0 0.5"/><site name="mark" pos="0 0 0"/>
    </body>
    <body name="rod2" pos="0.1 0.5 0.2" axisangle="0 1 0 90">
      <joint type="free"/>
      <inertial pos="0 0 0" mass="0.9" diaginertia="0.075 0.075 1e-6"/>
      <site name="c" pos="0 0 -0.5"/><site name="d" pos="0 0 0.5"/>
    </body>
    <body name="bob" pos="0.3 -0.4 0.6">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 -1"/>
      <inertial pos="0 0 0" mass="0.2" diaginertia="1 1 1"/>
      <body name="tip" pos="0 0 0.1"><site name="e"/></body>
    </body>
    <body name="pivot" pos="-1 0 0" zaxis="1 0 0">
      <joint type="ball"/>
      <inertial pos="0 0 0.4" mass="0.6" diaginertia="0.032 0.032 1e-6"/>
      <site name="foot"/><site name="head" pos="0 0 0.8"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="t1" class="rope" springlength="0 0.9"><site site="hook"/><site site="a"/></spatial>
    <spatial name="t2" class="rope" springlength="0 0.9"><site site="hook"/><site site="b"/></spatial>
    <spatial name="t3" class="rope" springlength="0 0.7"><site site="a"/><site site="c"/></spatial>
    <spatial name="t4" class="rope" springlength="0 0.7"><site site="b"/><site site="d"/></spatial>
    <spatial name="t5" stiffness="50" springlength="0 0.4"><site site="c"/><site site="e"/></spatial>
    <spatial name="t6" stiffness="40"><site site="e"/><site site="head"/></spatial>
    <spatial name="t7" stiffness="30" springlength="0.5"><site site="foot"/><site site="c"/></spatial>
  </tendon>
  <actuator>
    <general name="weight" site="e" refsite="hook" gear="0 0 -1 0 0 0" gainprm="0" biastype="affine"
             biasprm="2"/>
    <motor name="push" site="e" refsite="hook" gear="1 0 0 0 0 0"/>
    <general name="winch" tendon="t5" gainprm="50"/>
    <position name="servo" tendon="t6" kp="10"/>
  </actuator>
  <keyframe><key name="start" qvel="0.1 0 0 0 0.2 0.3  0 0 0 0 0 0  0.5 0.25  0 0.1 0"/></keyframe>
</mujoco>
"""


def load(tmp_path: Path, text: str | bytes, **options: Any) -> Any:
    path = tmp_path / "model.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return read_files([path], **options)


def build(document: dict[str, Any]) -> Structure:
    return assemble(parse_scene(document))[0]


def by_name(structure: Structure, field: str, names: tuple[str, ...]) -> Any:
    """Return the rows of an array in the order of `names` of nodes or members."""
    own = structure.node_name if field.startswith("node") else structure.member_name
    return getattr(structure, field)[[own.index(name) for name in names]]


@pytest.mark.parametrize("source", ["prism", "icosahedron", "tower", "planar", "ring"])
def test_exported_scenes_come_back(source: str, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    from tensegrity_codegen import read_scene

    text = read_scene(build_scene()).to_toml() if source == "ring" else read_example(source)
    scene.write_text(text, encoding="utf-8")
    old, request = load_scene(scene)
    assert isinstance(old, Structure)
    write_export("mjcf", ExportSource(scene, old, request), tmp_path / "model.xml")
    new = build(read_files([tmp_path / "model.xml"]).document)
    moving = ~old.node_anchored.all(axis=1)
    for field in ("node_position", "node_velocity", "node_mass", "node_load"):
        rows = by_name(new, field, old.node_name)
        np.testing.assert_allclose(rows[moving], getattr(old, field)[moving], rtol=1e-12, atol=1e-12)
    for field in ("is_bar", "tension_only"):
        np.testing.assert_array_equal(by_name(new, field, old.member_name), getattr(old, field))
    for field in ("mu", "rest_length", "damping", "member_mass"):
        np.testing.assert_allclose(by_name(new, field, old.member_name), getattr(old, field), rtol=1e-12)
    assert new.gravity.tolist() == old.gravity.tolist()
    assert sorted(item.name for item in new.inputs) == sorted(item.name for item in old.inputs)


def test_exported_bodies_come_back(tmp_path: Path) -> None:
    text = parse_scene(load(tmp_path, ROBOT).document).to_toml()
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    old, request = load_scene(tmp_path / "scene.toml")
    assert isinstance(old, Structure)
    write_export("mjcf", ExportSource(tmp_path / "scene.toml", old, request), tmp_path / "again.xml")
    new = build(read_files([tmp_path / "again.xml"]).document)
    assert {*old.node_name} - {*new.node_name} == {"rod0_in"}  # of a sensor, which the file has not
    for one, other in zip(old.bodies, new.bodies, strict=True):
        np.testing.assert_allclose(other.inertia, one.inertia, rtol=1e-12, atol=1e-18)
        assert other.mass == pytest.approx(one.mass, rel=1e-14)
        assert other.name == one.name
    places = by_name(old, "node_position", new.node_name)
    np.testing.assert_allclose(new.node_position, places, atol=1e-12)
    for field in ("mu", "rest_length", "tension_only", "damping"):
        np.testing.assert_allclose(by_name(new, field, old.member_name), getattr(old, field), rtol=1e-12)
    assert new.ground is not None
    assert old.ground is not None
    np.testing.assert_allclose(new.ground.normal, old.ground.normal, atol=1e-15)
    assert new.ground.friction == old.ground.friction


def test_bars_on_an_exported_ground_come_back_as_bars(tmp_path: Path) -> None:
    ground = {"slope_deg": 10.0, "offset": -0.05, "stiffness": 2e4, "friction": 0.5, "radius": 0.01}
    document = {
        "name": "on_ground", "gravity": [0.0, 0.0, -9.81], "ground": ground,
        "model": {"formulation": "rigid_bar"},
        "shape": {"kind": "prism", "bottom_radius": 0.2, "height": 0.3},
        "classes": {
            "bar": {"kind": "bar", "mass": 0.1},
            "cable": {"kind": "cable", "spring_constant": 200.0, "rest_length": 0.2},
        },
    }  # fmt: skip
    scene = parse_scene(document)
    (tmp_path / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    old, request = assemble(scene)
    write_export("mjcf", ExportSource(tmp_path / "scene.toml", old, request), tmp_path / "model.xml")
    new = build(read_files([tmp_path / "model.xml"]).document)
    assert not new.bodies
    assert new.n_members == old.n_members
    assert old.ground is not None
    assert new.ground is not None
    height = [
        structure.node_position @ structure.ground.normal - structure.ground.offset - structure.ground.radius
        for structure in (old, new)
        if structure.ground is not None
    ]
    own = [new.node_name.index(name) for name in old.node_name]
    np.testing.assert_allclose(height[1][own], height[0], atol=1e-12)


def test_rods_points_and_tendons_become_a_scene(tmp_path: Path) -> None:
    result = load(tmp_path, TEXT)
    new = build(result.document)
    names = ("hook", "a", "b", "c", "d", "e", "foot", "head")
    np.testing.assert_allclose(
        by_name(new, "node_position", names),
        [
            *([0, 0, 2], [-0.5, 0, 1], [0.5, 0, 1], [-0.4, 0.5, 0.2], [0.6, 0.5, 0.2]),
            *([0.3, -0.4, 0.7], [-1, 0, 0], [-0.2, 0, 0]),
        ],
        atol=1e-12,
    )
    assert new.gravity.tolist() == [0, 0, -5]
    bars = ("rod1", "rod2", "pivot")
    assert by_name(new, "is_rigid", bars).all()
    # A capsule of length 1 between its half balls of radius 0.02: share of the balls, inertia across.
    ball = 4 * 0.02 / (4 * 0.02 + 3)
    across = (1 - ball) * (3 * 0.02**2 + 1) / 12 + ball * (0.4 * 0.02**2 + (3 * 0.02 + 2) / 8)
    own = 6 * 0.6 * (0.25 - across)
    np.testing.assert_allclose(by_name(new, "member_mass", bars), [own, 0.9, 0.6])
    np.testing.assert_allclose(
        by_name(new, "node_mass", ("a", "b", "c")), [*[(0.6 - own) / 2] * 2, 0], atol=1e-15
    )
    assert by_name(new, "mu", ("t1", "t5", "t6")).tolist() == [300, 50, 50]
    assert by_name(new, "damping", ("t1", "t5")).tolist() == [0.5, 0]
    present = np.hypot(np.hypot(0.5, 0.4), 0.7)  # of t6, on which a servo of 10 N/m acts, its control is 0
    np.testing.assert_allclose(by_name(new, "rest_length", ("t1", "t6", "t7")), [0.9, 0.8 * present, 0.5])
    assert by_name(new, "tension_only", ("t1", "t6", "t7")).tolist() == [True, False, False]
    held = by_name(new, "node_anchored", ("hook", "e", "foot", "a"))
    assert held.tolist() == [[True] * 3, [False, True, False], [True] * 3, [False] * 3]
    np.testing.assert_allclose(by_name(new, "node_velocity", ("e", "head"))[0], [0.5, 0, -0.25])
    assert by_name(new, "node_mass", ("e",)).tolist() == [0.2]
    assert by_name(new, "node_load", ("e",)).tolist() == [[0, 0, -2]]
    kinds = {"push": "force", "winch": "rest_length", "servo": "rest_length"}
    assert {item.name: item.kind for item in new.inputs} == kinds
    assert result.document["inputs"][-1]["gain"] == [0.2]
    assert any("keep their damping while slack" in note for note in result.notes)
    assert not any("spread evenly" in note for note in result.notes)
    assert read_files([tmp_path / "model.xml"], gravity=[0, 0, -1]).document["gravity"] == [0, 0, -1]


def test_a_rod_with_masses_at_its_ends_has_its_inertia(tmp_path: Path) -> None:
    own, ends, length = 0.5, np.array([0.1, 0.3]), 1.0
    total = own + ends.sum()
    centre = (own * length / 2 + ends[1] * length) / total
    across = (
        own * length**2 / 12 + own * (0.5 - centre) ** 2 + ends[0] * centre**2 + ends[1] * (1 - centre) ** 2
    )
    inertial = f'pos="0 0 {centre - 0.5}" mass="{total}" diaginertia="{across} {across} 1e-7"'
    text = TEXT.replace('pos="0 0 0" mass="0.9" diaginertia="0.075 0.075 1e-6"', inertial)
    new = build(load(tmp_path, text).document)
    np.testing.assert_allclose(by_name(new, "node_mass", ("c", "d")), ends, rtol=1e-9)
    np.testing.assert_allclose(by_name(new, "member_mass", ("rod2",)), own, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('<site site="a"/></spatial>', '<site site="zz"/></spatial>', UnknownNameError, "unknown site"),
        ('<site site="a"/></spatial>', '<geom geom="g1"/></spatial>', InvalidValueError, "around geoms"),
        ('<site site="a"/></spatial>', '<pulley divisor="2"/></spatial>', InvalidValueError, "pulleys"),
        ('class="rope" springlength="0 0.9"', 'class="wire" springlength="0 0.9"', UnknownNameError, "class"),
        ('springlength="0 0.4"', 'springlength="0 x"', InvalidValueError, "not numbers"),
        ('name="t2"', 'name="t1"', DuplicateNameError, "one name"),
        ("<freejoint/>", '<joint type="hinge"/>', InvalidValueError, "joints are not read"),
        ('axis="1 0 0"', 'axis="1 1 0"', InvalidValueError, "axis of the world"),
        ('axis="1 0 0"', 'axis="0 0 1"', InvalidValueError, "axis of the world"),
        ('<site name="mark" pos="0 0 0"/>', '<site name="e2" pos="0 0 0"/>', None, ""),
        ('<site name="foot"/>', '<site name="foot" pos="0 0 0.1"/>', InvalidValueError, "ball joint"),
        ('name="g1" fromto="0 0 -0.5 0 0 0.5"', 'type="mesh" mesh="m"', InvalidValueError, "not known"),
        ('mass="0.9"', 'mass="nan"', SceneError, "not finite"),
        ('euler="0 90 0"', 'euler="0 90"', InvalidValueError, "not numbers"),
        ('angle="degree"', 'eulerseq="xqz"', InvalidValueError, "sequence"),
        ('gravity="0 0 -5"', 'gravity="0 0"', InvalidValueError, "not numbers"),
        ("<mujoco ", "<!DOCTYPE a><mujoco ", SceneError, "document types"),
    ],
)
def test_what_is_not_read_is_refused_by_its_element(
    old: str, new: str, error: type[SceneError] | None, words: str, tmp_path: Path
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    if error is None:
        load(tmp_path, text)
        return
    with pytest.raises(error, match=words) as caught:
        load(tmp_path, text)
    assert "model.xml" in caught.value.where


def test_a_rod_with_sites_off_its_axis_has_its_centre_between_them_and_a_note(tmp_path: Path) -> None:
    text = TEXT.replace('name="c" pos="0 0 -0.5"', 'name="c" pos="0.03 0 -0.5"')
    result = load(tmp_path, text.replace('name="d" pos="0 0 0.5"', 'name="d" pos="0.03 0 0.5"'))
    (note,) = [note for note in result.notes if "off the line" in note]
    assert "the centre of mass of rod2 is 0.03 m off the line between its sites c and d" in note
    nodes = result.document["nodes"]
    assert math.dist(nodes["c"]["position"], nodes["d"]["position"]) == pytest.approx(1.0)
    assert not any("off the line" in note for note in load(tmp_path, TEXT).notes)
    far = text.replace('name="d" pos="0 0 0.5"', 'name="d" pos="0.3 0 0.5"')
    assert set(load(tmp_path, far).document["bodies"]) == {"rod2"}


LIMITED = """<mujoco model="limited">
  <compiler angle="radian"/>
  <option gravity="0 0 -5" density="1.2" wind="0 0 0"><flag gravity="disable" spring="disable"/></option>
  <default>
    <joint damping="0.5" armature="0"/><motor gear="2 0 0 0 0 0"/>
    <default class="tight"><joint stiffness="7"/><tendon frictionloss="3"/></default>
  </default>
  <worldbody>
    <site name="a" euler="0 0 1.5707963267948966"/>
    <site name="hang" type="capsule" size="0.01" fromto="0 0 1 0 2 1"/>
    <body name="b" pos="0 0 -1" gravcomp="0.5" childclass="tight">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0" class="main" damping="0 0 0" range="-1 1"/>
      <joint type="slide" axis="0 0 1" range="-1 1" limited="false"/>
      <geom type="ellipsoid" fromto="0 0 -0.5 0 0 0.5" size="0.02"/><site name="b"/>
    </body>
    <body name="p" pos="1 0 0">
      <joint name="hinge" type="ball" pos="0 0 0.5"/><geom type="box" fromto="0 0 0.5 0 0 -0.5" size="0.02"/>
      <site name="p0" pos="0 0 0.5"/><site name="p1" pos="0 0 -0.5"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope" stiffness="10" springlength="0 1" range="0 1.05">
      <site site="hang"/><site site="b"/></spatial>
    <spatial name="t" class="tight" stiffness="9" springlength="0 1">
      <site site="b"/><site site="p1"/></spatial>
  </tendon>
  <actuator>
    <motor name="push" site="b" refsite="a" ctrlrange="0 1"/>
    <motor name="inner" site="p1" refsite="b"/>
    <general name="integral" dyntype="integrator" site="b" refsite="a"/>
  </actuator>
</mujoco>
"""


def test_what_acts_in_mujoco_and_is_not_read_is_named(tmp_path: Path) -> None:
    notes = load(tmp_path, LIMITED).notes
    mark = " is not read, though it acts in MuJoCo: "
    assert dict(note.split(mark) for note in notes if mark in note) == {
        "option density": "(1.2)",
        "flag spring": "(disable)",
        "body gravcomp": "b (0.5)",
        "joint damping": "x (0.5), b (0.5), hinge (0.5)",
        "joint stiffness": "x (7), b (7)",
        "joint range": "y (-1 1)",
        "spatial range": "rope (0 1.05)",
        "spatial frictionloss": "t (3)",
        "motor ctrlrange": "push (0 1)",
    }
    reason = "on no spatial tendon, nor on a site with a fixed refsite"
    assert f"actuators that are not read, for {reason}: inner" in notes
    assert "actuators that are not read, for the law of <general>: integral" in notes
    plain = TEXT.replace('damping="0.5"', 'damping="0.5" range="0 1" armature="0" limited="auto"')
    assert [note for note in load(tmp_path, plain).notes if mark in note] == [
        f"spatial range{mark}t1 (0 1), t2 (0 1), t3 (0 1), t4 (0 1)"
    ]
    off = plain.replace('<compiler angle="degree"', '<compiler angle="degree" autolimits="false"')
    assert not [note for note in load(tmp_path, off).notes if mark in note]


def check_against_mujoco(document: dict[str, Any], masses: list[float], places: list[list[float]]) -> None:
    new = build(document)
    ends = by_name(new, "node_mass", ("p_pivot", "p1"))
    own = [*by_name(new, "node_mass", ("b",)), *(by_name(new, "member_mass", ("p",)) + ends.sum())]
    np.testing.assert_allclose(own, masses, rtol=1e-12)
    np.testing.assert_allclose(by_name(new, "node_position", ("hang", "p_pivot", "p1")), places, atol=1e-15)
    assert by_name(new, "node_anchored", ("p_pivot", "p1")).tolist() == [[True] * 3, [False] * 3]


def test_frames_classes_and_sizes_between_points_are_those_of_mujoco(tmp_path: Path) -> None:
    document = load(tmp_path, LIMITED).document
    masses = [4 / 3 * math.pi * 0.02**2 * 0.5 * 1000, 0.04**2 * 1000]
    check_against_mujoco(document, masses, [[0, 1, 1], [1, 0, 0.5], [1, 0, -0.5]])
    assert "gravity" not in document
    (push,) = document["inputs"]
    assert push["name"] == "push"
    np.testing.assert_allclose(push["direction"], [0, 2, 0], atol=1e-15)


@pytest.mark.peers
def test_masses_places_and_forces_are_those_of_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    model = mujoco.MjModel.from_xml_string(LIMITED)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1
    mujoco.mj_forward(model, data)
    places = [data.site(name).xpos.tolist() for name in ("hang", "p0", "p1")]
    document = load(tmp_path, LIMITED).document
    check_against_mujoco(document, model.body_mass[1:].tolist(), places)
    np.testing.assert_allclose(document["inputs"][0]["direction"], data.qfrc_actuator[:3], atol=1e-14)


def test_a_sliding_rod_is_refused_with_what_to_try(tmp_path: Path) -> None:
    text = TEXT.replace('<site name="c"', '<body><joint type="slide"/><site name="c2"/></body><site name="c"')
    with pytest.raises(InvalidValueError, match="slides on a turning one") as caught:
        load(tmp_path, text)
    assert "rigid bar" in caught.value.hint


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=30))
def test_hostile_names_become_names_of_a_scene(tmp_path: Path, word: str) -> None:
    from xml.sax.saxutils import quoteattr

    quoted = quoteattr(word + "~")
    text = TEXT.replace('"hook"', quoted).replace('name="t1"', f"name={quoted}").replace('"push"', quoted)
    scene = parse_scene(load(tmp_path, text).document)
    assert len(scene.nodes) == 8
    assert len(scene.members) == 10
    assert len(scene.inputs) == 3


@pytest.mark.peers
def test_the_imported_model_moves_as_in_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    inertial = '<inertial pos="0 0 0" mass="0.6" diaginertia="0.05 0.05 1e-6"/>'
    changes = {
        '<general name="winch" tendon="t5" gainprm="50"/>': "",
        '<position name="servo" tendon="t6" kp="10"/>': "",
        'damping="0.5"': "",  # which slack tendons keep in MuJoCo
        'mass="0.6"/>\n      <site name="a"': 'mass="0"/>\n      <site name="a"',
        '<geom name="g1"': f'{inertial}<geom name="g1"',
        "<option ": '<option integrator="RK4" ',
        "<worldbody>": '<option><flag contact="disable"/></option><worldbody>',
    }
    text = TEXT
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    result = load(tmp_path, text)
    document = {**result.document, "model": {"formulation": "rigid_bar"}}
    model = compile_scene(document, for_="simulate", method="rk853")
    own = simulate(model, t_end=0.3, samples=4, method="rk853", rtol=1e-9)
    other = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(other)
    errors = []
    for step in (1e-4, 5e-5):
        other.opt.timestep = step
        mujoco.mj_resetDataKeyframe(other, data, 0)
        data.qpos[:] = other.qpos0
        mujoco.mj_step(other, data, nstep=round(0.3 / step))
        mujoco.mj_kinematics(other, data)
        ids = [mujoco.mj_name2id(other, mujoco.mjtObj.mjOBJ_SITE, name) for name in own.node_name]
        errors.append(float(np.abs(data.site_xpos[ids] - own.node_position[-1]).max()))
    assert max(errors) < 5e-6, errors


def test_elements_and_classes_have_a_limited_number_of_attributes(tmp_path: Path) -> None:
    many = " ".join(f'a{k}="1"' for k in range(60))
    few = load(tmp_path, TEXT.replace('<site name="hook"', f'<site {many} name="hook"'))
    assert sum("site a" in note for note in few.notes) == 60
    for old, new in (
        ('<site name="hook"', f'<site {many} b="1" c="1" d="1" name="hook"'),
        ('<site size="0.01"/>', f'<site {many}/><site b="1" c="1" d="1" e="1" f="1"/>'),
    ):
        with pytest.raises(SceneError, match="too many attributes") as caught:
            load(tmp_path, TEXT.replace(old, new))
        assert caught.value.where.endswith("model.xml: site")
        assert caught.value.given == 65


def test_bodies_of_a_model_become_bodies_of_a_structure(tmp_path: Path) -> None:
    new = build(load(tmp_path, ROBOT).document)
    assert [body.name for body in new.bodies] == ["rod0", "rod1"]
    for body in new.bodies:
        assert body.mass == pytest.approx(0.24)
        np.testing.assert_allclose(
            body.inertia, np.diag([3.792002666667e-3, 3.792002666667e-3, 3.3816e-5]), atol=1e-14
        )
    assert by_name(new, "node_position", ("hook",)).tolist() == [[0, 0, 1]]
    assert new.ground is not None
    assert new.ground.stiffness == 5000
    assert [sensor.kind for sensor in new.sensors][:2] == ["node_position", "angular_velocity"]
    assert [actuator.name for actuator in new.actuators] == ["servo", "pull"]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=30))
def test_hostile_names_of_bodies_become_names_of_a_scene(tmp_path: Path, word: str) -> None:
    from xml.sax.saxutils import quoteattr

    text = ROBOT
    for old in ('"rod0"', '"rod1_in"', '"low_rod0"', '"servo"', '"winch"', '"g"', '"a"'):
        text = text.replace(old, quoteattr(f"{word}~{old[1:-1]}"))
    structure = build(load(tmp_path, text).document)
    assert len(structure.bodies) == 2
    assert len(structure.actuators) == 2
    assert structure.n_members - 12 == 6  # six edges hold each body


@pytest.mark.peers
def test_imported_bodies_move_as_in_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    # Slack tendons of MuJoCo keep their damping, those with one length push though they run over sites.
    text = ROBOT.replace('damping="3"', "").replace(
        'cone="elliptic"/>', '><flag contact="disable"/></option>'
    )
    text = text.replace('<muscle name="muscle" tendon="c"/>', "")
    document = {**load(tmp_path, text).document, "model": {"formulation": "rigid_bar"}}
    own = simulate(
        compile_scene(document, for_="simulate", method="rk853"),
        t_end=0.1,
        samples=3,
        method="rk853",
        rtol=1e-9,
    )
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 1e-5
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("servo").id] = 0.1  # the end of its range nearest to 0
    data.ctrl[model.actuator("both").id] = 0.0
    mujoco.mj_step(model, data, nstep=10000)
    mujoco.mj_kinematics(model, data)
    for name in ("rod0_out", "rod0_in", "rod0_top", "rod1_in", "rod1_top"):
        place = own.node_position[-1, own.node_name.index(name)]
        np.testing.assert_allclose(place, data.site(name).xpos, atol=1e-6)
    assert np.abs(own.node_position[-1] - own.node_position[0]).max() > 0.05
