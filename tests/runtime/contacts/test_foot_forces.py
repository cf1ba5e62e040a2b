"""Forces of feet on a rigid structure, against closed forms and against the proof of Farkas."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.contacts.judge_stand import (
    FootProblem,
    find_foot_forces,
    find_least_friction,
)

Array = NDArray[np.float64]
LEVEL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ALL = np.ones(6, dtype=bool)
TRIPOD = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0]])


def pose(force: Array, at: Array, place: Array = TRIPOD) -> FootProblem:
    """Return feet that carry a force at a point."""
    return FootProblem(place, np.concatenate([force, np.cross(at, force)]), LEVEL, ALL, 1.0)


@pytest.mark.parametrize("angle", [0.1, 0.4])
def test_a_slope_needs_the_friction_of_its_angle(angle: float) -> None:
    """mu = tan(angle), where the load acts at the height of the feet."""
    load = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    assert find_least_friction(pose(load, np.zeros(3))) == pytest.approx(np.tan(angle), rel=1e-9)


def test_forces_balance_the_load_within_their_cones() -> None:
    problem = pose(np.array([0.2, 0.1, -1.0]), np.array([0.1, -0.05, 0.3]))
    found = find_foot_forces(problem, 0.3)
    np.testing.assert_allclose(problem.matrix @ found.force.ravel(), -problem.load, atol=1e-10)
    assert found.excess < 0.0
    assert np.all(np.linalg.norm(found.force[:, 1:], axis=1) <= 0.3 * found.force[:, 0])


@pytest.mark.parametrize(
    ("force", "at"),
    [
        ([0.4, 0.0, -1.0], [0.0, 0.0, 0.0]),  # slides
        ([0.0, 0.0, -1.0], [2.0, 0.0, 0.0]),  # tips
        ([0.0, 0.0, 1.0], [0.0, 0.0, 0.0]),  # lifts off
        ([0.3, -0.3, -1.0], [0.1, 0.0, 0.4]),
    ],
)
def test_a_rigid_motion_proves_that_there_are_no_forces(force: list[float], at: list[float]) -> None:
    """W . w > 0 and n . u >= mu |u in the plane| at each foot (Farkas)."""
    problem = pose(np.array(force), np.array(at))
    motion = find_foot_forces(problem, 0.3).motion
    velocity = problem.velocities(motion)
    assert motion @ problem.load > 1e-3
    assert np.all(velocity[:, 0] - 0.3 * np.linalg.norm(velocity[:, 1:], axis=1) > -1e-9)


def test_no_friction_keeps_a_structure_from_tipping() -> None:
    assert find_least_friction(pose(np.array([0.0, 0.0, -1.0]), np.array([0.0, 2.0, 0.0]))) == np.inf


def test_a_twist_needs_friction_of_all_feet() -> None:
    """Three feet at the radius r carry N/3 each: a moment M needs mu = M / (N r)."""
    angle = 2 * np.pi * np.arange(3) / 3
    place = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    problem = FootProblem(place, np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.6]), LEVEL, ALL, 1.0)
    assert find_least_friction(problem) == pytest.approx(0.2, rel=1e-8)
