"""Warnings about sizes and forces that look like a slip, each with amount, first culprit and what to try."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen.compilation.fingerprint import hash_structure
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.plausible_sizes import warn_of_imbalance
from tensegrity_codegen.scene.checks.scene_warnings import find_body_warnings, find_warnings
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import DuplicateNameError
from tests.rigid_scenes import HANGING

# A mast on three legs with three stays, all in balance without gravity but for a little.
MAST: dict[str, Any] = {
    "name": "mast",
    "gravity": [0, 0, -9.81],
    "classes": {
        "tube": {"kind": "bar", "axial_stiffness": 2e5, "density": 2700, "radius": 0.02, "prestress": -30.0},
        "stay": {"kind": "cable", "spring_constant": 2000.0, "prestress": 10.0},
    },
    "nodes": {
        "a": {"position": [1, 0, 0], "anchored": True},
        "b": {"position": [-0.5, 0.9, 0], "anchored": True},
        "c": {"position": [-0.5, -0.9, 0], "anchored": True},
        "foot": {"position": [0, 0, 0], "anchored": True},
        "top": {"position": [0, 0, 2], "mass": 0.5},
    },
    "members": {
        "mast": {"class": "tube", "nodes": ["foot", "top"]},
        "s1": {"class": "stay", "nodes": ["a", "top"]},
        "s2": {"class": "stay", "nodes": ["b", "top"]},
        "s3": {"class": "stay", "nodes": ["c", "top"]},
    },
}


def build(document: dict[str, Any] = MAST) -> Structure:
    return assemble(parse_scene(document))[0]


def one_warning(structure: Structure) -> str:
    (sentence,) = find_warnings(structure)
    return sentence


def has_parts(sentence: str, *parts: str) -> None:
    for part in parts:
        assert part in sentence, sentence


@pytest.mark.parametrize("name", list_examples())
def test_shipped_scenes_give_no_warning(name: str, tmp_path: Any) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(list_examples()[name], encoding="utf-8")
    subject, _ = load_scene(path)
    assert (find_warnings if isinstance(subject, Structure) else find_body_warnings)(subject) == ()


def test_the_mast_gives_no_warning() -> None:
    assert find_warnings(build()) == ()


def scaled(structure: Structure, factor: float) -> Structure:
    place, rest = factor * structure.node_position, factor * structure.rest_length
    return structure.with_changes(node_position=place, rest_length=rest, radius=factor * structure.radius)


def test_lengths_in_millimetres() -> None:
    has_parts(one_warning(scaled(build(), 1000.0)), "in mm?", "s2: 2249 m", "1,000")


def test_one_node_a_thousand_times_too_far() -> None:
    nodes = MAST["nodes"] | {"far": {"position": [300, 0, 1], "anchored": True}}
    members = MAST["members"] | {"s4": {"class": "stay", "nodes": ["far", "top"]}}
    members["s4"] |= {"prestress": 0.0}
    has_parts(one_warning(build(MAST | {"nodes": nodes, "members": members})), "far is 300 m", "wrong?")


def test_a_radius_in_millimetres() -> None:
    structure = build()
    radius = np.where(structure.is_bar, 20.0, 0.0)
    has_parts(one_warning(structure.with_changes(radius=radius)), "mast has a radius of 20 m", "mm?")


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (1e-3, "2.7 kg/m3: mast; a density in g/cm3"),
        (1e-9, "2.7e-06 kg/m3: mast; a density in kg/mm3, or lengths in mm?"),
        (1e-12, "2.7e-09 kg/m3: mast; a density in t/mm3, or lengths in mm?"),
        (1e3, "solid"),
    ],
)
def test_densities_of_no_solid(factor: float, text: str) -> None:
    structure = build()
    has_parts(one_warning(structure.with_changes(member_mass=factor * structure.member_mass)), text)


@pytest.mark.parametrize("axis", [1, 2])
def test_gravity_upward(axis: int) -> None:
    gravity = np.zeros(3)
    gravity[axis] = 9.81
    sentence = one_warning(build().with_changes(gravity=gravity))
    has_parts(sentence, f"9.81 m/s2 along +{'xyz'[axis]}", "-9.81")


def test_gravity_in_millimetres() -> None:
    structure = build()
    (*_, sentence) = find_warnings(structure.with_changes(gravity=1000 * structure.gravity))
    has_parts(sentence, "9810 m/s2", "1,000 times")


def test_prestressed_cables_against_unstressed_bars() -> None:
    structure = build()
    rest = np.where(structure.is_bar, structure.member_length(), structure.rest_length)
    has_parts(one_warning(structure.with_changes(rest_length=rest)), "10 N (s1)", "mast", "settle")
    rigid = structure.with_changes(rest_length=rest, axial_stiffness=np.zeros(4))
    assert find_warnings(rigid) == ()  # a rigid bar carries what it must


def test_gravity_and_nothing_anchored() -> None:
    free = build().with_changes(node_anchored=np.zeros((5, 3), dtype=bool))
    has_parts(" ".join(find_warnings(free)), "no node is anchored", "4.91 m", "9.81 m/s2")
    nodes = MAST["nodes"] | {name: {"position": [x, 5, 0], "mass": 1} for name, x in (("p", 0), ("q", 1))}
    members = MAST["members"] | {"loose": {"class": "tube", "nodes": ["p", "q"]}}
    found = find_warnings(build(MAST | {"nodes": nodes, "members": members}))
    has_parts(" ".join(found), "1 piece (beginning at p)", "4.91 m")


@pytest.mark.parametrize("slip", ["stiffness", "mass", "load", "rigid"])
def test_a_structure_that_jumps_at_once_by_more_than_its_size(slip: str) -> None:
    structure = build()
    rest = np.where(structure.is_bar, structure.member_length(), structure.rest_length)
    changes: dict[str, Any] = {
        "stiffness": {"axial_stiffness": 1e-6 * structure.axial_stiffness,
                      "spring_constant": 1e-4 * structure.spring_constant},
        "mass": {"node_mass": 1e5 * structure.node_mass},
        "load": {"node_load": np.array([[0.0, 0, 0]] * 4 + [[1e5, 0, 0]])},
        "rigid": {"axial_stiffness": 0 * structure.axial_stiffness, "rest_length": rest,
                  "node_load": np.array([[0.0, 0, 0]] * 4 + [[1e5, 0, 0]])},
    }[slip]  # fmt: skip
    *others, sentence = find_warnings(structure.with_changes(**changes))
    assert ["below that of rubber" in other for other in others] == [True] * (slip == "stiffness")
    has_parts(sentence, "node top", "unbalanced force", "2 m large")


def test_a_rigid_bar_takes_any_load_along_it() -> None:
    structure = build()
    load = np.array([[0.0, 0, 0]] * 4 + [[0, 0, -1e6]])
    rigid = structure.with_changes(
        axial_stiffness=0 * structure.axial_stiffness, rest_length=structure.member_length(), node_load=load
    )
    assert not any("unbalanced" in text for text in find_warnings(rigid))


def test_a_structure_made_for_y_up_lies_on_its_side() -> None:
    structure = build()
    turned = structure.with_changes(node_position=structure.node_position[:, [1, 2, 0]])
    has_parts(one_warning(turned), "lie on its side", "[0, -9.81, 0]")
    upright = turned.with_changes(gravity=structure.gravity[[1, 2, 0]])
    assert find_warnings(upright) == ()


def test_a_cantilever_from_a_wall_is_none_that_lies_on_its_side() -> None:
    structure = build()
    turned = structure.with_changes(node_position=structure.node_position[:, [2, 0, 1]])
    assert find_warnings(turned) == ()


def change_member(name: str, **keys: Any) -> Structure:
    """Return the mast with other keys of one member."""
    return build(MAST | {"members": MAST["members"] | {name: MAST["members"][name] | keys}})


def test_a_prestress_of_the_wrong_sign_is_found_by_its_imbalance() -> None:
    """The mast pulls by 300 N where it has to push; all of it weighs 72 N."""
    assert warn_of_imbalance(build()) == []
    (text,) = warn_of_imbalance(change_member("mast", prestress=300.0))
    assert "out of balance by" in text
    assert "node top" in text
    assert "bars that pull there: mast" in text


def test_a_stay_whose_end_is_not_anchored_is_named() -> None:
    nodes = MAST["nodes"] | {"a": {"position": [1, 0, 0]}}
    (text,) = warn_of_imbalance(build(MAST | {"nodes": nodes}))
    assert "node a is held by member s1 alone" in text
    assert "anchored = true" in text


def test_tensions_of_rounding_are_no_forces() -> None:
    """Cables that are longer than their rest length by two units in the last place."""
    tube = MAST["classes"]["tube"] | {"prestress": 0.0}
    classes = {"tube": tube, "stay": {"kind": "cable", "spring_constant": 2000.0}}
    rest = {"s1": float(np.hypot(1.0, 2.0)) * (1 - 4e-16), "s2": 2.5, "s3": 2.5}
    members = {"mast": MAST["members"]["mast"]}
    members |= {name: MAST["members"][name] | {"rest_length": length} for name, length in rest.items()}
    structure = build(MAST | {"classes": classes, "members": members})
    assert 0 < structure.static_tension()[1] < 1e-11
    assert not any("out of balance and jump" in text for text in find_warnings(structure))


def test_a_scene_says_that_long_members_are_meant() -> None:
    nodes = {
        name: {**node, "position": [100 * x for x in node["position"]]}
        for name, node in MAST["nodes"].items()
    }
    large = {**MAST, "nodes": nodes, "classes": {**MAST["classes"]}}
    large["classes"]["tube"] = {**MAST["classes"]["tube"], "radius": 1.0, "density": 10.0}
    asked = [text for text in find_warnings(build(large)) if "lengths in mm?" in text]
    assert len(asked) == 1
    assert "large = true" in asked[0]
    structure = build({**large, "large": True})
    assert not [text for text in find_warnings(structure) if "lengths in mm?" in text]
    assert describe_structure(structure)["large"] is True
    assert "large" not in describe_structure(build(large))
    assert hash_structure(structure) == hash_structure(build(large))


def test_two_members_on_one_pair_of_nodes_keep_their_prestress_in_the_hint() -> None:
    twice = {**MAST, "members": {**MAST["members"], "again": {"class": "stay", "nodes": ["top", "foot"]}}}
    with pytest.raises(DuplicateNameError, match="join the same two nodes") as caught:
        build(twice)
    assert "stiffness and prestress are the sums of theirs" in caught.value.hint


def test_a_body_out_of_balance_is_named_with_the_resultant_on_it() -> None:
    members = {**HANGING["members"]}
    members["line"] = {**members["line"], "rest_length": 0.1}  # of 0.24 m
    (sentence,) = warn_of_imbalance(build({**HANGING, "members": members}))
    structure = build(HANGING)
    unit = np.subtract(structure.node_position[0], structure.node_position[1])
    length = float(np.linalg.norm(unit))
    tie = np.subtract(structure.node_position[3], structure.node_position[2])
    stretch = float(np.linalg.norm(tie))
    pull = 400 * (length - 0.1) / length * unit + 400 * max(stretch - 0.18, 0) / stretch * tie
    force = float(np.linalg.norm(pull - 0.4 * np.array([0, 0, 9.81])))
    assert f"out of balance by {force:.4g} N at body rod, " in sentence


def test_cables_of_no_solid_are_not_called_bars() -> None:
    structure, _ = load_scene(MAST)
    assert isinstance(structure, Structure)
    cable = ~structure.is_bar
    heavy = structure.with_changes(
        radius=np.where(cable, 1e-4, structure.radius),
        member_mass=np.where(cable, 50.0, structure.member_mass),
    )
    (sentence,) = [text for text in find_warnings(heavy) if "mass over volume" in text]
    assert "cables are of mass over volume" in sentence
