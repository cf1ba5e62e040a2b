import numpy as np

from tensegrity_codegen.scene.checks.scene_warnings import find_warnings
from tests.rigid_scenes import HANGING
from tests.scene.samples import REMOVE, build
from tests.scene.samples import changed as changed_from

STONE = {"kind": "rigid", "mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [0, 0, 1]}
SOUND = changed_from("classes", "strut", "prestress", to=-8.0)


def changed(*path, to):
    return changed_from(*path, to=to, base=SOUND)


def warnings_of(document):
    return find_warnings(build(document)[0])


def test_a_sound_structure_gives_none():
    assert warnings_of(SOUND) == ()


def test_extension_above_half_suspects_the_units():
    (sentence,) = warnings_of(changed("members", "ab", "rest_length", to=1.3))
    assert "50 %" in sentence
    assert "53.8 %" in sentence
    assert sentence.endswith(": ab")
    assert warnings_of(changed("members", "ab", "rest_length", to=1.34)) == ()


def test_a_bar_squeezed_by_half_is_doubted_and_a_slack_cable_is_not():
    assert "50 %" in warnings_of(changed("members", "ac", "rest_length", to=10.0))[0]
    assert warnings_of(changed("members", "ab", "rest_length", to=10.0)) == ()


def test_load_on_a_fully_anchored_node():
    loads = [*SOUND["loads"], {"node": "a", "force": [1, 0, 0]}, {"node": "b", "force": [1, 0, 0]}]
    (sentence,) = warnings_of(changed("loads", to=loads))
    assert "load" in sentence
    assert sentence.endswith(": a")


def test_member_between_two_anchored_nodes():
    (sentence,) = warnings_of(changed("nodes", "b", "anchored", to=True))
    assert sentence.endswith(": ab")


def test_force_input_on_a_fully_anchored_node():
    (sentence,) = warnings_of(changed("inputs", 1, "nodes", to=["a"]))
    assert sentence.endswith(": push")


def test_damping_of_a_rigid_bar():
    document = changed("classes", "strut", "axial_stiffness", to=REMOVE)
    document["classes"]["strut"] = {"kind": "bar", "mass": 0.1, "damping": 1.0}
    (sentence,) = warnings_of(document)
    assert "rigid" in sentence


def test_pieces_that_share_no_node():
    document = changed("nodes", "d", to={"position": [5, 0, 0], "mass": 1})
    document["nodes"]["e"] = {"position": [6, 0, 0], "mass": 1}
    document["members"]["de"] = {"class": "strut", "nodes": ["d", "e"]}
    sentence, falling = warnings_of(document)
    assert "1 piece (beginning at d)" in falling
    assert "2 unconnected pieces" in sentence
    assert sentence.endswith("a, d")


def test_many_members_are_counted():
    structure, _ = build(SOUND)
    structure = structure.with_changes(rest_length=np.full(3, 0.5))
    (sentence,) = find_warnings(structure)
    assert "ac, bc, ab" in sentence


def test_bodies_give_no_warnings_of_bars_and_nodes():
    assert find_warnings(build(HANGING)[0]) == ()
    # Two bodies through one another, far from the origin, one of them light: what carries them is no bar.
    bodies = {name: {**HANGING["bodies"]["block"], "centre": [0.0, 0.0, 0.5]} for name in ("one", "two")}
    bodies["two"] |= {"centre": [0.01, 0.0, 0.5], "mass": 5e-5, "inertia": [4e-8, 5e-8, 6e-8]}
    members = {
        name: {"kind": "cable", "nodes": ["hook", f"{name}.eye"], "spring_constant": 400, "rest_length": 0.4}
        for name in bodies
    }
    assert find_warnings(build({**HANGING, "bodies": bodies, "members": members})[0]) == ()


def test_a_free_body_is_named_by_itself():
    document = {**HANGING, "bodies": {**HANGING["bodies"], "stone": STONE}}
    pieces, falling = find_warnings(build(document)[0])
    assert "stone" in pieces
    assert "beginning at stone)" in falling
    assert "corner" not in pieces + falling


def test_a_quaternion_that_is_no_unit_is_told():
    for quaternion, count in (([0.6, 0.0, 0.8, 1e-4], 0), ([0.6, 0.0, 0.8, 0.01], 1)):
        rod = {**STONE, "quaternion": quaternion}
        sentences = find_warnings(build({"name": "stone", "gravity": [0, 0, 0], "bodies": {"stone": rod}})[0])
        told = [text for text in sentences if "normalised" in text]
        assert len(told) == count
    assert told == ["bodies.stone.quaternion has the length 1.00005 and was normalised to 1"]
