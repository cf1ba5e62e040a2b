"""Warnings of a start without prestress, of bars that cross or buckle, of values unlike their neighbours."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.plausible_start import (
    warn_of_crossing,
    warn_of_ground,
    warn_of_outliers,
    warn_of_sag,
    warn_of_sampled_contacts,
    warn_of_slack,
    warn_of_units,
)
from tensegrity_codegen.scene.checks.scene_warnings import (
    find_body_warnings,
    find_scene_warnings,
    find_warnings,
)
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tests.body_scenes import EVERYTHING, assemble_document
from tests.runtime.build import bar, cable, make_structure
from tests.scene.checks.test_plausible_sizes import build as build_variant
from tests.scene.samples import build

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def crossed(height: float, radius: float = 0.0, axes: str = "xyz") -> Structure:
    """Two bars of 1.4 m that cross `height` above each other, and four cables."""
    place = np.array(SQUARE, dtype=float)
    place[[1, 3], 2] = height
    members = [bar(0, 2, 1.5), bar(1, 3, 1.5), *(cable(k, (k + 1) % 4, 0.9) for k in range(4))]
    structure = make_structure(place.tolist(), members, anchored={0: axes}, axes=axes)
    return structure.with_changes(radius=np.where(structure.is_bar, radius, 0.0))


@pytest.mark.parametrize(("rest", "which"), [(1.0, "all start at their rest length"), (1.1, "4 are slack")])
def test_cables_without_any_tension(rest: float, which: str) -> None:
    structure = crossed(0.0, axes="xy")
    (text,) = warn_of_slack(structure.with_changes(rest_length=np.where(structure.is_bar, 1.5, rest)))
    assert which in text
    assert "--prestress" in text
    assert warn_of_slack(structure) == []


STEEL = {"axial_stiffness": None, "youngs_modulus": 2.1e11, "radius": 0.01, "prestress": None}


@pytest.mark.parametrize(
    ("values", "stress", "words"),
    [
        ({}, 2.35e8, ""),
        ({"youngs_modulus": 1e6}, 2e4, ""),
        ({"rest_length": 90.0}, 2.35e8, ""),
        (
            {"rest_length": 10000.0},
            2.35e8,
            "rest length is many times the distance of the ends (in mm?): line (1000",
        ),
        ({"youngs_modulus": 2.1e5}, 2.35e8, "below that of rubber (in MPa?): line (210000 Pa)"),
        ({}, 235.0, "below that of any solid (in MPa?): line (235 Pa)"),
    ],
)
def test_lengths_in_millimetres_and_stresses_in_megapascals(values: dict, stress: float, words: str) -> None:
    document = span(0.0)
    line = document["members"]["line"] | STEEL | values
    document["members"]["line"] = {key: value for key, value in line.items() if value is not None}
    structure = build(document | {"limits": {"yield_stress": stress}})[0]
    found = warn_of_units(structure)
    assert (len(found), words in "".join(found)) == (bool(words), True)
    assert set(found) <= {*find_warnings(structure)}


@pytest.mark.parametrize("stop", ["b.end", "a.high"])
def test_a_cable_within_one_body_never_changes(stop: str) -> None:
    points = {"low": [0, 0, 0], "high": [0, 0, 1], "end": [1, 0, 1]}
    body = {"kind": "rigid", "mass": 1.0, "inertia": [1.0, 1.0, 1.0], "points": points}
    line = {"kind": "cable", "nodes": ["a.low", stop], "spring_constant": 10.0}
    document = {
        "name": "two",
        "bodies": {"a": body | {"position": [0, 0, 0]}, "b": body | {"position": [2, 0, 0]}},
    }
    document["members"] = {"line": line, "other": {**line, "nodes": ["a.high", "b.low"]}}
    found = [text for text in find_warnings(build(document)[0]) if "one rigid body" in text]
    assert [text.endswith(": line") for text in found] == [True] * (stop == "a.high")


@pytest.mark.parametrize(
    ("height", "radius", "crosses"),
    [(0.0, 0.0, True), (0.01, 0.0, False), (0.01, 0.004, False), (0.01, 0.006, True)],
)
def test_bars_that_cross(height: float, radius: float, crosses: bool) -> None:
    found = warn_of_crossing(crossed(height, radius))
    assert [text.endswith(": e0 and e1") for text in found] == [True] * crosses
    assert warn_of_crossing(crossed(0.0, radius, axes="xy")) == []


def test_a_load_along_an_axis_without_anchors() -> None:
    structure = crossed(0.1).with_changes(node_anchored=np.zeros((4, 3), dtype=bool))
    load = np.zeros((4, 3))
    load[1, 0] = 3.0
    (text,) = [text for text in find_warnings(structure.with_changes(node_load=load)) if "slides" in text]
    assert "loads add up to 3 N along x" in text
    load[2, 0] = -3.0
    assert not any("slides" in text for text in find_warnings(structure.with_changes(node_load=load)))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"node_mass": (2, 2e3)}, "n2 (2e+03 kg against 1 kg)"),
        ({"spring_constant": (4, 1e-6)}, "e4 ("),
        ({"spring_constant": (0, 1e9)}, "e0 (1.5e+09 N"),
    ],
)
def test_a_value_a_thousand_times_off_its_neighbours(changes: dict[str, Any], named: str) -> None:
    structure = crossed(0.1)
    structure = structure.with_changes(node_mass=np.ones(4))
    assert warn_of_outliers(structure) == []
    ((key, (row, value)),) = changes.items()
    array = getattr(structure, key).copy()
    array[row] = value
    (text,) = warn_of_outliers(structure.with_changes(**{key: array}))
    assert named in text


def test_bars_that_buckle_and_strain_at_the_start() -> None:
    structure = build_variant()
    rest = structure.rest_length.copy()
    rest[0] *= 1.02
    found = find_warnings(structure.with_changes(rest_length=rest, radius=0.1 * structure.radius))
    assert any("at the start mast buckles" in text for text in found)
    assert any("at the start mast has a strain of -1.98 %" in text for text in found)
    # A search for the equilibrium does not start from these tensions.
    squeezed = structure.with_changes(rest_length=rest)
    assert not any("strain" in text for text in find_scene_warnings(squeezed, settles=True))


def test_a_hung_chain_needs_no_prestress() -> None:
    """Its loads pull it taut; without any, nothing does."""
    chain = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [cable(k, k + 1, 1.0) for k in range(3)]
    )
    chain = chain.with_changes(rest_length=chain.member_length())
    assert len(warn_of_slack(chain.with_changes(gravity=np.zeros(3)))) == 1
    assert warn_of_slack(chain.with_changes(gravity=np.array([0.0, 0.0, -9.81]))) == []


def span(tension: float, **values: object) -> dict:
    """A cable of EA 1000 N and 1 N/m over 10 m."""
    line = {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 1000.0, "prestress": tension}
    rest = 10000.0 / (1000.0 + tension)
    return {
        "name": "span", "axes": "xz", "gravity": [0, -10],
        "nodes": {"a": {"position": [0, 0], "anchored": True}, "b": {"position": [10, 0], "anchored": "z"}},
        "members": {"line": line | {"mass": 1.0 / 10.0 * rest} | values},
    }  # fmt: skip


def test_the_cable_its_number_and_the_key_are_named() -> None:
    (text,) = warn_of_sag(build(span(50.0))[0])
    assert "line (0.0667, so 0.9375 of its stiffness)" in text
    assert "segments = 8" in text
    assert text in find_warnings(build(span(50.0))[0])


def test_the_threshold() -> None:
    # w^2 L^2 EA / (12 T^3) = 0.05 at T = (1e5 / 0.6)^(1/3) = 55.0321 N.
    assert warn_of_sag(build(span(55.1))[0]) == []
    assert len(warn_of_sag(build(span(55.0))[0])) == 1


def test_only_what_computes_forces_or_motions_warns_of_sag() -> None:
    structure = build(span(50.0))[0]
    assert {*find_scene_warnings(structure)} == {
        *find_scene_warnings(structure, sags=False),
        *warn_of_sag(structure),
    }


def test_slack_cables_have_no_stiffness_left() -> None:
    (text,) = warn_of_sag(build(span(0.0))[0])
    assert "line (slack as a straight line)" in text


@pytest.mark.parametrize("values", [{"segments": 4}])
def test_cables_in_segments_and_vertical_ones_are_not_warned_of(values: dict) -> None:
    assert warn_of_sag(build(span(50.0, **values))[0]) == []
    upright = span(50.0)
    upright["nodes"]["b"] = {"position": [0, -10], "anchored": "x"}
    assert warn_of_sag(build(upright)[0]) == []
    weightless = span(50.0)
    del weightless["gravity"]
    assert warn_of_sag(build(weightless)[0]) == []


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
