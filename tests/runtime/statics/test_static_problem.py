"""Counts of rigid motions for all kinds of anchoring."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.statics.static_problem import (
    build_all_motions,
    build_rigid_motions,
    find_neutral_motions,
)
from tests.reference import ReferenceModel
from tests.runtime.build import bar, make_structure, prism

TRIANGLE = ([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [bar(0, 1, 1.0), bar(1, 2, 2**0.5), bar(2, 0, 1.0)])
ROD = ([[0, 0, 0], [0.6, 0, 0.8]], [bar(0, 1, 1.0)])


@pytest.mark.parametrize(
    ("body", "axes", "anchored", "count"),
    [
        (TRIANGLE, "xyz", {}, 6),
        (TRIANGLE, "xz", {}, 3),
        (TRIANGLE, "xyz", {0: "xyz"}, 3),
        (TRIANGLE, "xyz", {0: "xyz", 1: "xyz"}, 1),
        (TRIANGLE, "xyz", {0: "xyz", 1: "xyz", 2: "xyz"}, 0),
        (TRIANGLE, "xyz", {0: "z", 1: "z", 2: "z"}, 4),
        (TRIANGLE, "xz", {0: "xz"}, 1),
        (ROD, "xyz", {}, 5),
        (ROD, "xyz", {0: "xyz"}, 2),
        (ROD, "xz", {}, 3),
    ],
)
def test_count_and_orthonormality(body, axes, anchored, count) -> None:
    structure = make_structure(*body, axes=axes, anchored=anchored)
    model = ReferenceModel(structure)
    motions = build_rigid_motions(model.manifest, structure.node_position)
    assert motions.shape == (int(model.free.sum()), count)
    np.testing.assert_allclose(motions.T @ motions, np.eye(count), atol=1e-12)
    stiffness = model.compute("tangent_stiffness")
    assert np.abs(stiffness @ motions).max(initial=0) < 1e-4  # members: 1e5 N/m
    assert find_neutral_motions(stiffness, motions, 0.0).shape[1] == count


def test_tilting_a_prestressed_body_out_of_balance_is_not_neutral() -> None:
    """Away from equilibrium a rotation turns the residual forces, so the stiffness feels it."""
    structure = prism(130.0)
    model = ReferenceModel(structure)
    motions = build_rigid_motions(model.manifest, structure.node_position)
    assert find_neutral_motions(model.compute("tangent_stiffness"), motions, 0.0).shape[1] == 3


@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2), (1,)])
def test_all_motions_are_the_velocities_of_nodes_in_their_twists(axes: tuple[int, ...]) -> None:
    position = np.random.default_rng(3).normal(size=(2, 4, 3))
    motions, twists = build_all_motions(axes, position)
    assert motions.shape == (2, 4 * len(axes), len(axes) * (len(axes) + 1) // 2)
    local = position - position.mean(axis=1, keepdims=True)
    for case, motion, twist in zip(local, motions, twists, strict=True):
        for k in range(motion.shape[1]):
            velocity = np.cross(twist[:3, k], case) + twist[3:, k]
            np.testing.assert_allclose(motion[:, k], velocity[:, list(axes)].ravel(), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(motions, axis=1), 1.0, rtol=1e-14)
