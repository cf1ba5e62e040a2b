"""Cables in segments: names, values, places, and what names the cable."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene, read_scene
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.catenary import find_catenary
from tensegrity_codegen.structure.sliding import SlidingCable
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    StructureError,
    UnknownNameError,
)
from tests.ring_cases import make_garland
from tests.scene.samples import REMOVE, WHERE, build, changed

LINE = {
    "nodes": ["west", "east"], "axial_stiffness": 1000.0, "rest_length": 10.5, "mass_per_length": 0.1,
    "damping": 2.0, "switch_elongation": 3.0, "stiffness_ratio": 0.5,
}  # fmt: skip
SPAN: dict[str, Any] = {
    "name": "span",
    "axes": "xz",
    "gravity": [0, -10],
    "classes": {"rope": {"kind": "cable", "segments": 4}},
    "nodes": {
        "west": {"position": [0, 0], "anchored": True},
        "east": {"position": [10, 0], "anchored": "z", "mass": 2.0, "velocity": [4, 0]},
    },
    "members": {
        "line": {"class": "rope", **LINE},
    },
}


def span(*path: str | int, to: Any) -> dict[str, Any]:
    return changed(*path, to=to, base=SPAN)


def test_names_values_and_velocities() -> None:
    structure, _ = build(SPAN)
    assert structure.node_name == ("west", "east", "line_node_1", "line_node_2", "line_node_3")
    assert structure.member_name == ("line_1", "line_2", "line_3", "line_4")
    assert structure.connectivity.tolist() == [[0, 2], [2, 3], [3, 4], [4, 1]]
    assert structure.groups == {"line": (0, 1, 2, 3)}
    assert structure.member_class == ("rope",) * 4
    assert structure.rest_length == pytest.approx([2.625] * 4)
    assert structure.axial_stiffness == pytest.approx([1000.0] * 4)
    assert structure.damping == pytest.approx([8.0] * 4)
    assert structure.member_mass == pytest.approx([0.1 * 2.625] * 4)
    assert structure.law_parameter["switch_elongation"] == pytest.approx([0.75] * 4)
    assert structure.law_parameter["stiffness_ratio"] == pytest.approx([0.5] * 4)
    assert structure.node_velocity[:, 0].tolist() == [0, 4, 1, 2, 3]
    assert structure.node_mass.tolist() == [0, 2, 0, 0, 0]
    assert not structure.node_anchored[2:].any()
    # The whole has the stiffness of the cable: n springs of n k in a row.
    spring = span("members", "line", to={**LINE, "class": "rope", "spring_constant": 8.0})
    del spring["members"]["line"]["axial_stiffness"]
    assert build(spring)[0].spring_constant == pytest.approx([32.0] * 4)


@pytest.mark.parametrize(("rise", "length"), [(0.0, 10.5), (3.0, 10.6), (-4.0, 10.0)])
def test_inner_nodes_start_on_the_catenary(rise: float, length: float) -> None:
    document = span("nodes", "east", "position", to=[10, rise])
    document["members"]["line"] |= {"rest_length": length}
    structure, _ = build(document)
    shape = find_catenary(10.0, rise, length, 1.0, 1000.0).points(4)
    assert structure.node_position[2:][:, [0, 2]] == pytest.approx(shape[1:-1], abs=1e-12)


@pytest.mark.parametrize(("position", "gravity"), [([0, -3], [0, -10]), ([10, 0], None), ([10, 0], [10, 0])])
def test_other_starts_are_straight_or_nearly(position: list[float], gravity: list[float] | None) -> None:
    document = span("nodes", "east", "position", to=position)
    document["nodes"]["east"]["anchored"] = True
    del document["nodes"]["east"]["velocity"]
    document["gravity"] = gravity
    if gravity is None:
        del document["gravity"]
    structure, _ = build(document)
    length = structure.member_length()
    assert (length > 0.01).all()
    if gravity is None:
        assert length == pytest.approx([2.5] * 4)


def test_what_names_the_cable_acts_on_its_segments() -> None:
    document = changed("groups", to={"ropes": ["line"]}, base=SPAN)
    document["inputs"] = [
        {"kind": "rest_length", "name": "whole", "members": ["line"]},
        {"kind": "rest_length", "name": "of_class", "members": ["rope"], "gain": [2.0]},
        {"kind": "rest_length", "name": "group", "members": ["ropes"]},
        {"kind": "rest_length", "name": "end", "members": ["line_1"]},
        {"kind": "rest_length", "name": "both", "members": ["line_1", "line"]},
        {"kind": "force", "name": "push", "nodes": ["line_node_2"], "direction": [0, 1]},
    ]
    document["loads"] = [{"node": "line_node_1", "force": [0, -3]}]
    document["parameters"] = {"rest_length": ["line"]}
    document["sensors"] = [{"kind": "member_tension", "members": "line"}]
    document["limits"] = {"members": {"line": {"most_tension": 50.0}}}
    structure, request = build(document)
    gains = {item.name: item.rest_length_gain for item in structure.inputs}
    quarters = dict.fromkeys(range(4), 0.25)
    assert gains["whole"] == gains["group"] == quarters
    assert gains["of_class"] == dict.fromkeys(range(4), 0.5)
    assert gains["end"] == {0: 1.0}
    assert gains["both"] == quarters | {0: 1.0}
    assert structure.inputs[-1].targets == (3,)
    assert structure.node_load[2].tolist() == [0, 0, -3]
    assert request.parameters == {"rest_length": (0, 1, 2, 3)}
    assert structure.sensors[0].targets == (0, 1, 2, 3)
    assert structure.limits.most_tension.tolist() == [50.0] * 4
    again, _ = build(describe_structure(structure, request))
    assert again.inputs[:5] == structure.inputs[:5]
    assert again.groups == structure.groups
    for name in ("rest_length", "member_mass", "node_position", "damping", "axial_stiffness"):
        assert np.array_equal(getattr(again, name), getattr(structure, name)), name


def test_temperature_of_a_cable_in_segments_is_that_of_each() -> None:
    document = span("members", "line", "thermal_expansion", to=1e-5)
    document["inputs"] = [{"kind": "temperature", "name": "sun", "members": ["line"]}]
    gain = build(document)[0].inputs[0].rest_length_gain
    assert list(gain.values()) == pytest.approx([2.625e-5] * 4)
    assert math.fsum(gain.values()) == pytest.approx(10.5e-5)


def test_one_segment_is_the_cable_itself() -> None:
    structure, _ = build(span("members", "line", "segments", to=1))
    assert structure.member_name == ("line",)
    assert structure.groups == {}
    assert structure.member_mass == pytest.approx([1.05])


@pytest.mark.parametrize(
    ("path", "value", "error", "where"),
    [
        (("nodes", "line_node_2"), {"position": [1, 1]}, DuplicateNameError, "nodes"),
        (("groups",), {"line": ["line"]}, DuplicateNameError, "groups"),
        (("members", "line", "segments"), 0, InvalidValueError, "members.line.segments"),
        (("members", "line", "segments"), 2.5, InvalidValueError, "members.line.segments"),
        (("actuators",), [{"name": "motor", "members": "line"}], InvalidValueError, "actuators[0].members"),
    ],
)
def test_what_segments_cannot_be(
    path: tuple[str, ...], value: Any, error: type[Exception], where: str
) -> None:
    with pytest.raises(error) as caught:
        build(span(*path, to=value))
    assert caught.value.where == f"{WHERE}: {where}"  # type: ignore[attr-defined]


def test_an_actuator_may_have_a_single_segment() -> None:
    structure, _ = build(span("actuators", to=[{"name": "motor", "members": "line_1"}]))
    assert structure.inputs[0].rest_length_gain == {0: 1.0}


def test_tendons_have_no_mass_and_no_segments() -> None:
    scene = {
        "name": "held",
        "bodies": {
            "base": {"kind": "fixed", "points": {"p": [0, 0, 0]}},
            "top": {"kind": "rigid", "mass": 1.0, "inertia": [1, 1, 1], "points": {"q": [0, 0, 0]},
                    "centre": [0, 0, 1]},
        },
        "tendons": {"s": {"points": ["base.p", "top.q"], "axial_stiffness": 10.0}},
    }  # fmt: skip
    from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
    from tensegrity_codegen.scene.read import parse_scene

    for key, value in (("mass", 1.0), ("mass_per_length", 1.0), ("segments", 3)):
        with pytest.raises(InvalidValueError, match="no mass and no segments") as caught:
            assemble_bodies(parse_scene(changed("tendons", "s", key, to=value, base=scene)), WHERE)
        assert caught.value.where == f"{WHERE}: tendons.s"


ROPE: dict[str, Any] = {
    "class": "line", "nodes": ["west", "ring", "drum", "east"], "axial_stiffness": 1000.0, "rest_length": 5.0,
    "damping": 2.0, "friction": [0.1, 0.3], "wrap_deg": [0, 540],
}  # fmt: skip
RIG: dict[str, Any] = {
    "name": "rig",
    "axes": "xz",
    "classes": {"line": {"kind": "cable"}, "rod": {"kind": "bar", "axial_stiffness": 1e4}},
    "nodes": {
        "west": {"position": [0, 0], "anchored": True},
        "ring": {"position": [1, 0], "mass": 1.0},
        "drum": {"position": [3, 0], "anchored": True},
        "east": {"position": [3, -3], "mass": 1.0},
    },
    "members": {
        "strut": {"class": "rod", "nodes": ["east", "ring"]},
        "rope": ROPE,
        "stay": {"class": "line", "nodes": ["west", "east"], "spring_constant": 10.0, "damping": 1.0},
    },
}
STRAND = {"class": "line", "axial_stiffness": 500.0, "damping": 1.0}


def rig(*path: str | int, to: Any) -> dict[str, Any]:
    return changed(*path, to=to, base=RIG)


def rope(**values: Any) -> dict[str, Any]:
    """Return the scene with other values of the rope; REMOVE leaves one out."""
    row = {key: value for key, value in (ROPE | values).items() if value is not REMOVE}
    return rig("members", "rope", to=row)


def table(**values: Any) -> dict[str, Any]:
    """Return the scene with a table [sliding.rope] over two strands in place of the rope."""
    document = rig("members", "rope", to=REMOVE)
    document["members"] |= {
        "one": {**STRAND, "nodes": ["west", "ring"], "rest_length": 0.9},
        "two": {**STRAND, "nodes": ["ring", "drum"], "rest_length": 1.7},
        "far": {**STRAND, "nodes": ["drum", "east"]},
    }
    document["sliding"] = {"rope": {"strands": ["one", "two"], "friction": 0.2, **values}}
    return document


def test_names_and_values_of_strands() -> None:
    structure, _ = build(RIG)
    assert structure.member_name == ("strut", "rope_1", "rope_2", "rope_3", "stay")
    assert structure.connectivity.tolist() == [[3, 1], [0, 1], [1, 2], [2, 3], [0, 3]]
    assert structure.groups == {"rope": (1, 2, 3)}
    assert structure.member_class == ("rod", "line", "line", "line", "line")
    assert structure.ring_nodes == ()
    shares = np.array([1.0, 2.0, 3.0]) / 6.0
    assert structure.rest_length[1:4] == pytest.approx(5.0 * shares, rel=1e-15)
    assert structure.axial_stiffness.tolist() == [1e4, 1000.0, 1000.0, 1000.0, 0.0]
    assert structure.spring_constant.tolist() == [0.0, 0.0, 0.0, 0.0, 10.0]
    assert structure.damping[1:4] == pytest.approx(2.0 / shares, rel=1e-15)
    assert structure.tension_only[1:4].all()
    (cable,) = structure.sliding
    names = ("rope_1", "rope_2", "rope_3")
    assert cable == SlidingCable("rope", names, (1, 2, 3), (0.1, 0.3), (0.0, 540.0))
    assert structure.internal_name == ("rope_1_slid", "rope_2_slid")
    tension = structure.static_tension()[1:4]
    assert tension == pytest.approx([1000.0 * (6.0 - 5.0) / 5.0] * 3)


def test_a_spring_constant_becomes_an_axial_stiffness() -> None:
    structure, _ = build(rope(axial_stiffness=REMOVE, spring_constant=40.0))
    assert structure.axial_stiffness[1:4] == pytest.approx([40.0 * 5.0] * 3)
    assert structure.spring_constant[1:4].tolist() == [0.0] * 3
    structure, _ = build(rope(rest_length=REMOVE, prestress=30.0))
    assert structure.static_tension()[1:4] == pytest.approx([30.0] * 3)


def test_one_number_holds_for_all_rings_and_that_of_a_class_for_members_with_rings() -> None:
    assert build(rope(friction=0.2, wrap_deg=REMOVE))[0].sliding[0].friction == (0.2, 0.2)
    assert build(rope(friction=0.2, wrap_deg=90))[0].sliding[0].wrap_deg == (90.0, 90.0)
    of_class = rope(friction=REMOVE, wrap_deg=REMOVE)
    of_class["classes"]["line"] |= {"friction": 0.25, "wrap_deg": 45.0}
    structure, _ = build(of_class)
    assert structure.sliding[0].friction == (0.25, 0.25)
    assert structure.sliding[0].wrap_deg == (45.0, 45.0)
    assert structure.member_name[-1] == "stay"  # of the same class, without rings
    own = rope(friction=0.5, wrap_deg=0)
    own["classes"]["line"] |= {"friction": 0.25, "wrap_deg": 45.0}
    assert build(own)[0].sliding[0] == replace(
        build(RIG)[0].sliding[0], friction=(0.5, 0.5), wrap_deg=(0.0, 0.0)
    )


@pytest.mark.parametrize("friction", [0, 0.0, [0, 0.0], REMOVE])
def test_without_friction_the_cable_is_one_member(friction: Any) -> None:
    structure, _ = build(rope(friction=friction, wrap_deg=REMOVE))
    assert structure.member_name == ("strut", "rope", "stay")
    assert structure.ring_nodes == ((), (1, 2), ())
    assert structure.sliding == ()


def test_a_ring_without_friction_beside_one_with() -> None:
    assert build(rope(friction=[0.0, 0.3]))[0].sliding[0].friction == (0.0, 0.3)


def test_cables_with_and_without_friction_stand_side_by_side() -> None:
    document = rig("members", "smooth", to={**ROPE, "friction": 0, "wrap_deg": 0})
    document["members"]["smooth"]["nodes"] = ["east", "ring", "west"]
    del document["members"]["stay"]
    del document["members"]["smooth"]["wrap_deg"]
    structure, _ = build(document)
    assert structure.member_name == ("strut", "rope_1", "rope_2", "rope_3", "smooth")
    assert structure.ring_nodes == ((), (), (), (), (1,))


def test_inputs_of_the_cable_act_on_its_first_strand() -> None:
    document = rig("groups", to={"ropes": ["rope"]})
    document["inputs"] = [
        {"kind": "rest_length", "name": "whole", "members": ["rope"]},
        {"kind": "rest_length", "name": "group", "members": ["ropes"], "gain": [2.0]},
        {"kind": "rest_length", "name": "of_class", "members": ["line"]},
        {"kind": "rest_length", "name": "end", "members": ["rope_3"]},
    ]
    document["parameters"] = {"rest_length": ["rope"]}
    document["sensors"] = [{"kind": "member_tension", "members": "rope"}]
    document["limits"] = {"members": {"rope": {"most_tension": 50.0}}}
    structure, request = build(document)
    gains = {
        item.name: {k: gain for k, gain in item.rest_length_gain.items() if gain} for item in structure.inputs
    }
    assert gains == {"whole": {1: 1.0}, "group": {1: 2.0}, "of_class": {1: 1.0, 4: 1.0}, "end": {3: 1.0}}
    assert structure.groups == {"ropes": (1, 2, 3), "rope": (1, 2, 3)}
    assert request.parameters == {"rest_length": (1, 2, 3)}
    assert structure.sensors[0].targets == (1, 2, 3)
    assert structure.limits.most_tension[1:4].tolist() == [50.0] * 3


def test_an_actuator_has_a_single_strand() -> None:
    structure, _ = build(rig("actuators", to=[{"name": "motor", "members": "rope_1"}]))
    assert structure.inputs[-1].targets == (1,)
    with pytest.raises(InvalidValueError, match="in pieces has no actuator"):
        build(rig("actuators", to=[{"name": "motor", "members": "rope"}]))


def test_tables_of_strands_that_are_members() -> None:
    structure, _ = build(table(wrap_deg=[270]))
    assert structure.member_name == ("strut", "stay", "one", "two", "far")
    (cable,) = structure.sliding
    assert cable == SlidingCable("rope", ("one", "two"), (2, 3), (0.2,), (270.0,))
    assert structure.internal_name == ("one_slid",)
    assert structure.groups == {}
    assert structure.rest_length[2:4].tolist() == [0.9, 1.7]
    three = table(strands=["one", "two", "far"], friction=[0.1, 0.2])
    assert build(three)[0].sliding[0].wrap_deg == (0.0, 0.0)


@pytest.mark.parametrize(
    "document", [RIG, rope(axial_stiffness=REMOVE, spring_constant=7.0), table(wrap_deg=10.0)]
)
def test_a_described_scene_is_the_same_bit_by_bit(document: dict[str, Any], tmp_path: Any) -> None:
    document = changed(
        "inputs", to=[{"kind": "rest_length", "name": "u", "members": ["stay"]}], base=document
    )
    structure, request = build(document)
    again, wanted = build(describe_structure(structure, request))
    path = tmp_path / "rig.toml"
    write_scene(describe_structure(structure, request), path)
    for other in (again, assemble(read_scene(path), str(path))[0]):
        assert other.sliding == structure.sliding
        assert other.member_name == structure.member_name
        assert other.groups == structure.groups
        assert other.inputs == structure.inputs
        for name in ("rest_length", "axial_stiffness", "damping", "node_position", "connectivity"):
            assert np.array_equal(getattr(other, name), getattr(structure, name)), name
    assert wanted == request


def test_a_garland_is_described_bit_by_bit() -> None:
    structure = make_garland(4)
    again, _ = build(describe_structure(structure))
    assert again.sliding == structure.sliding
    assert np.array_equal(again.rest_length, structure.rest_length)
    assert np.array_equal(again.damping, structure.damping)


def refuse(document: dict[str, Any], error: type[SceneError] = InvalidValueError) -> SceneError:
    with pytest.raises(error) as caught:
        build(document)
    assert isinstance(caught.value, SceneError)
    return caught.value


TWO_NODES = {"class": "line", "nodes": ["west", "east"], "spring_constant": 10.0, "damping": 1.0}


@pytest.mark.parametrize(
    ("document", "where", "words"),
    [
        (
            rig("members", "stay", to={**TWO_NODES, "friction": 0.1}),
            "members.stay.friction",
            "passes no ring",
        ),
        (rope(friction=REMOVE), "members.rope.wrap_deg", "wrap without friction"),
        (rope(friction=[0.1]), "members.rope.friction", "not one number for each ring"),
        (rope(wrap_deg=[0, 1, 2]), "members.rope.wrap_deg", "not one number for each ring"),
        (rope(damping=REMOVE), "members.rope", "without damping"),
        (rope(damping=0), "members.rope", "without damping"),
        (rope(mass=0.5), "members.rope", "with mass"),
        (rope(switch_elongation=0.1, stiffness_ratio=2.0), "members.rope", "not linear"),
        (rope(yield_force=50.0), "members.rope", "not linear"),
        (rope(relaxation_time=1.0, relaxed_fraction=0.5), "members.rope", "not linear"),
        (rope(friction=[0.1, 5.0]), "members.rope.friction", "so large that nothing slips"),
        (rope(friction=[13.0, 0.1], wrap_deg=0), "members.rope.friction", "so large that nothing slips"),
        (table(strands=["one", "far"]), "sliding.rope", "do not follow each other"),
        (table(strands=["two", "one"]), "sliding.rope", "do not follow each other"),
        (table(strands=["one", "one"]), "sliding.rope", "do not follow each other"),
        (table(strands=["strut", "far"]), "sliding.rope", "do not follow each other"),
        (table(friction=[0.1, 0.2]), "sliding.rope.friction", "not one number for each ring"),
        (table(wrap_deg=[1.0, 2.0]), "sliding.rope.wrap_deg", "not one number for each ring"),
        (table(friction=20.0, wrap_deg=180), "sliding.rope.friction", "so large that nothing slips"),
    ],
)
def test_what_friction_at_rings_cannot_be(document: dict[str, Any], where: str, words: str) -> None:
    error = refuse(document)
    assert error.where == f"{WHERE}: {where}"
    assert words in error.problem


def test_a_bar_among_strands_and_one_that_is_two_sided() -> None:
    document = table()
    document["members"]["one"] |= {"class": "rod"}
    assert "no cable that only pulls" in refuse(document).problem
    document = table()
    document["members"]["two"]["damping"] = 0.0
    error = refuse(document)
    assert error.hint.startswith("give damping [N s/m]")
    assert error.where == f"{WHERE}: sliding.rope"
    document = table()
    del document["members"]["one"]["axial_stiffness"]
    document["members"]["one"]["spring_constant"] = 10.0
    assert "strands without axial_stiffness" in refuse(document).problem


def test_up_to_twelve_rings() -> None:
    def ladder(count: int) -> dict[str, Any]:
        nodes = {f"n{k}": {"position": [float(k), float(k % 2)], "mass": 1.0} for k in range(count + 2)}
        nodes["n0"]["anchored"] = True
        row = {**ROPE, "nodes": [*nodes], "friction": 0.1, "wrap_deg": 0, "rest_length": 10.0}
        return RIG | {"nodes": nodes, "members": {"rope": row}}

    assert len(build(ladder(12))[0].sliding[0].friction) == 12
    error = refuse(ladder(13))
    assert error.problem == "more than 12 rings with friction in one cable"


@pytest.mark.parametrize("key", ["friction", "wrap_deg"])
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, "a", [], [0.1, -1.0], [0.1, math.nan], True])
def test_numbers_of_rings_that_are_none(key: str, value: Any) -> None:
    for document, place in (
        (rope(**{key: value}), f"members.rope.{key}"),
        (table(**{key: value}), f"sliding.rope.{key}"),
        (rig("classes", "line", key, to=value), f"classes.line.{key}"),
    ):
        with pytest.raises(SceneError) as caught:
            parse_scene(document, WHERE)
        assert place in str(caught.value)


def test_strands_without_a_name_of_their_own() -> None:
    for name in ("rope_2", "rope"):
        document = (
            rig("members", name, to=TWO_NODES) if name != "rope" else rig("groups", "rope", to=["stay"])
        )
        error = refuse(document, DuplicateNameError)
        assert name in str(error)
    document = rig("sliding", to={"rope": {"strands": ["rope_1", "rope_2"], "friction": 0.1}})
    error = refuse(document, DuplicateNameError)
    assert error.where == f"{WHERE}: sliding.rope"
    assert "has friction already" in error.problem


def test_a_strand_that_does_not_exist() -> None:
    error = refuse(table(strands=["one", "tow"]), UnknownNameError)
    assert error.where == f"{WHERE}: sliding.rope.strands"
    assert "tow" in str(error)
    assert "two" in str(error)


def test_a_strand_of_two_cables() -> None:
    document = table()
    document["sliding"]["other"] = {"strands": ["two", "far"], "friction": 0.1}
    error = refuse(document, DuplicateNameError)
    assert error.where == f"{WHERE}: sliding.other.strands"
    assert "belongs to the cable 'rope' already" in error.problem
    document = rig("sliding", to={"other": {"strands": ["rope_1", "rope_2"], "friction": 0.1}})
    assert "belongs to the cable 'rope' already" in refuse(document, DuplicateNameError).problem


def test_a_ring_twice_in_a_row_and_strands_that_join_the_same_nodes() -> None:
    error = refuse(rope(nodes=["west", "ring", "ring", "east"]), StructureError)
    assert error.where == f"{WHERE}: members.rope.nodes"
    assert "passes a node twice in a row" in error.problem
    error = refuse(
        rope(nodes=["west", "ring", "drum", "ring", "east"], friction=0.1, wrap_deg=0), DuplicateNameError
    )
    assert "'rope_2' and 'rope_3' join the same two nodes" in error.problem
