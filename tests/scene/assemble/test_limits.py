"""Limits of a scene: the most specific one counts, and what is refused."""

import math

import numpy as np
import pytest

from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.body_scenes import EVERYTHING, assemble_document
from tests.scene.samples import WHERE, build, changed

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
    with pytest.raises(InvalidValueError, match="no bar has a radius"):
        build(bars)


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
