"""Strands of members: one of a straight member, one more for each ring that a cable passes."""

import numpy as np

from tensegrity_codegen.tables.strands import list_strands

POSITION = np.array([[0.0, 0, 0], [3, 0, 4], [1, 1, 1], [3, 0, 0]])


def test_straight_members_are_their_own_strands():
    strands = list_strands(np.array([[0, 1], [2, 0]]), ())
    assert strands.is_plain
    assert not strands.passes_rings.any()
    np.testing.assert_allclose(strands.lengths(POSITION), [5, np.sqrt(3)])
    values = np.array([1.0, 2.0])
    assert strands.spread(values) is values
    assert strands.add_up(values) is values


def test_a_cable_through_rings_is_as_long_as_its_strands_together():
    strands = list_strands(np.array([[0, 1], [0, 1], [3, 3]]), ((), (3,), (0, 1)))
    assert strands.ends.tolist() == [[0, 1], [0, 3], [3, 1], [3, 0], [0, 1], [1, 3]]
    assert strands.member.tolist() == [0, 1, 1, 2, 2, 2]
    assert strands.first_ends.tolist() == [[0, 1], [0, 3], [3, 0]]
    assert strands.passes_rings.tolist() == [False, True, True]
    several = np.stack([POSITION, 2 * POSITION])
    np.testing.assert_allclose(strands.lengths(several), [[5, 7, 12], [10, 14, 24]])
    assert strands.spread(np.array([[1.0, 2.0, 3.0]])).tolist() == [[1, 2, 2, 3, 3, 3]]


def test_no_members_at_all():
    strands = list_strands(np.zeros((0, 2), dtype=np.int64), ())
    assert strands.lengths(POSITION).shape == (0,)
