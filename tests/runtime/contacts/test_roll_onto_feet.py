"""Rigid structures that turn about their feet, against the facets of their hulls."""

from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen.runtime.contacts.roll_onto_feet import roll_onto_feet
from tensegrity_codegen.structure.ground import Ground
from tests.ground_cases import make_ground

Array = NDArray[np.float64]
DOWN = np.array([0.0, 0.0, -1.0])


def place(position: Array, **options: Any) -> tuple[Ground, Array]:
    """Return a ground that all nodes can touch, and the nodes let down onto it."""
    ground = make_ground(len(position), friction=0.5, **options)
    return ground, position + ground.compute_depth(position).max() * ground.normal


def share(position: Array, center: Array) -> Array:
    """Return forces on nodes (n, 3) whose sum is 1 N down, and acts at a point."""
    matrix = np.vstack([position.T, np.ones(len(position))])
    return np.outer(np.linalg.lstsq(matrix, np.append(center, 1.0))[0], DOWN)


def test_a_box_on_a_corner_falls_onto_its_face() -> None:
    box = np.array([[x, y, z] for x in (0, 0.3) for y in (0, 0.2) for z in (0, 0.5)])
    turned = box @ Rotation.from_euler("xyz", [3.0, -5.0, 20.0], degrees=True).as_matrix().T
    ground, before = place(turned)
    after = roll_onto_feet(ground, before, np.tile(DOWN, (8, 1)))
    depth = ground.compute_depth(after)
    np.testing.assert_allclose(np.sort(-depth), [0.0] * 4 + [0.5] * 4, atol=1e-12)
    np.testing.assert_allclose(scipy.spatial.distance.pdist(after), scipy.spatial.distance.pdist(box))


@pytest.mark.parametrize("seed", range(30))
def test_it_rests_on_a_facet_below_the_load(seed: int) -> None:
    """Of the hull of random points: nothing below the ground, and a lower load than at the start."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(12, 3))
    ground, before = place(points)
    load = share(before, before.mean(axis=0) + 0.1 * random.normal(size=3))
    after = roll_onto_feet(ground, before, load)
    gap = -ground.compute_depth(after)
    feet = after[gap < 1e-9]
    assert gap.min() > -1e-12
    assert len(feet) == 3
    center = (load[:, 2] @ after) / load[:, 2].sum()
    weights = np.linalg.solve(np.vstack([feet[:, :2].T, np.ones(3)]), [*center[:2], 1.0])
    assert weights.min() > -1e-9
    assert center[2] < (load[:, 2] @ before[:, 2]) / load[:, 2].sum()


def test_balls_of_different_sizes_touch_with_their_lowest_points() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.4, 0.9, 0.0], [0.5, 0.3, 0.6]])
    ground, before = place(points, radius=np.array([0.05, 0.1, 0.02, 0.0]))
    after = roll_onto_feet(ground, before, np.outer([0.0, 0.0, 0.0, 1.0], DOWN))
    np.testing.assert_allclose(ground.compute_depth(after)[:3], 0.0, atol=1e-12)
    assert after[3, 2] > 0.5


def test_a_load_below_a_ball_hangs_from_it() -> None:
    """One ball of 0.5 m, the load 0.2 m from its centre: it turns until the load is below it."""
    points = np.array([[0.0, 0.0, 0.0], [0.12, 0.0, -0.16], [0.3, 0.3, 0.3]])
    ground, before = place(points, radius=np.array([0.5, 0.0, 0.0]))
    after = roll_onto_feet(ground, before, np.outer([0.0, 1.0, 0.0], DOWN))
    np.testing.assert_allclose(after[1], [0.0, 0.0, 0.3], atol=1e-12)


@pytest.mark.parametrize("outside", [False, True])
def test_a_load_between_the_feet_turns_nothing(outside: bool) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, 1.0]])
    ground, before = place(points)
    load = np.zeros((4, 3))
    load[3] = [0.9 if outside else 0.1, 0.0, -1.0]
    after = roll_onto_feet(ground, before, load)
    assert np.array_equal(after, before) == (not outside)
