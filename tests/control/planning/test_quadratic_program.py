"""Programs: answers satisfy their constraints, infeasible ones have none, multipliers are derivatives."""

import numpy as np
import pytest

from tensegrity_codegen.control.planning.quadratic_program import find_largest, find_minimum, find_nearest


def random_program(seed: int) -> tuple[np.ndarray, ...]:
    generator = np.random.default_rng(seed)
    count, rows = int(generator.integers(2, 9)), int(generator.integers(3, 30))
    root = generator.normal(size=(count, count))
    matrix = generator.normal(size=(rows, count)) * 10.0 ** generator.uniform(-3, 3, size=(rows, 1))
    inside = matrix @ generator.normal(size=count)
    spread = np.abs(inside) * generator.uniform(0, 0.5, size=rows)
    spread[0] = 0.0  # an equation
    return (
        root @ root.T + np.eye(count),
        generator.normal(size=count),
        matrix,
        inside - spread,
        inside + spread,
    )


@pytest.mark.parametrize("seed", range(40))
def test_optima_satisfy_the_conditions_of_karush_kuhn_and_tucker(seed: int) -> None:
    hessian, gradient, rows, lower, upper = random_program(seed)
    found = find_minimum(hessian, gradient, rows, lower, upper)
    assert found is not None
    scale = np.linalg.norm(rows, axis=1)
    reached = rows @ found.x
    assert np.all(reached >= lower - 1e-6 * scale)
    assert np.all(reached <= upper + 1e-6 * scale)
    force = hessian @ found.x + gradient
    np.testing.assert_allclose(
        force, rows.T @ found.multiplier, atol=1e-5 * max(1.0, float(np.abs(force).max()))
    )


@pytest.mark.parametrize("seed", range(40))
def test_infeasible_programs_have_no_answer(seed: int) -> None:
    hessian, gradient, rows, lower, upper = random_program(seed)
    wall = rows[:1]
    infeasible = np.vstack([rows, wall])
    far = upper[0] + 1e-3 * max(abs(upper[0]), float(np.linalg.norm(wall)))
    low, high = np.append(lower, far), np.append(upper, np.inf)
    assert find_minimum(hessian, gradient, infeasible, low, high) is None
    assert find_largest(gradient, infeasible, low, high) is None


@pytest.mark.parametrize("seed", range(40))
def test_the_nearest_point_is_the_minimum_of_the_square(seed: int) -> None:
    _, _, rows, lower, upper = random_program(seed)
    generator = np.random.default_rng(seed)
    matrix = generator.normal(size=(rows.shape[1] + 3, rows.shape[1]))
    target = generator.normal(size=len(matrix))
    found = find_nearest(matrix, target, rows, lower, upper)
    expected = find_minimum(matrix.T @ matrix, -matrix.T @ target, rows, lower, upper)
    assert found is not None
    assert expected is not None
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6 * max(1.0, float(np.abs(expected.x).max())))
    force = matrix.T @ (matrix @ found.x - target)
    np.testing.assert_allclose(
        force, rows.T @ found.multiplier, atol=1e-5 * max(1.0, float(np.abs(force).max()))
    )


def test_the_nearest_point_of_a_matrix_without_full_rank_is_none() -> None:
    matrix, bounds = np.array([[1.0, 0.0], [0.0, 0.0]]), np.ones(2)
    assert find_nearest(matrix, bounds, np.eye(2), -bounds, bounds) is None
    assert find_nearest(np.full((2, 2), np.nan), bounds, np.eye(2), -bounds, bounds) is None


def test_a_row_of_zeros_contradicts_its_bounds() -> None:
    eye, rows = np.eye(2), np.array([[0.0, 0.0], [1.0, 0.0]])
    assert find_minimum(eye, np.zeros(2), rows, np.array([0.0, 1.0]), np.array([0.0, 2.0])) is not None
    assert find_minimum(eye, np.zeros(2), rows, np.array([1.0, 1.0]), np.array([1.0, 2.0])) is None


def test_multipliers_of_the_largest_gain_are_its_derivatives() -> None:
    rows = np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]) * np.array([[2.0], [5.0], [1.0]])
    lower = np.array([-np.inf, -10.0, 0.0])
    gain = np.array([3.0, 1.0])
    values = []
    for step in (-1e-3, 0.0, 1e-3):
        found = find_largest(gain, rows, lower, np.array([8.0 + step, np.inf, np.inf]))
        assert found is not None
        values.append(float(gain @ found.x))
    assert (values[2] - values[0]) / 2e-3 == pytest.approx(-found.multiplier[0])


@pytest.mark.parametrize("seed", range(40))
def test_the_largest_gain_satisfies_its_constraints_closer_than_they_are_checked(seed: int) -> None:
    _, gain, rows, lower, upper = random_program(seed)
    found = find_largest(
        gain,
        np.vstack([rows, np.eye(len(gain))]),
        np.append(lower, -1e3 + 0 * gain),
        np.append(upper, 1e3 + 0 * gain),
    )
    assert found is not None
    scale = np.linalg.norm(rows, axis=1)
    assert np.all(rows @ found.x >= lower - 1e-8 * scale)
    assert np.all(rows @ found.x <= upper + 1e-8 * scale)
