"""Rigid motions and mechanisms."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.rank import (
    build_part_motions,
    find_free_motions,
    find_parts,
    find_rank,
)
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
SIDES = [bar(k, (k + 1) % 4, 1.0) for k in range(4)]


def count_motions(structure) -> tuple[int, int]:
    model = ReferenceModel(structure)
    rank = find_rank(model.compute("equilibrium_matrix").toarray())
    parts = find_parts(model.manifest)
    found = find_free_motions(rank, build_part_motions(model.manifest, structure.node_position, parts))
    both = np.hstack([found.rigid, found.mechanism])
    np.testing.assert_allclose(both.T @ both, np.eye(both.shape[1]), atol=1e-10)
    assert np.abs(rank.left.T @ both).max(initial=0.0) < 1e-9
    assert both.shape[1] == rank.free_motion.shape[1]
    return found.rigid.shape[1], found.mechanism.shape[1]


@pytest.mark.parametrize(
    ("structure", "rigid", "mechanisms"),
    [
        (prism(), 6, 1),
        (prism(160.0), 6, 0),
        (prism(anchored=dict.fromkeys(range(3), "xyz")), 0, 1),
        (prism(anchored=dict.fromkeys(range(3), "z")), 3, 1),
        (make_structure(SQUARE, SIDES), 6, 2),
        (make_structure(SQUARE, SIDES, axes="xz"), 3, 1),
        (make_structure(SQUARE, SIDES, axes="xz", anchored={0: "xz"}), 1, 1),
        (make_structure(SQUARE, SIDES, axes="xz", anchored={0: "xz", 1: "xz"}), 0, 1),
        (make_structure(SQUARE, SIDES, axes="xz", anchored=dict.fromkeys(range(4), "xz")), 0, 0),
        (make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.0)], axes="x"), 1, 0),
        (make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.0)]), 5, 0),
        (make_structure([[0, 0, 0], [0, 0, 1]], [cable(0, 1, 1.0)], anchored={1: "xyz"}), 2, 0),
    ],
)
def test_counts(structure, rigid, mechanisms) -> None:
    assert count_motions(structure) == (rigid, mechanisms)


def test_parts_that_no_members_join_have_rigid_motions_of_their_own() -> None:
    apart = [*SQUARE, [5, 0, 0], [6, 0, 0], [9, 0, 0]]
    structure = make_structure(apart, [*SIDES, bar(4, 5, 1.0)], axes="xz", anchored={6: "xz"})
    assert find_parts(ReferenceModel(structure).manifest) == ((0, 1, 2, 3), (4, 5))
    assert count_motions(structure) == (6, 1)


def test_far_away() -> None:
    structure = prism()
    moved = structure.with_changes(node_position=structure.node_position + 1000.0)
    assert count_motions(moved) == (6, 1)
