"""Sobol' indices against closed forms: linear functions, an interaction, grids, failed cases."""

import numpy as np
import pytest

from tensegrity_codegen.sweeps.summary.statistics import (
    Indices,
    compute_grid_indices,
    compute_indices,
    compute_sobol_indices,
)
from tests.sweeps.summary.sweeps import make_grid, make_saltelli, make_sample

LINEAR = np.array([1.0, 4.0, 9.0]) / 14.0  # factors 1, 2, 3 of uniform keys


def indices_of(values: np.ndarray, keys: tuple[str, ...] = ("a", "b", "c")) -> Indices:
    found = compute_sobol_indices(keys, values)
    assert isinstance(found, Indices)
    return found


@pytest.fixture(scope="module", autouse=True)
def _needs_salib() -> None:
    pytest.importorskip("SALib")


def test_a_linear_function_has_its_closed_form() -> None:
    sweep = make_saltelli(4096)
    found = indices_of(sweep.key_values @ np.array([1.0, 2.0, 3.0]))
    # Errors fall as 1/sqrt(n): 4096 points of the base sample give about 0.02.
    np.testing.assert_allclose(found.first, LINEAR, atol=0.06)
    np.testing.assert_allclose(found.total, LINEAR, atol=0.06)
    assert (found.first_error > 0).all()
    assert (np.abs(found.first - LINEAR) < 3 * found.first_error).all()


def test_an_interaction_is_in_the_total_index_only() -> None:
    """Y = (a - 1/2) (b - 1/2): no first-order effect, all of the variance in the interaction."""
    keys = make_saltelli(4096).key_values
    found = indices_of((keys[:, 0] - 0.5) * (keys[:, 1] - 0.5))
    np.testing.assert_allclose(found.first, [0, 0, 0], atol=0.08)
    np.testing.assert_allclose(found.total, [1, 1, 0], atol=0.08)


def test_the_same_cases_give_the_same_intervals() -> None:
    values = make_saltelli(64).key_values.sum(axis=1)
    first, second = indices_of(values), indices_of(values)
    np.testing.assert_array_equal(first.first_error, second.first_error)


def test_failed_cases_leave_out_their_point_of_the_base_sample() -> None:
    sweep = make_saltelli(512)
    values = sweep.key_values @ np.array([1.0, 2.0, 3.0])
    values[[7, 8, 100]] = np.nan
    found = indices_of(values)
    assert "510 points, 2 of 512 left out" in found.source
    np.testing.assert_allclose(found.total, LINEAR, atol=0.2)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.ones(512 * 5), "constant"),
        (np.where(np.arange(512 * 5) % 10 == 0, np.nan, np.arange(512.0 * 5)), "base sample"),
        (np.arange(25.0), "too few"),
        (np.arange(26.0), "complete sample"),
    ],
)
def test_what_allows_no_indices(values: np.ndarray, reason: str) -> None:
    found = compute_sobol_indices(("a", "b", "c"), values)
    assert isinstance(found, str)
    assert reason in found


def test_the_points_of_a_grid_give_exact_indices() -> None:
    """Y = 2 x + 3 y + x y on a symmetric grid: variances 4 Vx, 9 Vy and Vx Vy."""
    x, y = np.linspace(-1, 1, 5), np.linspace(-2, 2, 9)
    table = 2 * x[:, None] + 3 * y + x[:, None] * y
    found = compute_grid_indices(("x", "y"), table.ravel(), (5, 9))
    assert isinstance(found, Indices)
    parts = np.array([4 * x.var(), 9 * y.var(), x.var() * y.var()])
    np.testing.assert_allclose(found.first, parts[:2] / parts.sum(), rtol=1e-12)
    np.testing.assert_allclose(found.total, (parts[:2] + parts[2]) / parts.sum(), rtol=1e-12)


def test_which_cases_allow_indices() -> None:
    grid, sample = make_grid(), make_sample()
    assert isinstance(compute_indices(grid, grid.key_values[:, 0] ** 2), Indices)
    assert "saltelli" in str(compute_indices(sample, sample.key_values[:, 0]))
    failed = grid.key_values[:, 0].copy()
    failed[3] = np.nan
    assert compute_indices(grid, failed) == "1 of 108 points of the grid have no result"
