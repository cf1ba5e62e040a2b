"""Which pairs of bars a scene watches."""

from typing import Any

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    UnknownNameError,
)


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


def build(pairs: Any) -> Structure:
    return assemble(parse_scene(scene(interference={"pairs": pairs})))[0]


def named(structure: Structure) -> list[list[str]]:
    return [[structure.member_name[e] for e in pair] for pair in structure.bar_pairs]


def test_all_pairs_are_those_of_bars_with_a_radius_that_share_no_node() -> None:
    expected = [["b0", "b1"], ["b0", "b2"], ["b1", "b2"], ["b1", "b4"], ["b2", "b4"]]
    assert named(assemble(parse_scene(scene()))[0]) == expected
    assert named(build("all")) == expected


def test_chosen_pairs_keep_their_order_and_survive_description() -> None:
    structure = build([["b2", "b0"], ["b1", "b4"]])
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
    assert named(build([])) == []


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
        build(pairs)
    assert said in str(caught.value)
    assert "interference.pairs" in str(caught.value)
