"""Pairs of bars that may touch, and the ground of scenes: defaults, values, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.body_scenes import EVERYTHING, assemble_document
from tests.scene.samples import WHERE, build, changed


def scene(**more: Any) -> dict[str, Any]:
    nodes = {f"n{k}": {"position": [k % 2, k // 2, 0.1 * k], "mass": 1.0} for k in range(8)}
    members = {
        f"b{k}": {
            "kind": "bar",
            "spring_constant": 1e3,
            "radius": 0.01,
            "nodes": [f"n{2 * k}", f"n{2 * k + 1}"],
        }
        for k in range(4)
    }
    del members["b3"]["radius"]
    members["b4"] = {"kind": "bar", "spring_constant": 1e3, "radius": 0.01, "nodes": ["n0", "n7"]}
    members["c0"] = {"kind": "cable", "spring_constant": 10.0, "nodes": ["n1", "n2"]}
    for k in range(2, 8):
        members[f"c{k}"] = {"kind": "cable", "spring_constant": 10.0, "nodes": [f"n{k}", f"n{(k + 3) % 8}"]}
    return {"name": "bars", "nodes": nodes, "members": members, **more}


def build_pairs(pairs: Any) -> Structure:
    return assemble(parse_scene(scene(interference={"pairs": pairs})))[0]


def named(structure: Structure) -> list[list[str]]:
    return [[structure.member_name[e] for e in pair] for pair in structure.bar_pairs]


def test_all_pairs_are_those_of_bars_with_a_radius_that_share_no_node() -> None:
    expected = [["b0", "b1"], ["b0", "b2"], ["b1", "b2"], ["b1", "b4"], ["b2", "b4"]]
    assert named(assemble(parse_scene(scene()))[0]) == expected
    assert named(build_pairs("all")) == expected


def test_chosen_pairs_keep_their_order_and_survive_description() -> None:
    structure = build_pairs([["b2", "b0"], ["b1", "b4"]])
    assert named(structure) == [["b2", "b0"], ["b1", "b4"]]
    again = assemble(parse_scene(describe_structure(structure)))[0]
    assert named(again) == named(structure)


def test_the_force_between_bars_is_written_back() -> None:
    stated = {"stiffness": 2e4, "exponent": 1.5, "restitution": {"value": 0.6, "speed": 3.132}}
    structure = assemble(parse_scene(scene(interference=stated)))[0]
    assert structure.collision is not None
    assert (structure.collision.stiffness, structure.collision.exponent) == (2e4, 1.5)
    assert structure.collision.dissipation == pytest.approx(0.31125, rel=1e-4)  # e(sqrt(2 g 0.5 m)) = 0.6
    again = assemble(parse_scene(describe_structure(structure)))[0]
    assert again.collision == structure.collision
    assert assemble(parse_scene(scene()))[0].collision is None


@pytest.mark.parametrize(
    ("stated", "key"),
    [
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": 1e4, "exponent": 2.0}, "exponent"),
        ({"stiffness": 1e4, "dissipation": -1.0}, "dissipation"),
        ({"stiffness": 1e4, "dissipation": 1.0, "restitution": {"value": 0.5, "speed": 1.0}}, "dissipation"),
        ({"stiffness": 1e4, "restitution": {"value": 1.0, "speed": 1.0}}, "restitution.value"),
        ({"dissipation": 1.0}, "dissipation"),
        ({"exponent": 1.5}, "exponent"),
    ],
)
def test_impossible_forces_between_bars_are_named(stated: Any, key: str) -> None:
    with pytest.raises(SceneError) as caught:
        assemble(parse_scene(scene(interference=stated)))
    assert f"interference.{key}" in str(caught.value)


def test_no_pairs_at_all() -> None:
    assert named(build_pairs([])) == []


@pytest.mark.parametrize(
    ("pairs", "error", "said"),
    [
        ([["b0", "b9"]], UnknownNameError, "known:"),
        ([["b0", "c0"]], UnknownNameError, "no bar"),
        ([["b0", "b3"]], InvalidValueError, "no radius"),
        ([["b0", "b4"]], InvalidValueError, "share a node"),
        ([["b0", "b0"]], InvalidValueError, "share a node"),
        ([["b0", "b1"], ["b1", "b0"]], DuplicateNameError, "twice"),
        ([["b0"]], InvalidValueError, "interference.pairs"),
        ("some", InvalidValueError, "interference.pairs"),
    ],
)
def test_pairs_that_cannot_be_watched_are_refused(pairs: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error) as caught:
        build_pairs(pairs)
    assert said in str(caught.value)
    assert "interference.pairs" in str(caught.value)


# Two anchors on the ground; b slides in y; c (0.5 kg and half of a bar of 0.1 kg) is free.
ROUND = changed("classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01})
ROUND["nodes"]["b"]["mass"] = 0.2
MASS_C = 0.55
PLANAR: dict[str, Any] = {
    "name": "swing",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {
        "a": {"position": [0, 1], "anchored": True},
        "b": {"position": [0.5, 0.5], "mass": 2.0},
        "c": {"position": [-0.5, 0.5], "mass": 1.0},
    },
    "members": {
        "ab": {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 100.0},
        "ac": {"kind": "cable", "nodes": ["a", "c"], "spring_constant": 100.0},
    },
}


def ground(base: dict[str, Any] = ROUND, **stated: Any) -> Ground:
    found = build(changed("ground", to=stated, base=base))[0].ground
    assert found is not None
    return found


def body_ground(**stated: Any) -> Ground:
    found = assemble_document({**EVERYTHING, "ground": stated})[0].ground
    assert found is not None
    return found


def test_a_scene_without_the_table_has_no_ground() -> None:
    assert build(ROUND)[0].ground is None
    assert assemble_document(EVERYTHING)[0].ground is None


def test_defaults() -> None:
    found = ground(stiffness=1e4)
    assert found.normal.tolist() == [0, 0, 1]
    assert (found.offset, found.velocity.tolist()) == (0.0, [0, 0, 0])
    assert found.node.tolist() == [2]  # a is anchored, b along z
    assert found.radius.tolist() == [0.0]
    assert (found.stiffness, found.exponent, found.dissipation) == (1e4, 1.0, 0.0)
    assert (found.friction, found.static_friction) == (0.0, None)
    assert found.stick_stiffness == 1e4
    assert found.stick_damping == pytest.approx(2 * math.sqrt(1e4 * MASS_C), rel=1e-14)


def test_every_number_that_is_stated_is_kept() -> None:
    found = ground(
        normal=[0, 3, 4], offset=-2.5, velocity=[0.7, 0.4, -0.3], contacts=["c", "b"], radius=0.02,
        stiffness=1e5, exponent=1.5, dissipation=0.4, friction=0.4, static_friction=0.6,
        stick_stiffness=2e4, stick_damping=7,
    )  # fmt: skip
    np.testing.assert_allclose(found.normal, [0, 0.6, 0.8], rtol=1e-15)
    assert (found.offset, found.velocity.tolist()) == (-2.5, [0.7, 0.4, -0.3])
    assert (found.node.tolist(), found.radius.tolist()) == ([1, 2], [0.02, 0.02])
    assert (found.stiffness, found.exponent, found.dissipation) == (1e5, 1.5, 0.4)
    assert (found.friction, found.static_friction) == (0.4, 0.6)
    assert (found.stick_stiffness, found.stick_damping) == (2e4, 7.0)


@pytest.mark.parametrize(
    ("axes", "normal"),
    [
        ("xyz", [math.sin(math.radians(20)), 0, math.cos(math.radians(20))]),
        ("xz", [math.sin(math.radians(20)), 0, math.cos(math.radians(20))]),
    ],
)
def test_a_slope_descends_along_the_first_axis(axes: str, normal: list[float]) -> None:
    base = PLANAR if axes == "xz" else ROUND
    found = ground(base, slope_deg=20, stiffness=1e4, offset=-3)
    np.testing.assert_allclose(found.normal, normal, rtol=1e-15)
    downhill = np.array([math.cos(math.radians(20)), 0, -math.sin(math.radians(20))])
    assert abs(downhill @ found.normal) < 1e-16


def test_the_last_axis_of_a_planar_scene_is_up() -> None:
    document = changed("axes", to="xy", base=PLANAR)
    assert ground(document, stiffness=1e4).normal.tolist() == [0, 1, 0]
    assert ground(document, normal=[-1, 1], stiffness=1e4).normal == pytest.approx([-(0.5**0.5), 0.5**0.5, 0])


def test_a_belt_in_rounded_numbers_is_put_into_the_plane() -> None:
    found = ground(slope_deg=20, stiffness=1e4, offset=-3, velocity=[0.93969262, 0, -0.34202014])
    assert abs(found.velocity @ found.normal) < 1e-15
    np.testing.assert_allclose(found.velocity, [0.93969262, 0, -0.34202014], atol=1e-8)
    assert ground(stiffness=1e4, velocity=[0.1, 0.2, 0]).velocity.tolist() == [0.1, 0.2, 0.0]


def test_all_contacts_are_the_nodes_that_can_move_along_the_normal() -> None:
    assert ground(stiffness=1e4).node.tolist() == [2]
    assert ground(normal=[0, 1, 1], stiffness=1e4, offset=-1).node.tolist() == [1, 2]  # b is free along y
    assert ground(PLANAR, stiffness=1e4).node.tolist() == [1, 2]
    assert ground(PLANAR, stiffness=1e4, contacts=["c"]).node.tolist() == [2]


def test_the_radius_of_bars() -> None:
    strut = {"class": "strut", "nodes": ["b", "c"], "radius": 0.03}
    base = changed("members", "bc", to=strut, base=changed("inputs", to=[], base=ROUND))
    found = ground(base, normal=[0, 1, 1], stiffness=1e4, radius="bar", offset=-1)
    assert found.radius.tolist() == [0.03, 0.03]
    found = ground(ROUND, normal=[0, 1, 1], stiffness=1e4, radius="bar", offset=-1)
    assert found.radius.tolist() == [0.0, 0.01]  # no bar ends at b


@pytest.mark.parametrize("exponent", [1, 1.5])
def test_a_penetration_gives_the_stiffness_that_carries_equal_parts_of_the_weight(exponent: float) -> None:
    found = ground(PLANAR, penetration=1e-4, exponent=exponent)
    force = found.stiffness * 1e-4**exponent
    assert 2 * force == pytest.approx(3.0 * 9.81, rel=1e-14)
    tilted = ground(PLANAR, penetration=1e-4, exponent=exponent, slope_deg=30)
    assert tilted.stiffness == pytest.approx(found.stiffness * math.cos(math.radians(30)), rel=1e-14)


def test_the_tangential_stiffness_is_the_slope_of_the_normal_force_at_rest() -> None:
    found = ground(PLANAR, stiffness=1e6, exponent=1.5, friction=0.3)
    force = 3.0 * 9.81 / 2

    def depth(normal_force: float) -> float:
        return (normal_force / 1e6) ** (2 / 3)

    slope = 2e-5 * force / (depth(force * (1 + 1e-5)) - depth(force * (1 - 1e-5)))
    assert found.stick_stiffness == pytest.approx(slope, rel=1e-8)
    assert found.stick_damping == pytest.approx(2 * math.sqrt(found.stick_stiffness * 1.5), rel=1e-14)


def test_a_restitution_gives_the_dissipation() -> None:
    found = ground(stiffness=1e4, restitution={"value": 0.6, "speed": math.sqrt(9.81)})
    assert found.dissipation == pytest.approx(0.311252583112, rel=1e-11)


def test_static_friction_equal_to_friction_is_none() -> None:
    assert ground(stiffness=1e4, friction=0.4, static_friction=0.4).static_friction is None


def test_contacts_of_bodies_are_points() -> None:
    names = assemble_document(EVERYTHING)[0].node_name
    found = body_ground(stiffness=1e4, offset=-3)
    assert [names[node] for node in found.node] == [
        "leg_A", "mast_B", "boom_B", "stick_A", "stick_B", "plate_corner", "plate_edge",
    ]  # fmt: skip
    chosen = body_ground(stiffness=1e4, offset=-3, contacts=["plate.centre", "stick.B"], radius=0.1)
    assert {names[node] for node in chosen.node} == {"plate_centre", "stick_B"}
    assert chosen.radius.tolist() == [0.1, 0.1]
    assert chosen.stick_damping == pytest.approx(2 * math.sqrt(1e4 * (0.8 + 0.3) / 2), rel=1e-14)


def test_bars_of_bodies_have_their_radius_at_both_ends_and_at_the_point_that_holds_them() -> None:
    found = body_ground(stiffness=1e4, offset=-3, radius="bar", contacts=["mast.B", "boom.B"])
    assert sorted(found.radius.tolist()) == [0.0, 0.01]


def test_a_penetration_of_bodies_counts_the_masses_of_moving_bodies() -> None:
    system = assemble_document({**EVERYTHING, "ground": {"penetration": 1e-3, "offset": -3}})[0]
    assert system.ground is not None
    mast = 1800 * math.pi * (0.01**2 - 0.005**2) * 1.1
    total = 0.4 + mast + 0.2 + 0.3 + 0.8
    assert system.ground.stiffness == pytest.approx(total * 9.81 / (7 * 1e-3), rel=1e-12)


BAD: dict[str, tuple[dict[str, Any], type[SceneError], str, str]] = {
    "no stiffness": ({}, InvalidValueError, "stiffness", "one of stiffness [N/m] and penetration"),
    "two stiffnesses": ({"stiffness": 1, "penetration": 1}, InvalidValueError, "penetration", "given twice"),
    "friction below 0": ({"friction": -0.1}, InvalidValueError, "friction", "not less than 0"),
    "static below kinetic": (
        {"friction": 0.5, "static_friction": 0.4}, InvalidValueError, "static_friction", "at least 0.5"
    ),
    "static alone": ({"static_friction": 0.4}, InvalidValueError, "static_friction", "without friction"),
    "stiffness 0": ({"stiffness": 0}, InvalidValueError, "stiffness", "greater than 0"),
    "penetration 0": ({"stiffness": None, "penetration": 0}, InvalidValueError, "penetration", "greater"),
    "stiffness below 0": ({"stiffness": -1}, InvalidValueError, "stiffness", "greater than 0"),
    "stick stiffness 0": ({"stick_stiffness": 0}, InvalidValueError, "stick_stiffness", "greater than 0"),
    "stick damping 0": ({"stick_damping": 0}, InvalidValueError, "stick_damping", "greater than 0"),
    "dissipation below 0": ({"dissipation": -1}, InvalidValueError, "dissipation", "not less than 0"),
    "restitution 1": (
        {"restitution": {"value": 1, "speed": 1}}, InvalidValueError, "restitution.value", "less than 1"
    ),
    "restitution 0": (
        {"restitution": {"value": 0, "speed": 1}}, InvalidValueError, "restitution.value", "greater than 0"
    ),
    "restitution at no speed": (
        {"restitution": {"value": 0.5}}, InvalidValueError, "restitution.speed", "add"
    ),
    "restitution at rest": (
        {"restitution": {"value": 0.5, "speed": 0}}, InvalidValueError, "restitution.speed", "greater than 0"
    ),
    "restitution as a number": ({"restitution": 0.5}, InvalidValueError, "restitution", "a table"),
    "both dampings": (
        {"restitution": {"value": 0.5, "speed": 1}, "dissipation": 1},
        InvalidValueError, "dissipation", "twice",
    ),
    "normal 0": ({"normal": [0, 0, 0]}, InvalidValueError, "normal", "length zero"),
    "normal of 2 numbers": ({"normal": [0, 1]}, InvalidValueError, "normal", "3 numbers"),
    "normal and slope": ({"normal": [0, 0, 1], "slope_deg": 3}, InvalidValueError, "slope_deg", "twice"),
    "vertical slope": ({"slope_deg": 90}, InvalidValueError, "slope_deg", "less than 90"),
    "belt along the normal": ({"velocity": [0, 0, 1]}, InvalidValueError, "velocity", "velocity = [0, 0, 0]"),
    "belt partly along it": (
        {"velocity": [0.5, 0, 1]}, InvalidValueError, "velocity", "velocity = [0.5, 0, 0]"
    ),
    "anchored contact": ({"contacts": ["c", "a"]}, StructureError, "contacts", "cannot be contacts: a"),
    "contact held along the normal": ({"contacts": ["b"]}, StructureError, "contacts", "contacts: b"),
    "anchors below": ({"offset": 0.3}, StructureError, "offset", "a (0.3 m deep), b (0.3 m deep)"),
    "unknown contact": ({"contacts": ["c", "d"]}, UnknownNameError, "contacts[1]", "names of nodes"),
    "point of a body": ({"contacts": ["leg.A"]}, UnknownNameError, "contacts[0]", "names of nodes"),
    "contact twice": ({"contacts": ["c", "c"]}, DuplicateNameError, "contacts[1]", "twice"),
    "no contact": ({"contacts": []}, InvalidValueError, "contacts", "at least 1"),
    "contacts not all": ({"contacts": "most"}, InvalidValueError, "contacts", "'all'"),
    "contact that is C": ({"contacts": ["c); f(x"]}, InvalidNameError, "contacts[0]", "not a valid name"),
    "contact that is a number": ({"contacts": [1]}, InvalidValueError, "contacts[0]", "a text"),
    "radius below 0": ({"radius": -0.1}, InvalidValueError, "radius", "not less than 0"),
    "radius of a word": ({"radius": "bars"}, InvalidValueError, "radius", "'bar'"),
    "exponent 2": ({"exponent": 2}, InvalidValueError, "exponent", "1 or 1.5"),
    "friction as a text": ({"friction": "0.5"}, InvalidValueError, "friction", "a number"),
    "friction true": ({"friction": True}, InvalidValueError, "friction", "a number"),
    "unknown key": ({"mu": 0.5}, UnknownKeyError, "mu", "friction"),
    **{
        f"{value} in {key}": ({key: value}, NonFiniteError, key, "finite")
        for key in (
            *("offset", "radius", "stiffness", "penetration", "exponent", "dissipation", "friction"),
            *("static_friction", "stick_stiffness", "stick_damping", "slope_deg"),
        )
        for value in (math.nan, math.inf)
    },
    "NaN in normal": ({"normal": [0, math.nan, 1]}, NonFiniteError, "normal[1]", "finite"),
    "NaN in velocity": ({"velocity": [0, math.nan, 1]}, NonFiniteError, "velocity[1]", "finite"),
    "NaN in restitution": (
        {"restitution": {"value": math.nan, "speed": 1}}, NonFiniteError, "restitution.value", "finite"
    ),
    "stiffness beyond numbers": (
        {"stiffness": None, "penetration": 1e-320, "exponent": 1.5}, InvalidValueError, "stiffness", "finite"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_values_are_refused_with_file_and_key(name: str) -> None:
    stated, error, key, words = BAD[name]
    usual = {} if name == "no stiffness" else {"stiffness": 1e4}
    table = {key: value for key, value in (usual | stated).items() if value is not None}
    with pytest.raises(error) as caught:
        build(changed("ground", to=table, base=ROUND))
    assert caught.value.exit_code == 2
    assert caught.value.where == f"{WHERE}: ground.{key}"
    assert words in str(caught.value)


def test_no_bar_with_a_radius() -> None:
    with pytest.raises(InvalidValueError, match="no bar has a radius"):
        ground(PLANAR, stiffness=1e4, radius="bar")


def test_contacts_without_mass_are_named() -> None:
    base = changed("nodes", "b", "mass", to=None, base=PLANAR)
    del base["nodes"]["b"]["mass"]
    with pytest.raises(StructureError, match="contacts without mass: b"):
        ground(base, stiffness=1e4)
    assert ground(base, stiffness=1e4, contacts=["c"]).node.tolist() == [2]


@pytest.mark.parametrize("key", ["normal", "velocity"])
def test_vectors_stay_within_the_axes_of_the_scene(key: str) -> None:
    with pytest.raises(StructureError) as caught:
        ground(PLANAR, stiffness=1e4, **{key: [0, 1, 0]})
    assert caught.value.where == f"{WHERE}: ground.{key}"
    assert "along y" in caught.value.problem


def test_a_scene_of_one_axis_has_no_slope() -> None:
    line: dict[str, Any] = {
        "name": "line",
        "axes": "z",
        "nodes": {"a": {"position": [1], "anchored": True}, "b": {"position": [0.5], "mass": 1.0}},
        "members": {"ab": {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 100.0}},
    }
    assert ground(line, stiffness=1e4).normal.tolist() == [0, 0, 1]
    with pytest.raises(InvalidValueError, match="no slope"):
        ground(line, stiffness=1e4, slope_deg=1)


@pytest.mark.parametrize(
    "stated", [{"penetration": 1e-4}, {"stiffness": 1e4, "exponent": 1.5, "friction": 0.5}]
)
def test_stiffness_at_rest_needs_a_weight(stated: dict[str, Any]) -> None:
    base = changed("gravity", to=[0, 9.81], base=PLANAR)
    with pytest.raises(InvalidValueError, match="no weight acts into the ground"):
        ground(base, **stated)


@pytest.mark.parametrize(
    ("stated", "error", "words"),
    [
        ({"contacts": ["leg.B"]}, None, ""),  # held by the plate, which moves
        ({"contacts": ["mast.A"]}, StructureError, "cannot be contacts: mast.A"),
        ({"contacts": ["ground.a"]}, StructureError, "cannot be contacts: ground.a"),
        ({"contacts": ["mast.C"]}, UnknownNameError, "a bar has A and B"),
        ({"contacts": ["mast_A"]}, UnknownNameError, "body.point"),
        ({"offset": 0.5}, StructureError, "anchored nodes are below the ground: ground.a (0.5 m deep)"),
    ],
)
def test_bad_contacts_of_bodies(stated: dict[str, Any], error: type[SceneError] | None, words: str) -> None:
    table = {"stiffness": 1e4, "offset": -3, **stated}
    if error is None:
        assert len(body_ground(**table).node) == 1
        return
    with pytest.raises(error) as caught:
        body_ground(**table)
    assert words in str(caught.value)


def read_numbers(numbers: Any, **stated: Any) -> tuple[int, ...]:
    base = changed("ground", to=stated, base=ROUND) if stated else ROUND
    return build(changed("parameters", "ground", to=numbers, base=base))[1].parameters["ground"]


def test_numbers_of_the_ground_are_run_time_parameters() -> None:
    assert read_numbers(["friction", "stiffness"], stiffness=1e4, friction=0.5) == (0, 2)
    assert read_numbers("all", stiffness=1e4, friction=0.5) == (0, 1, 2, 3, 4)
    assert read_numbers("all", stiffness=1e4, friction=0.0) == (0, 1)


@pytest.mark.parametrize(
    ("numbers", "stated", "error", "message"),
    [
        ("all", {}, InvalidValueError, "the scene has no ground"),
        (["slope"], {"stiffness": 1e4}, UnknownNameError, "unknown number of the ground"),
        (["friction"], {"stiffness": 1e4, "friction": 0.0}, InvalidValueError, "friction above 0"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(
    numbers: Any, stated: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=r"parameters\.ground") as caught:
        read_numbers(numbers, **stated)
    assert message in str(caught.value)
