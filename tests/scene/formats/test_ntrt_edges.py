"""Bonds of nodes to edges in NTRT files: where the second structure lies, which pairs are replaced."""

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import InvalidValueError, StructureError

# Three upright rods over a triangle of cables below and one above; sides 2 h.
FRAME = """
nodes:
  b1: [0, 0, 0]
  b2: [4, 0, 0]
  b3: [1, 0, 5]
  t1: [0, 3, 0]
  t2: [4, 3, 0]
  t3: [1, 3, 5]
pair_groups:
  rod: [[b1, t1], [b2, t2], [b3, t3]]
  string: [[b1, b2], [b2, b3], [b3, b1], [t1, t2], [t2, t3], [t3, t1]]
"""
# Its three feet are the middles of the upper cables above, turned and moved.
STOOL = """
nodes:
  f1: [{0}]
  f2: [{1}]
  f3: [{2}]
  top: [{3}]
pair_groups:
  rod: [[f1, top]]
  string: [[f1, f2], [f2, f3], [f3, f1]]
  rod long: [[f2, top], [f3, top]]
"""
FEET = np.array([[2, 3, 0], [2.5, 3, 2.5], [0.5, 3, 2.5], [1.5, 6, 1.5]])
MAIN = """
substructures:
  frame: {path: frame.yaml}
  stool: {path: stool.yaml}
bond_groups:
  string:
    frame/stool/node_edge:
      - [t1/t2, f1]
      - [t2/t3, f2]
      - [t3/t1, f3]
"""


def rotation(rng):
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return turn * np.sign(np.linalg.det(turn))


@pytest.fixture
def load(tmp_path):
    def load(main=MAIN, feet=FEET, frame=FRAME):
        rows = [", ".join(repr(float(value)) for value in row) for row in feet]
        (tmp_path / "frame.yaml").write_text(frame)
        (tmp_path / "stool.yaml").write_text(STOOL.format(*rows))
        (tmp_path / "main.yaml").write_text(main)
        return import_ntrt(tmp_path / "main.yaml").document

    return load


def position(document, name):
    return np.array(document["nodes"][name]["position"])


def joined(document):
    return {frozenset(member["nodes"]) for member in document["members"].values()}


@pytest.mark.parametrize("seed", range(3))
def test_the_second_structure_is_turned_and_moved_onto_the_edges(load, seed):
    rng = np.random.default_rng(seed)
    document = load(feet=FEET @ rotation(rng).T + rng.standard_normal(3))
    for foot, middle in (("f1", FEET[0]), ("f2", FEET[1]), ("f3", FEET[2]), ("top", FEET[3])):
        np.testing.assert_allclose(position(document, f"stool_{foot}"), middle, atol=1e-12)
    np.testing.assert_array_equal(position(document, "frame_t1"), [0, 3, 0])


def test_opposite_planes_are_turned_about_the_first_side(load):
    document = load(feet=FEET * [1, -1, 1] + [0, 9, 0])  # its plane faces down: the stool comes to stand
    np.testing.assert_allclose(position(document, "stool_f1"), FEET[0], atol=1e-12)
    normal = np.cross(
        position(document, "stool_f2") - position(document, "stool_f1"),
        position(document, "stool_f3") - position(document, "stool_f1"),
    )
    np.testing.assert_allclose(normal[[0, 2]], 0, atol=1e-12)


def test_edges_become_two_cables_and_cables_between_feet_go(load):
    found = joined(load())
    for first, second, foot in (("t1", "t2", "f1"), ("t2", "t3", "f2"), ("t3", "t1", "f3")):
        assert frozenset({f"frame_{first}", f"frame_{second}"}) not in found
        assert {frozenset({f"frame_{end}", f"stool_{foot}"}) for end in (first, second)} <= found
    assert frozenset({"frame_b1", "frame_b2"}) in found
    assert frozenset({"stool_f1", "stool_top"}) in found
    document = load()
    assert all(document["members"][f"string_frame_stool_{i}"]["class"] == "string" for i in range(1, 7))
    structure, _ = assemble(parse_scene(document))
    assert (~structure.is_bar).sum() == 3 + 6


def test_rods_between_nodes_of_a_bond_stay(load):
    frame = FRAME.replace("rod: [[b1, t1], [b2, t2]", "rod: [[b1, t1], [b2, t2], [b1, b2]").replace(
        "string: [[b1, b2], ", "string: ["
    )
    main = MAIN.replace("frame/stool", "stool/frame").replace("[t1/t2, f1]", "[f1/f2, b1]")
    main = main.replace("[t2/t3, f2]", "[f2/f3, b2]").replace("[t3/t1, f3]", "[f3/f1, b3]")
    found = joined(load(main, frame=frame))
    assert frozenset({"frame_b1", "frame_b2"}) in found
    assert frozenset({"frame_b2", "frame_b3"}) not in found


@pytest.mark.parametrize(
    ("old", "new", "error", "text"),
    [
        ("      - [t3/t1, f3]\n", "", InvalidValueError, "three"),
        ("[t3/t1, f3]", "[t3, f3]", InvalidValueError, "one edge"),
        ("[t3/t1, f3]", "[t3/t1, f3/f1]", InvalidValueError, "one edge"),
        ("[t3/t1, f3]", "[t1/t2, f3]", StructureError, "line"),
        ("[t3/t1, f3]", "[b3/t3, f3]", StructureError, "rod"),
    ],
)
def test_bonds_that_cannot_be(load, old, new, error, text):
    with pytest.raises(error, match=text) as caught:
        load(MAIN.replace(old, new))
    assert "frame/stool/node_edge" in caught.value.where


def test_a_chain_of_structures_is_bonded_one_after_the_other(tmp_path, load):
    main = (
        "substructures: {a/b/c: {path: frame.yaml}}\n"
        "bond_groups: {string: {a/b/c/node_edge: [[t1, b1/b2], [t2, b2/b3], [t3, b3/b1]]}}\n"
    )
    document = load(main)
    heights = [position(document, f"{name}_b1")[1] for name in "abc"]
    np.testing.assert_allclose(np.diff(np.abs(heights)), 3, atol=1e-9)
    assert len([name for name in document["members"] if name.startswith("string_b_c")]) == 6
