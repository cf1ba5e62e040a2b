"""Warnings about the ground: each fact with its numbers, and none for a sound scene."""

from typing import Any

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.plausible_ground import warn_of_ground, warn_of_sampled_contacts
from tensegrity_codegen.scene.checks.scene_warnings import (
    find_body_warnings,
    find_scene_warnings,
    find_warnings,
)
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tests.body_scenes import EVERYTHING, assemble_document

# A tetrahedron of cables with a mast, 1 kg at each node, on its three feet.
CORNERS = {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0], "d": [0.3, 0.3, 1]}


def tripod(gravity: float = -9.81, masses: dict[str, float] | None = None, **ground: Any) -> Structure:
    pairs = ["ab", "ac", "bc", "ad", "bd", "cd"]
    document: dict[str, Any] = {
        "name": "tripod",
        "gravity": [0, 0, gravity],
        "classes": {"bar": {"kind": "bar", "axial_stiffness": 1e5}},
        "nodes": {
            name: {"position": place, "mass": (masses or {}).get(name, 1.0)}
            for name, place in CORNERS.items()
        },
        "members": {pair: {"class": "bar", "nodes": list(pair)} for pair in pairs},
    }
    if ground:
        document["ground"] = {"stiffness": 1e5, **ground}
    return assemble(parse_scene(document))[0]


def test_a_structure_on_its_feet_gives_no_warning() -> None:
    assert warn_of_ground(tripod()) == []
    assert find_warnings(tripod(friction=0)) == ()


def test_without_a_ground_it_falls_and_with_one_it_does_not() -> None:
    assert "everything falls" in find_warnings(tripod())[0]
    assert find_warnings(tripod(offset=-1)) == ()
    (sentence,) = find_warnings(tripod(normal=[0, 0, -1], offset=-5))[1:]
    assert "gravity does not act into the ground" in sentence


def test_nodes_below_the_ground_are_named_with_their_depth() -> None:
    (sentence,) = warn_of_ground(tripod(offset=0.02, contacts=["a", "d"]))
    assert "nodes start below the ground: a (0.02 m)" in sentence
    assert "0.000392 m" in sentence  # 4 kg on one contact
    (sentence,) = warn_of_ground(tripod(offset=1.5))
    assert "a (1.5 m), b (1.5 m), c (1.5 m), d (0.5 m)" in sentence


@pytest.mark.parametrize(("share", "count"), [(0.999, 0), (1.001, 1)])
def test_the_depth_at_rest_is_no_warning(share: float, count: int) -> None:
    assert len(warn_of_ground(tripod(offset=share * 4 * 9.81 / 1e5))) == count


@pytest.mark.parametrize(("ratio", "count"), [(0.099, 1), (0.101, 0), (9.9, 0), (10.1, 1)])
def test_the_tangential_stiffness_is_compared_with_the_normal_one(ratio: float, count: int) -> None:
    found = warn_of_ground(tripod(friction=0.5, stick_stiffness=ratio * 1e5, contacts=["a", "d"]))
    assert len(found) == count
    assert all(f"{ratio:.3g} times the normal one" in text for text in found)
    assert warn_of_ground(tripod(stick_stiffness=1e9)) == []  # without friction it acts nowhere


def test_bars_with_both_ends_on_the_ground_cannot_roll() -> None:
    (sentence,) = warn_of_ground(tripod(friction=0.5))
    assert sentence.startswith("bars lie on the ground with both ends: ab, ac, bc;")
    assert warn_of_ground(tripod(friction=0.5, offset=-0.001)) == []
    assert len(warn_of_ground(tripod(friction=0.5, offset=-0.001, radius=0.001))) == 1


def test_a_light_contact_is_named_with_its_frequency() -> None:
    (sentence,) = warn_of_ground(tripod(masses={"b": 0.001}, contacts=["b", "d"]))
    assert "contact b has 0.001 kg" in sentence
    assert "1592 Hz" in sentence  # sqrt(1e5 / 0.001) / (2 pi)
    assert warn_of_ground(tripod(masses={"b": 0.01}, contacts=["b", "d"])) == []


def test_a_belt_needs_friction() -> None:
    assert "no effect without friction" in warn_of_ground(tripod(velocity=[1, 0, 0]))[0]


def test_samples_are_compared_with_the_contact_frequency() -> None:
    structure = tripod(friction=0.5)  # 50.3 Hz
    (sentence,) = warn_of_sampled_contacts(structure, 0.01)
    assert "50.33 Hz" in sentence
    assert "0.01 s apart" in sentence
    assert warn_of_sampled_contacts(structure, 0.0099) == []
    assert warn_of_sampled_contacts(tripod(), 1.0) == []


def test_bodies_have_the_same_warnings() -> None:
    sound = {"stiffness": 1e4, "offset": -3, "friction": 0.5}
    before = find_body_warnings(assemble_document(EVERYTHING)[0])
    assert find_body_warnings(assemble_document({**EVERYTHING, "ground": sound})[0]) == before
    low = {**sound, "normal": [0, 0, 1], "offset": 0, "contacts": ["leg.A", "stick.A"], "radius": 0.9}
    found = find_scene_warnings(assemble_document({**EVERYTHING, "ground": low})[0])
    assert any("nodes start below the ground: " in sentence for sentence in found)


def test_a_bar_body_that_lies_is_named() -> None:
    bodies = {
        "post": {"kind": "fixed", "points": {"top": [0, 0, 1]}},
        "log": {"kind": "bar", "length": 1.0, "mass": 1.0, "centre": [0, 0, 0.1], "direction": [1, 0, 0]},
    }
    document = {
        "name": "log",
        "gravity": [0, 0, -9.81],
        "classes": {"rope": {"kind": "cable", "spring_constant": 10.0, "rest_length": 2.0}},
        "bodies": bodies,
        "tendons": {"t": {"class": "rope", "points": ["post.top", "log.A"]}},
        "ground": {"stiffness": 1e4, "friction": 0.5, "radius": 0.1},
    }
    (sentence,) = warn_of_ground(assemble_document(document)[0])
    assert "both ends: log;" in sentence
