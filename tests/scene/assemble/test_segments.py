"""Cables in segments: names, values, places, and what names the cable."""

import math
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.structure.catenary import find_catenary
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError
from tests.scene.samples import WHERE, build, changed

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
