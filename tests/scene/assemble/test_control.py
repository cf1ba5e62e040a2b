"""Actuators, sensors and limits of scenes: names, ranges, and what is refused."""

import math

import numpy as np
import pytest

from tensegrity_codegen.structure.actuators import Actuator, Sensor
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.body_scenes import EVERYTHING, assemble_document
from tests.free_body_cases import make_dropped_robot
from tests.scene.samples import WHERE, build, changed


def with_actuators(*stated):
    return build(changed("actuators", to=list(stated)))[0]


def with_sensors(*stated):
    return build(changed("sensors", to=list(stated)))[0]


def test_actuators_are_the_last_inputs_in_their_order():
    structure = with_actuators(
        {"name": "m1", "members": "strings", "rate": 0.05, "range": [0.2, 3], "delay": 0.1},
        {"name": "m2", "members": ["ac"]},
    )
    assert structure.actuators == (
        Actuator("m1", (1, 2), 0.05, (0.2, 3.0), 0.1),
        Actuator("m2", (0,), math.inf, (0.0, math.inf), 0.0),
    )
    assert [item.name for item in structure.inputs] == ["u1", "push", "m1", "m2"]
    assert [item.kind for item in structure.inputs[2:]] == ["rest_length", "rest_length"]
    assert [item.targets for item in structure.inputs[2:]] == [(1, 2), (0,)]


def test_actuators_of_tendons():
    system, _ = assemble_document(
        {**EVERYTHING, "actuators": [{"name": "motor", "members": ["t1"], "rate": 0.1}]}
    )
    number = system.member_name.index("t1")
    assert system.actuators == (Actuator("motor", (number,), 0.1),)
    assert (system.inputs[-1].name, system.inputs[-1].kind) == ("motor", "rest_length")


@pytest.mark.parametrize(
    ("change", "error", "key", "words"),
    [
        ({"members": ["abb"]}, UnknownNameError, "members", "'ab'"),
        (
            {"members": ["ab", "strings"]},
            DuplicateNameError,
            "members",
            "'ab' is listed twice, by 'ab' and by 'strings'",
        ),
        ({"members": ["ab", "ab"]}, DuplicateNameError, "members", "twice"),
        ({"members": []}, InvalidValueError, "members", "at least 1"),
        ({"members": 3}, InvalidValueError, "members", "a list"),
        ({"name": "u1"}, DuplicateNameError, "name", "an input already"),
        ({"name": "motor 1"}, InvalidNameError, "name", "not a valid name"),
        ({"rate": 0}, InvalidValueError, "rate", "greater than 0"),
        ({"rate": -0.1}, InvalidValueError, "rate", "greater than 0"),
        ({"rate": math.nan}, NonFiniteError, "rate", "finite"),
        ({"rate": "fast"}, InvalidValueError, "rate", "a number"),
        ({"range": [0.4, 0.2]}, InvalidValueError, "range", "[0.2, 0.4]"),
        ({"range": [0.4, 0.4]}, InvalidValueError, "range", "less than"),
        ({"range": [-0.4, 0.4]}, InvalidValueError, "range[0]", "greater than 0"),
        ({"range": [0.1, 0.2, 0.3]}, InvalidValueError, "range", "at most 2"),
        ({"range": [0.1, math.inf]}, NonFiniteError, "range[1]", "finite"),
        ({"range": 0.3}, InvalidValueError, "range", "a list"),
        ({"delay": -1}, InvalidValueError, "delay", "not less than 0"),
        ({"speed": 1}, UnknownKeyError, "speed", "rate"),
    ],
)
def test_wrong_actuators(change, error, key, words):
    with pytest.raises(error) as caught:
        with_actuators({"name": "m", "members": ["ab"], **change})
    assert caught.value.where == f"{WHERE}: actuators[0].{key}"
    assert words in str(caught.value)


def test_two_actuators_of_one_name():
    item = {"name": "m", "members": ["ab"]}
    with pytest.raises(DuplicateNameError, match="another actuator"):
        with_actuators(item, item)


def test_rigid_bars_have_no_actuator():
    rigid = changed("classes", "strut", to={"kind": "bar", "mass": 0.1})
    rigid["actuators"] = [{"name": "m", "members": ["ac"]}]
    with pytest.raises(InvalidValueError, match="a rigid bar has no rest length to change: ac"):
        build(rigid)


def test_an_empty_class_is_no_list_of_members():
    document = changed("classes", "unused", to={"kind": "cable", "spring_constant": 1.0})
    document["actuators"] = [{"name": "m", "members": ["unused"]}]
    with pytest.raises(InvalidValueError, match="without members"):
        build(document)


def test_sensors():
    structure = with_sensors(
        {"kind": "member_length", "members": "strings", "noise": 1e-4},
        {"kind": "member_tension", "members": "all", "name": "gauges"},
        {"kind": "node_position", "nodes": "all"},
        {"kind": "node_velocity", "nodes": ["c"]},
    )
    assert structure.sensors == (
        Sensor("member_length", (1, 2), 1e-4),
        Sensor("member_tension", (0, 1, 2), 0.0, "gauges"),
        Sensor("node_position", (0, 1, 2)),
        Sensor("node_velocity", (2,)),
    )


def test_sensors_of_bodies():
    system, _ = assemble_document(
        {
            **EVERYTHING,
            "sensors": [
                {"kind": "member_tension", "members": ["t1"]},
                {"kind": "node_position", "points": "leg.A"},
                {"kind": "node_velocity", "nodes": "all"},
            ],
        }
    )
    assert system.sensors[1].targets == (system.find_node("leg_A"),)
    assert system.sensors[2].targets == tuple(range(system.n_nodes))


@pytest.mark.parametrize(
    ("stated", "error", "key", "words"),
    [
        ({"kind": "member_length", "members": ["strngs"]}, UnknownNameError, "members", "'strings'"),
        ({"kind": "member_lenght", "members": ["ab"]}, InvalidValueError, "", "member_length"),
        ({"members": ["ab"]}, InvalidValueError, "", "kind"),
        ({"kind": "member_length", "nodes": ["a"]}, UnknownKeyError, "nodes", "members"),
        ({"kind": "node_position"}, InvalidValueError, "nodes", "missing"),
        ({"kind": "node_position", "nodes": ["d"]}, UnknownNameError, "nodes", "'a'"),
        ({"kind": "node_position", "nodes": ["a", "a"]}, DuplicateNameError, "nodes", "twice"),
        ({"kind": "node_position", "points": ["a.A"]}, InvalidValueError, "points", "'nodes'"),
        ({"kind": "member_length", "members": ["ab"], "noise": -1}, InvalidValueError, "noise", "not less"),
        ({"kind": "member_length", "members": ["ab", "string"]}, DuplicateNameError, "members", "'string'"),
    ],
)
def test_wrong_sensors(stated, error, key, words):
    with pytest.raises(error) as caught:
        with_sensors(stated)
    assert caught.value.where.startswith(f"{WHERE}: sensors[0]" + (f".{key}" if key else ""))
    assert words in str(caught.value)


def test_two_sensors_of_one_name():
    item = {"kind": "member_length", "members": ["ab"], "name": "s"}
    with pytest.raises(DuplicateNameError, match="two sensors under one name"):
        with_sensors(item, item)


@pytest.mark.parametrize("stated", [{"kind": "node_position", "nodes": ["a"]}, {"kind": "node_position"}])
def test_sensors_of_bodies_are_at_points(stated):
    with pytest.raises(InvalidValueError, match="points"):
        assemble_document({**EVERYTHING, "sensors": [stated]})


ROUND = changed("classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01})


def limits(base=ROUND, **stated):
    return build(changed("limits", to=stated, base=base))[0].limits


def test_a_scene_without_limits_has_none():
    found = build(ROUND)[0].limits
    assert not found.is_stated
    np.testing.assert_array_equal(found.least_tension, [-math.inf] * 3)
    np.testing.assert_array_equal(found.most_tension, [math.inf] * 3)
    np.testing.assert_array_equal(found.yield_stress, [math.inf] * 3)
    np.testing.assert_array_equal(found.buckling, [0.0] * 3)
    assert (found.clearance, found.least_stiffness) == (-math.inf, -math.inf)


def test_limits_of_all_members_are_of_those_that_can_have_them():
    found = limits(least_tension=1, most_tension=30, yield_stress=2e8, buckling=True, clearance=0.002)
    np.testing.assert_array_equal(found.least_tension, [-math.inf, 1, 1])
    np.testing.assert_array_equal(found.most_tension, [math.inf, 30, 30])
    np.testing.assert_array_equal(found.yield_stress, [2e8, math.inf, math.inf])
    np.testing.assert_array_equal(found.buckling, [1, 0, 0])
    assert found.is_stated
    assert (found.clearance, found.least_stiffness) == (0.002, -math.inf)


def test_members_override_classes_and_classes_override_all():
    found = limits(
        least_tension=1,
        most_tension=30,
        buckling=2,
        least_stiffness=0,
        classes={"string": {"least_tension": 2}, "strut": {"buckling": False, "most_tension": 7}},
        members={"ab": {"least_tension": 3, "most_tension": 40}},
    )
    np.testing.assert_array_equal(found.least_tension, [-math.inf, 2, 3])
    np.testing.assert_array_equal(found.most_tension, [7, 30, 40])
    np.testing.assert_array_equal(found.buckling, [-math.inf, 0, 0])
    assert found.least_stiffness == 0


@pytest.mark.parametrize(
    ("stated", "error", "key", "words"),
    [
        ({"least_tension": -1}, InvalidValueError, "least_tension", "not less than 0"),
        ({"most_tension": 0}, InvalidValueError, "most_tension", "greater than 0"),
        ({"yield_stress": -2e8}, InvalidValueError, "yield_stress", "greater than 0"),
        ({"clearance": -0.002}, InvalidValueError, "clearance", "not less than 0"),
        ({"least_stiffness": -1}, InvalidValueError, "least_stiffness", "not less than 0"),
        ({"buckling": 0.5}, InvalidValueError, "buckling", "not less than 1"),
        ({"buckling": "yes"}, InvalidValueError, "buckling", "a number"),
        ({"least_tension": math.nan}, NonFiniteError, "least_tension", "finite"),
        ({"min_tension": 1}, UnknownKeyError, "min_tension", "least_tension"),
        ({"least_tension": 5, "most_tension": 4}, InvalidValueError, "least_tension", "at most 4 N"),
        ({"members": {"abb": {"least_tension": 1}}}, UnknownNameError, "members.abb", "'ab'"),
        ({"members": {"string": {}}}, UnknownNameError, "members.string", "[limits.classes.string]"),
        ({"classes": {"strin": {}}}, UnknownNameError, "classes.strin", "'string'"),
        ({"classes": {"ab": {}}}, UnknownNameError, "classes.ab", "[limits.members.ab]"),
        ({"classes": {"strings": {}}}, UnknownNameError, "classes.strings", "is a group"),
        (
            {"classes": {"strut": {"least_tension": 1}}},
            InvalidValueError,
            "classes.strut.least_tension",
            "a bar has no least tension: ac",
        ),
        ({"members": {"ac": {"least_tension": 1}}}, InvalidValueError, "members.ac.least_tension", "bar"),
        ({"members": {"ab": {"yield_stress": 1}}}, InvalidValueError, "members.ab.yield_stress", "radius"),
        ({"members": {"ab": {"buckling": True}}}, InvalidValueError, "members.ab.buckling", "cable"),
        ({"members": {"ab": {"clearance": 1}}}, UnknownKeyError, "members.ab.clearance", "least_tension"),
        ({"members": 4}, InvalidValueError, "members", "a table"),
    ],
)
def test_wrong_limits(stated, error, key, words):
    with pytest.raises(error) as caught:
        limits(**stated)
    assert caught.value.where == f"{WHERE}: limits.{key}"
    assert words in str(caught.value)


def test_the_least_tension_of_a_member_is_compared_with_the_largest_of_its_class():
    with pytest.raises(InvalidValueError) as caught:
        limits(classes={"string": {"most_tension": 20}}, members={"bc": {"least_tension": 21}})
    assert caught.value.where == f"{WHERE}: limits.members.bc.least_tension"
    assert "at most 20 N, the value of limits.classes.string.most_tension" in str(caught.value)


@pytest.mark.parametrize("key", ["yield_stress", "buckling"])
def test_limits_of_sections_need_a_radius(key):
    with pytest.raises(InvalidValueError, match="radius"):
        limits(base=changed("name", to="arch"), **{key: 2.0})


def test_a_clearance_needs_a_radius_of_some_bar():
    bars = changed("members", "bc", to={"class": "strut", "nodes": ["b", "c"]})
    bars["limits"] = {"clearance": 0.01}
    for document in (bars, make_dropped_robot() | {"limits": {"clearance": 0.01}}):
        with pytest.raises(InvalidValueError, match="no bar has a radius") as caught:
            build(document)
        assert "clearances are of bars, not of bodies" in caught.value.hint


def test_rigid_bars_have_no_euler_load():
    rigid = changed("classes", "strut", to={"kind": "bar", "mass": 0.1, "radius": 0.01})
    with pytest.raises(InvalidValueError, match="no stiffness"):
        limits(base=rigid, members={"ac": {"buckling": True}})


def test_limits_of_tendons():
    system, _ = assemble_document(
        {**EVERYTHING, "limits": {"least_tension": 1, "members": {"t1": {"most_tension": 9}}}}
    )
    number = system.member_name.index("t1")
    np.testing.assert_array_equal(system.limits.least_tension, np.ones(system.n_members))
    assert system.limits.most_tension[number] == 9
    with pytest.raises(InvalidValueError, match="bodies"):
        assemble_document({**EVERYTHING, "limits": {"buckling": True}})
