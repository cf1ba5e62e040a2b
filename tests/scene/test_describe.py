"""From structures back to scene documents: actuators, sensors, limits and the ground, bit by bit."""

import dataclasses
import math
import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.describe import describe_bodies, describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, assemble_document, example
from tests.cases import draws
from tests.free_body_cases import make_dropped_robot
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


ROUND_BARS = changed(
    "classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01}
)
ROUND_BARS["nodes"]["b"]["mass"] = 0.2
SIZES = st.floats(1e-6, 1e6)
PARTS = st.floats(-1, 1).filter(lambda x: abs(x) > 1e-3)
TABLES = st.fixed_dictionaries(
    {"stiffness": SIZES, "normal": st.tuples(PARTS, PARTS, PARTS).map(list), "offset": st.floats(-9, -4)},
    optional={
        "contacts": st.sampled_from(["all", ["c"], ["b", "c"]]),
        "radius": st.floats(0, 1) | st.just("bar"),
        "exponent": st.sampled_from([1, 1.5]),
        "restitution": st.fixed_dictionaries({"value": st.floats(0.01, 0.99), "speed": SIZES}),
        "friction": st.floats(0.1, 2),
        "static_friction": st.floats(2, 3),
        "stick_stiffness": SIZES,
        "stick_damping": SIZES,
    },
)


def write_and_read(document: dict[str, Any]) -> Ground | None:
    return build(tomllib.loads(format_scene(document)))[0].ground


@draws(50)
@given(TABLES)
def test_written_and_read_back(table: dict[str, Any]) -> None:
    if "friction" not in table:
        table.pop("static_friction", None)
    if not table.get("stick_stiffness"):
        table["stick_stiffness"] = 1.0  # a normal may point down, where no weight gives one
    structure, request = build(changed("ground", to=table, base=ROUND_BARS))
    assert structure.ground is not None
    again = write_and_read(describe_structure(structure, request))
    assert again == structure.ground


def test_a_slope_a_belt_and_a_penetration_become_numbers() -> None:
    table = {
        "slope_deg": 20, "penetration": 1e-4, "offset": -3, "contacts": ["c"], "friction": 0.5,
        "velocity": [0.93969262, 0.3, -0.34202014], "restitution": {"value": 0.6, "speed": 3},
    }  # fmt: skip
    structure, request = build(changed("ground", to=table, base=ROUND_BARS))
    written = describe_structure(structure, request)["ground"]
    assert written["normal"] == [math.sin(math.radians(20)), 0.0, math.cos(math.radians(20))]
    assert written["contacts"] == "all"  # b cannot move along the normal
    assert not {"slope_deg", "penetration", "restitution"} & set(written)
    assert write_and_read(describe_structure(structure, request)) == structure.ground


def test_all_contacts_and_radii_of_bars_are_written_as_words() -> None:
    table = {"normal": [0, 1, 1], "stiffness": 1, "offset": -1, "radius": "bar"}
    structure, _ = build(changed("ground", to=table, base=ROUND_BARS))
    written = describe_structure(structure)["ground"]
    assert (written["contacts"], written["radius"]) == ("all", "bar")


def test_contacts_stay_listed_where_a_body_touches_nothing() -> None:
    document = make_dropped_robot()
    for k in (1, 2):
        points = document["bodies"][f"rod{k}"]["points"]
        sharp = {name: point for name, point in points.items() if not isinstance(point, dict)}
        document["bodies"][f"rod{k}"] |= {"points": sharp}
    document["ground"]["contacts"] = ["rod0.low", "rod0.high"]
    structure, request = build(document)
    written = describe_structure(structure, request)
    assert written["ground"]["contacts"] == ["rod0.low", "rod0.high"]
    assert write_and_read(written) == structure.ground


def test_other_radii_cannot_be_written() -> None:
    structure, _ = build(
        changed("ground", to={"normal": [0, 1, 1], "stiffness": 1, "offset": -1}, base=ROUND_BARS)
    )
    assert structure.ground is not None
    values = {name: getattr(structure.ground, name) for name in structure.ground.__dataclass_fields__}
    odd = structure.with_changes(ground=Ground(**(values | {"radius": np.array([0.1, 0.2])})))
    with pytest.raises(InvalidValueError, match="a scene cannot state"):
        describe_structure(odd)


def test_ground_of_bodies_written_and_read_back() -> None:
    ground = {
        "stiffness": 1e4,
        "offset": -3,
        "contacts": ["stick.A", "mast.B"],
        "friction": 0.4,
        "radius": "bar",
    }
    system, request = assemble_document({**EVERYTHING, "ground": ground})
    written = describe_bodies(system, request)
    assert written["ground"]["contacts"] == ["mast.B", "stick.A"]
    assert written["ground"]["radius"] == "bar"
    again, _ = assemble_bodies(parse_scene(tomllib.loads(format_scene(written))))
    assert again.ground == system.ground


def test_the_scene_itself_keeps_its_table() -> None:
    table = {"slope_deg": 20, "stiffness": 1e4, "restitution": {"value": 0.6, "speed": 3}}
    scene = parse_scene({**ROUND_BARS, "ground": table})
    assert tomllib.loads(scene.to_toml())["ground"] == table


def test_the_hash_of_a_scene_changes_with_its_ground() -> None:
    plain, request = build(ROUND_BARS)
    one, two = (build(changed("ground", to={"stiffness": k}, base=ROUND_BARS))[0] for k in (1e4, 2e4))
    assert len({hash_scene(item, request) for item in (plain, one, two)}) == 3


def read_back(system: BodySystem, request: ModelRequest) -> tuple[BodySystem, ModelRequest]:
    return assemble_bodies(parse_scene(tomllib.loads(format_scene(describe_bodies(system, request)))))


@pytest.mark.parametrize("name", ["everything", "lin_prism", "svd_tower"])
def test_bodies_in_full_written_and_read_back(name: str) -> None:
    if name == "everything":
        system, request = assemble_document(
            {**EVERYTHING, "parameters": {"rest_length": "all"}, "groups": {"some": ["t1", "t3"]}}
        )
    else:
        system, request = example(name), ModelRequest(("acceleration",), formulation="bodies")
    again, request_again = read_back(system, request)
    assert request_again == request
    for key in ("name", "node_name", "member_name", "coordinate_name", "loads", "friction", "groups"):
        assert getattr(again, key) == getattr(system, key), key
    for key in ("node_local", "node_load", "gravity", "connectivity", "rest_length", "spring_constant",
                "axial_stiffness", "damping", "tension_only"):  # fmt: skip
        np.testing.assert_array_equal(getattr(again, key), getattr(system, key), err_msg=key)
    np.testing.assert_allclose(again.coordinate, system.coordinate, rtol=4e-16, atol=1e-18)
    np.testing.assert_allclose(again.velocity, system.velocity, rtol=4e-16)
    for one, two in zip(again.bodies, system.bodies, strict=True):
        assert type(one) is type(two)
        assert one.name == two.name
    for one, two in zip(again.inputs, system.inputs, strict=True):
        assert (one.name, one.kind, one.targets, one.frame) == (two.name, two.kind, two.targets, two.frame)
        assert one.direction == pytest.approx(two.direction, abs=1e-15)
