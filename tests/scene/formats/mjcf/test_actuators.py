"""Actuators of MJCF on tendons: rest lengths and servos with the forces of MuJoCo; others are named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError
from tests.scene.formats.mjcf.models import ROBOT, load

# The force on a tendon of length 0.7, 2 m/s, in MuJoCo and by the members between its sites.
LENGTH, RATE = 0.7, 2.0
TWO = """<mujoco>{}<worldbody><site name="hook" pos="0 0 2"/>
  <body name="ball" pos="0 0 1.3"><freejoint/><geom size="0.1" contype="0" conaffinity="0"/>
  <site name="x"/></body>
  </worldbody><tendon><spatial name="t" {}><site site="hook"/><site site="x"/></spatial></tendon>
  <actuator>{}</actuator></mujoco>"""
TENDONS = {
    "cable": 'stiffness="300" damping="3" springlength="0 0.6"',
    "spring": 'stiffness="300" damping="3" springlength="0.6"',
    "slack": 'stiffness="300" springlength="0 0.9"',
    "loose": 'damping="1"',
}
AFFINE = 'biastype="affine"'
ACTUATORS = {
    "motor": '<motor name="u" tendon="t" gear="-20"/>',
    "filtered": '<general name="u" tendon="t" gainprm="-30" dyntype="filter" dynprm="0.2"/>',
    "position": '<position name="u" tendon="t" kp="200" kv="1.5"/>',
    "limited": '<position name="u" tendon="t" kp="200" ctrlrange="0.2 0.5"/>',
    "geared": f'<general name="u" tendon="t" gear="2" gainprm="50" {AFFINE} biasprm="4 -60 -1"/>',
    "offset": f'<general name="u" tendon="t" gainprm="-90" {AFFINE} biasprm="8 0 -2"/>',
    "lagging": '<position name="u" tendon="t" kp="200" timeconst="0.3"/>',
    "speed": '<velocity name="u" tendon="t" kv="40"/>',
}
CASES = [
    (tendon, actuator)
    for tendon in TENDONS
    for actuator in ACTUATORS
    # Forces alone act on taut tendons as changes of rest length, and have no member on loose ones.
    if tendon in ("cable", "spring") or actuator in ("position", "limited", "geared", "lagging")
]


def compute_pull(document: dict[str, Any], value: float) -> float:
    """Return the sum of the tensions of all members at the length and rate of the tests; value: of u."""
    total = 0.0
    for name, member in document["members"].items():
        rest = member["rest_length"]
        for entry in [*document.get("inputs", []), *document.get("actuators", [])]:
            if name in entry["members"]:
                rest += value * entry.get("gain", [1.0])[0]
        elongation = LENGTH - rest
        if elongation > 0 or member.get("tension_only") is False:
            total += member["spring_constant"] * elongation + member.get("damping", 0.0) * RATE
    return total


def find_value(notes: tuple[str, ...], control: float) -> float:
    """Return the value of the input for a control of the model, as a note states it."""
    for note in notes:
        if note.startswith("values of actuators are "):
            law = note.removeprefix("values of actuators are ").partition(": ")[0]
            factor, _, law = law.partition(" m times ") if " m times " in law else ("1", "", law)
            less = float(law.strip("()").removeprefix("control - ")) if law.startswith("(") else 0.0
            return float(factor) * (control - less)
    return control


@pytest.mark.peers
@pytest.mark.parametrize(("tendon", "actuator"), CASES)
def test_forces_of_actuators_are_those_of_mujoco(tendon: str, actuator: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    text = TWO.format("", TENDONS[tendon], ACTUATORS[actuator])
    result = load(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[2] = -RATE
    for control in (0.25, 0.4):
        data.ctrl[:] = control
        if model.na:
            data.act[:] = control
        mujoco.mj_forward(model, data)
        force = data.qfrc_actuator[2] + data.qfrc_passive[2]
        own = compute_pull(result.document, find_value(result.notes, control))
        if tendon in ("slack", "loose"):  # where cables here have no damping, MuJoCo has
            damping = float(model.tendon_damping[0])
            force -= damping * RATE if tendon == "slack" else 0.0
        assert own == pytest.approx(force, rel=1e-5, abs=1e-9)  # as exact as the number of the note


def test_motors_change_the_rest_length_by_their_force_over_the_stiffness(tmp_path: Path) -> None:
    document = load(tmp_path, TWO.format("", TENDONS["cable"], ACTUATORS["motor"])).document
    assert document["inputs"] == [{"name": "u", "kind": "rest_length", "members": ["t"], "gain": [-20 / 300]}]
    document = load(tmp_path, TWO.format("", TENDONS["cable"], ACTUATORS["filtered"])).document
    assert document["actuators"] == [{"name": "u", "members": ["t"], "time_constant": 0.2}]


def test_servos_are_springs_beside_cables_and_part_of_springs(tmp_path: Path) -> None:
    result = load(tmp_path, TWO.format("", TENDONS["cable"], ACTUATORS["limited"]))
    servo = {"kind": "cable", "nodes": ["hook", "x"], "spring_constant": 200, "rest_length": 0.2}
    assert result.document["members"]["t_servo"] == {**servo, "tension_only": False}
    assert result.document["members"]["t"]["spring_constant"] == 300
    assert result.document["actuators"] == [{"name": "u", "members": ["t_servo"], "range": [0.2, 0.5]}]
    assert "values of actuators are (control - 0.2): u" in result.notes
    pulling = ACTUATORS["limited"].replace("/>", ' forcerange="-50 0"/>')
    result = load(tmp_path, TWO.format("", TENDONS["spring"], pulling))
    assert result.document["members"]["t_servo"] == servo
    assert any(note.startswith("position forcerange is not read") for note in result.notes)
    document = load(tmp_path, TWO.format("", TENDONS["spring"], ACTUATORS["limited"])).document
    assert list(document["members"]) == ["t"]
    assert document["members"]["t"]["spring_constant"] == 500
    np.testing.assert_allclose(document["members"]["t"]["rest_length"], (300 * 0.6 + 200 * 0.2) / 500)
    np.testing.assert_allclose(document["actuators"][0]["range"], [0.44, 0.56])


def test_actuators_of_a_robot_and_what_is_left_out(tmp_path: Path) -> None:
    result = load(tmp_path, ROBOT)
    document = result.document
    entries = {entry["name"]: entry for entry in [*document["inputs"], *document["actuators"]]}
    assert list(entries) == ["winch", "both", "servo", "pull"]
    assert entries["servo"] == {"name": "servo", "members": ["a_servo"], "range": [0.1, 0.3]}
    assert entries["pull"]["time_constant"] == 0.05  # of the default class
    np.testing.assert_allclose(entries["pull"]["range"], [0.8 - 5 * 14 / 700, 0.8])
    assert document["members"]["over"]["nodes"] == ["rod0.top", "hook", "rod1.top"]
    assert "line" not in document["members"]
    assert "far" not in document["nodes"]
    for note in (
        "tendons without stiffness are left out, with their forces: line",
        "actuators that are not read, for a tendon without stiffness: free",
        "actuators that are not read, for the law of <muscle>: muscle",
        "a default class gives a lag to actuators <general> only, as in MuJoCo, and not to "
        "servo, winch, both, free, muscle",
    ):
        assert note in result.notes


def test_a_model_that_only_forces_hold_together_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="a force and no stiffness") as caught:
        load(tmp_path, TWO.format("", TENDONS["loose"], ACTUATORS["motor"]))
    assert caught.value.given == "t"
    text = TWO.replace('<site name="x"/>', '<site name="x" pos="0 0 0.1"/>')
    idle = load(tmp_path, text.format("", TENDONS["loose"], ""))
    assert list(idle.document["bodies"]) == ["ball"]


def test_sensors_are_those_of_points_bodies_and_members(tmp_path: Path) -> None:
    result = load(tmp_path, ROBOT)
    assert result.document["sensors"] == [
        {"kind": "node_position", "name": "p", "nodes": ["rod0.in"]},
        {"kind": "angular_velocity", "name": "g", "bodies": ["rod0"], "noise": 0.01},
        {"kind": "member_length", "name": "l", "members": ["c"]},
        {"kind": "member_tension", "name": "f", "members": ["a_servo"]},
    ]
    assert "sensors that are not read, for the kind <tendonvel>: v" in result.notes
    turned = load(tmp_path, ROBOT.replace('<site name="rod0_out"', '<site name="rod0_out" euler="0 90 0"'))
    assert any("gyros of the body: g" in note for note in turned.notes)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<freejoint/>", "<freejoin/>", ("body rod0: MuJoCo has no such element", "'freejoint'")),
        ("<motor name", "<moter name", ("actuator: MuJoCo has no such element", "'motor'")),
        ("<framepos", "<framepoz", ("sensor: MuJoCo has no such element", "'framepos'")),
        ('objname="rod0_in"', 'objname="rod0_im"', ("sensor p: unknown site", "'rod0_in'")),
        ('name="l" tendon="c"', 'name="l" tendon="cc"', ("sensor l: unknown tendon", "'c'")),
        ('"winch" tendon="b"', '"winch" tendon="bb"', ("actuator[2] winch: unknown tendon", "'b'")),
        ("0.1 0.3", "0.3 0.1", ("actuator[0] servo.ctrlrange: the ends", "[0.3, 0.1]")),
        (
            'stiffness="700"',
            'stiffness="-700"',
            ("tendon.spatial[2] c: stiffness: the value is out of range",),
        ),
        ("</mujoco>", '<keyframe><key ctrl="1 2"/></keyframe></mujoco>', ("keyframe.key.ctrl", "6")),
    ],
)
def test_misspelt_models_are_refused_by_name(
    tmp_path: Path, old: str, new: str, words: tuple[str, ...]
) -> None:
    with pytest.raises(TensegrityError) as caught:
        load(tmp_path, ROBOT.replace(old, new))
    assert all(word in str(caught.value) for word in words)


def test_actuators_that_are_not_read_have_a_reason(tmp_path: Path) -> None:
    result = load(tmp_path, ROBOT.replace('kp="400"', 'kp="-400"'))
    reason = "a stiffness or damping below 0, such as kp or kv"
    assert f"actuators that are not read, for {reason}: servo" in result.notes
    assert "sensors that are not read, for an actuator that is no servo: f" in result.notes


def test_the_keyframe_gives_the_controls_at_the_start(tmp_path: Path) -> None:
    """Rest lengths of servos are their controls, within their ranges, of winches r - 50 u / 500."""
    frame = '<keyframe><key name="home" ctrl="{} 0 -0.2 0.15 0 0" ctr="1"/></keyframe></mujoco>'
    for control, rest in ((0.25, 0.25), (0.7, 0.3)):
        result = load(tmp_path, ROBOT.replace("</mujoco>", frame.format(control)))
        members = result.document["members"]
        assert members["a_servo"]["rest_length"] == rest
        assert members["b"]["rest_length"] == pytest.approx(0.2 + 0.2 * 50 / 500)
        assert f"values of actuators are (control - {rest:g}): servo" in result.notes
        assert "rest lengths at the start are those of the ctrl of the keyframe 'home'" in result.notes
        assert "key ctr is not read, though it acts in MuJoCo: home (1)" in result.notes
        assert result.document["actuators"][0]["range"] == pytest.approx([0.1, 0.3])
