"""Checks of how members join nodes, and of what stays free to move."""

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.check_members import (
    check_connectivity,
    check_freedom,
    find_fully_anchored,
)
from tensegrity_codegen.system.errors import DuplicateNameError, StructureError
from tensegrity_codegen.tables.strands import list_strands
from tests.scene.samples import WHERE, build, changed

POSITION = np.array([[0.0, 0, 0], [3, 0, 4], [1, 1, 1]])
NODES = ("a", "b", "c")


def check(pairs, position=POSITION, rest_length=np.nan):
    names = tuple(f"m{row}" for row in range(len(pairs)))
    strands = list_strands(np.array(pairs, dtype=np.int64), ())
    check_connectivity(
        strands, names, NODES, np.asarray(position, float), np.full(len(pairs), rest_length), WHERE
    )


def test_a_member_to_itself():
    with pytest.raises(StructureError) as caught:
        check([(0, 1), (2, 2)])
    assert caught.value.where == f"{WHERE}: members.m1.nodes"
    assert caught.value.given == ["c", "c"]


@pytest.mark.parametrize("pair", [(0, 1), (1, 0)])
def test_two_members_on_one_pair_in_either_order(pair):
    check([(0, 1), (1, 2)])
    with pytest.raises(DuplicateNameError) as caught:
        check([(0, 1), (1, 2), pair])
    assert caught.value.where == f"{WHERE}: members.m2.nodes"
    assert caught.value.given == [NODES[node] for node in pair]
    assert "'m0' and 'm2'" in caught.value.problem


@pytest.mark.parametrize("offset", [0.0, 1e-14])
def test_coincident_nodes(offset):
    position = POSITION.copy()
    position[2] = position[1] + offset
    check([(0, 1), (0, 2)], position)  # harmless where no member joins them
    with pytest.raises(StructureError) as caught:
        check([(0, 1), (1, 2)], position)
    assert caught.value.where == f"{WHERE}: members.m1.nodes"
    assert caught.value.given == ["b", "c"]
    check([(0, 1), (1, 2)], position, rest_length=0.5)  # a cable that is slack there


def test_tiny_and_huge_structures_are_fine_but_not_beyond_numbers():
    check([(0, 1), (1, 2)], POSITION * 1e-9)
    check([(0, 1), (1, 2)], POSITION * 1e9)
    with pytest.raises(StructureError, match="too far apart"):
        check([(0, 1), (1, 2)], POSITION * 1e300)


def test_coincident_nodes_in_a_scene():
    with pytest.raises(StructureError) as caught:
        build(changed("nodes", "b", "position", to=[1, 0, 1.5]))
    assert caught.value.where == f"{WHERE}: members.bc.nodes"
    structure, _ = build(changed("nodes", "b", "position", to=[0, 0, 0]))  # a cable that is slack there
    assert structure.static_tension().tolist()[2] == 0.0


def test_freedom():
    pairs = np.array([[0, 1], [1, 2]])
    held = np.zeros((3, 3), dtype=bool)
    check_freedom(pairs, held, (0, 1, 2), NODES, WHERE)
    held[:, [0, 2]] = True
    check_freedom(pairs, held, (0, 1, 2), NODES, WHERE)
    with pytest.raises(StructureError, match="free to move"):
        check_freedom(pairs, held, (0, 2), NODES, WHERE)
    assert find_fully_anchored(held, (0, 2)).tolist() == [True] * 3
    assert find_fully_anchored(held, (0, 1)).tolist() == [False] * 3
    with pytest.raises(StructureError) as caught:
        check_freedom(pairs[:1], ~held, (0, 1, 2), NODES, WHERE)
    assert caught.value.where == f"{WHERE}: nodes.c"
