"""Actuators, sensors and limits survive being written as a scene and read back."""

import dataclasses
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.describe_bodies import describe_bodies
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, assemble_document
from tests.cases import draws
from tests.scene.samples import build, changed

ROUND = changed("classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01})
CONTROL = {
    "actuators": [
        {"name": "m1", "members": "strings", "rate": 0.05, "range": [0.2, 3], "delay": 0.1},
        {"name": "m2", "members": ["ab", "ac"]},
    ],
    "sensors": [
        {"kind": "member_length", "members": "strings", "noise": 1e-4},
        {"kind": "node_position", "nodes": ["c", "a"], "name": "camera", "noise": 1e-3},
    ],
    "limits": {
        "least_tension": 1, "most_tension": 30, "yield_stress": 2e8, "clearance": 0, "least_stiffness": 0,
        "classes": {"string": {"most_tension": 20}, "strut": {"buckling": 2, "most_tension": 100}},
        "members": {"ab": {"least_tension": 0}},
    },
}  # fmt: skip


def check_same(one, two):
    """Check that two subjects have the same inputs, actuators, sensors and limits, bit by bit."""
    for key in ("actuators", "sensors"):
        assert getattr(one, key) == getattr(two, key), key
    inputs, others = ([(item.name, item.kind, item.targets) for item in x.inputs] for x in (one, two))
    assert inputs == others
    for item in dataclasses.fields(one.limits):
        np.testing.assert_array_equal(getattr(one.limits, item.name), getattr(two.limits, item.name))


def read_again(document):
    return build(tomllib.loads(format_scene(document)))[0]


def test_nodes_and_members_written_and_read_back():
    structure, request = build({**ROUND, **CONTROL})
    check_structure(structure)
    text = format_scene(describe_structure(structure, request))
    assert "[limits.members]\nac = { most_tension = 100.0 }\n" in text
    check_same(structure, read_again(describe_structure(structure, request)))


def test_bodies_written_and_read_back():
    document = {
        **EVERYTHING,
        "actuators": [{"name": "motor", "members": ["t1"], "rate": 0.1, "range": [0.1, 1]}],
        "sensors": [
            {"kind": "member_tension", "members": "all"},
            {"kind": "node_position", "points": "leg.A"},
        ],
        "limits": {"least_tension": 1, "members": {"t1": {"most_tension": 9}}},
    }
    system, request = assemble_document(document)
    again, _ = assemble_bodies(parse_scene(tomllib.loads(format_scene(describe_bodies(system, request)))))
    check_same(system, again)


positive = st.floats(1e-300, 1e300)
of_cable = {"most_tension": st.floats(1e10, 1e20), "least_tension": st.floats(0, 1e9)}
of_bar = {"most_tension": positive, "yield_stress": positive, "buckling": st.floats(1, 1e9) | st.booleans()}


def tables(keys):
    return st.fixed_dictionaries({}, optional=keys)


@draws(25)
@given(
    tables({**of_cable, "yield_stress": positive, "buckling": st.booleans(), "clearance": st.just(0.0)}),
    tables(of_bar),
    tables(of_cable),
    st.dictionaries(st.sampled_from(["ab", "bc"]), tables(of_cable)),
    tables(of_bar),
)
def test_any_limits_are_written_and_read_back(all_members, strut, string, cables, bar):
    limits = {
        **all_members,
        "classes": {"strut": strut, "string": string},
        "members": {**cables, "ac": bar},
    }
    structure, _ = build(changed("limits", to=limits, base=ROUND))
    check_structure(structure)
    check_same(structure, read_again(describe_structure(structure)))


def test_changes_of_the_structure_keep_its_limits():
    structure, _ = build({**ROUND, **CONTROL})
    moved = structure.with_changes(node_position=structure.node_position + 1000)
    check_same(structure, moved)


@pytest.mark.parametrize("key", ["sensors", "limits"])
def test_libraries_do_not_depend_on_sensors_and_limits(key):
    request = ModelRequest(("member_tension",))
    assert hash_scene(build({**ROUND, key: CONTROL[key]})[0], request) == hash_scene(build(ROUND)[0], request)


def test_libraries_depend_on_the_members_of_actuators_only():
    def hash_of(**change):
        document = changed("actuators", to=[{"name": "m", "members": ["ab"], **change}], base=ROUND)
        return hash_scene(build(document)[0], ModelRequest(("member_tension",)))

    assert hash_of() == hash_of(rate=0.1) == hash_of(range=[1, 2]) == hash_of(delay=1)
    assert hash_of() != hash_of(members=["bc"])
    inputs = [*ROUND["inputs"], {"name": "m", "kind": "rest_length", "members": ["ab"]}]
    same = build(changed("inputs", to=inputs, base=ROUND))[0]
    assert hash_of() == hash_scene(same, ModelRequest(("member_tension",)))


def test_what_the_members_of_a_class_have_alike_stands_in_the_class() -> None:
    limits = {"classes": {"string": {"yield_stress": 1e8}}, "members": {"ab": {"most_tension": 30}}}
    string = {"kind": "cable", "spring_constant": 70.0, "radius": 0.002}
    structure, request = build({**ROUND, "classes": {**ROUND["classes"], "string": string}, "limits": limits})
    strings = [e for e, name in enumerate(structure.member_class) if name == "string"]
    assert len(strings) > 1
    document = describe_structure(structure, request)
    assert document["classes"]["string"] == string
    for e in strings:
        assert set(document["members"][structure.member_name[e]]) == {"class", "nodes", "rest_length"}
    assert document["limits"] == {
        "classes": {"string": {"yield_stress": 1e8}},
        "members": {"ab": {"most_tension": 30.0}},
    }
    again = read_again(document)
    for name in ("spring_constant", "radius", "rest_length", "member_class"):
        np.testing.assert_array_equal(getattr(again, name), getattr(structure, name))
    check_same(structure, again)
